"""A source that was not mounted where it should be, or that shines into a lens of another index than it should."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.sources.bundle import RayBundle, Source


@dataclass(frozen=True)
class ShiftedSource:
    """``source``, every ray of it starting ``shift_mm`` away.

    ``index`` is added to the refractive indices of rays that carry their own; for all others the scene has it.
    """

    source: Source
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    index: float = 0.0

    @property
    def flux_w(self) -> float:
        """That of the source itself."""
        return self.source.flux_w

    @property
    def symmetry(self) -> str:
        """None is left, in general."""
        return "none"

    @property
    def population(self) -> int | None:
        """That of the source itself."""
        return self.source.population

    def sample(self, count: int, seed: int) -> RayBundle:
        """The same rays, moved."""
        rays = self.source.sample(count, seed)
        own = rays.refractive_indices
        indices = None if own is None else own + self.index
        return replace(rays, origins=rays.origins + np.array(self.shift_mm), refractive_indices=indices)

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """The outline, moved."""
        moved: Float[np.ndarray, "k 3"] = self.source.outline() + np.array(self.shift_mm)
        return moved
