"""Rays as they leave a source, and what every source promises."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class RayBundle:
    """``n`` rays: start points (mm), unit directions, and the flux each carries (W). NumPy, float64."""

    origins: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.weights)


@runtime_checkable
class Source(Protocol):
    """An emitter in lens coordinates: the lens axis is +z, the cavity opens at z = 0."""

    @property
    def flux_w(self) -> float:
        """Total flux (W) of every sample, so that efficiencies have one denominator."""
        ...

    @property
    def symmetry(self) -> str:
        """The largest mirror group (a name of ``surfaces.symmetry``) that leaves the emission unchanged."""
        ...

    @property
    def population(self) -> int | None:
        """Number of distinct rays of a measured source; None for one that can be sampled without end."""
        ...

    def sample(self, count: int, seed: int) -> RayBundle:
        """``count`` rays whose weights add up to ``flux_w``; the same seed gives the same rays."""
        ...

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """A closed polygon (mm) around the emitting area, for drawings to scale."""
        ...
