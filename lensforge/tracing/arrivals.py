"""What a tracer returns: every ray, in the order in which it left the source, with its fate."""

from dataclasses import dataclass

from jaxtyping import Bool, Float, Int8
from torch import Tensor

from lensforge.tracing.fates import Fate


@dataclass(frozen=True)
class Arrivals:
    """Rays at the receiver's plane.

    ``hits``: mm, 0 where a ray did not arrive. ``carried``: the flux (W) that reached the last surface met, after
    Fresnel losses. ``sines``: squared sine of the exit angle by Snell's law, above 1 for total reflection, 0 where
    the outer surface was not reached. ``fates``: values of :class:`~lensforge.tracing.fates.Fate`.
    """

    hits: Float[Tensor, "n 2"]
    carried: Float[Tensor, " n"]
    sines: Float[Tensor, " n"]
    fates: Int8[Tensor, " n"]

    @property
    def arrived(self) -> Bool[Tensor, " n"]:
        """The rays that reached the receiver's plane."""
        return self.fates == Fate.ARRIVED

    @property
    def flux(self) -> Float[Tensor, " n"]:
        """Flux (W) at the receiver's plane: that of the rays that arrived, 0 for all others."""
        return self.carried * self.arrived
