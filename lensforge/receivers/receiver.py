"""Protocol of every receiver, which maps exit rays to hits without knowing the lens; landings, as arrays too."""

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int
from torch import Tensor

from lensforge.receivers.pixels import PixelGrid, Window
from lensforge.tracing.exit_rays import ExitRays, Sensitivities

ReceiverKind = Literal["plane", "far_field", "cylinder", "sphere"]


@dataclass(frozen=True)
class Landings:
    """Exit rays on a receiver, in their order.

    ``hits``: coordinates on the receiver's chart; ``flux``: W; both 0 where a ray did not land. ``landed``: rays that
    reach the surface in which the receiver lies. ``missed_receiver``: rays that left the lens and never do.
    """

    hits: Float[Tensor, "n 2"]
    flux: Float[Tensor, " n"]
    landed: Bool[Tensor, " n"]
    missed_receiver: Bool[Tensor, " n"]


@runtime_checkable
class Receiver(Protocol):
    """A pixel grid on the chart of some surface, or of all directions; charts keep areas, so that pixels are alike."""

    def __hash__(self) -> int:
        """Hash of a receiver, which does not change."""
        ...

    @property
    def kind(self) -> ReceiverKind:
        """Kind of the receiver, as a spec names it."""
        ...

    @property
    def grid(self) -> PixelGrid:
        """The pixels, in whose coordinates hits are given."""
        ...

    @property
    def window(self) -> Window:
        """The part in which flux counts as detected."""
        ...

    @property
    def pixel_measure(self) -> float:
        """Measure of a pixel: its area in m^2, or its solid angle in sr."""
        ...

    def land(self, rays: ExitRays) -> Landings:
        """Land ``rays``, float64 on the CPU, by a compiled kernel; without a gradient."""
        ...

    def sensitivities(self, rays: ExitRays, by_hits: Float[np.ndarray, "n 2"]) -> Sensitivities:
        """Sensitivities to exit rays from those to their hits, which are 0 for rays that missed the receiver."""
        ...

    def land_in_torch(self, rays: ExitRays) -> Landings:
        """``land`` in plain torch, on any device and in any precision; differentiable."""
        ...

    def places(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        """Points (mm) of the lens's space at places on the chart; of a far field unit directions."""
        ...

    def target_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Places on the chart as targets state them: mm, or degrees from the axis of a far field."""
        ...

    def chart_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Places as targets state them on the chart: the inverse."""
        ...


@dataclass(frozen=True)
class Hits:
    """Hits and flux (W) of rays on a receiver; 0 for rays that did not land."""

    hits: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]

    @staticmethod
    def of(landings: Landings) -> "Hits":
        """The arrays of ``landings``, in float64 and without a gradient."""
        return Hits(*(tensor.detach().cpu().double().numpy() for tensor in (landings.hits, landings.flux)))

    @property
    def arrived(self) -> Bool[np.ndarray, " n"]:
        """Rays that arrived with flux."""
        return self.flux > 0.0

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> "Hits":
        """Hits of some of the rays."""
        return Hits(self.hits[rows], self.flux[rows])
