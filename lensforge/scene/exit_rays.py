"""The light behind the lens: every ray, in the order in which it left the source, with its fate."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from lensforge.kernels.fate import Fate
from lensforge.optics.arrays import Array


@dataclass(frozen=True)
class ExitRays:
    """Rays as they leave the outer surface; receivers take them on from there. In NumPy, or as a search traces them.

    ``points``: mm, on the outer surface, and ``directions``: unit vectors behind it; 0 where a ray did not leave the
    lens. ``flux``: that (W) which the last event left, after losses at faces and absorption. ``sin2_exit``: squared
    sine s of the exit angle by Snell's law, above 1 for total reflection, 0 where the outer surface was not reached;
    2 - s at a face of several that is to reflect, as the wall of a TIR lens. ``fates``: values of
    :class:`~lensforge.kernels.fate.Fate`. ``absorbed``: flux (W) that the body took on the way to the outer surface,
    and mirrors; None if nothing takes any. ``axial``: that flux (W) times the squared part of the unit field along
    z, for a cover glass; None where nobody asks. ``lost_in_glass``: what a cover glass reflected and
    absorbed; points are then those from which rays seem to come behind it. ``met``: number of the face at each event
    of a chain, -1 where there was none; None of a double-freeform lens.

    Where further bodies come: ``fields`` (real and imaginary parts of both, ``kernels.fields``) and the flux (W)
    ``carried`` of which half of the sum of their squares is left; ``lost_in_bodies``: what each body took, by its
    number. A ray that ends in one has no flux, and its fate there. ``draws``: two numbers in [0, 1) of each ray for
    every event to come at a wall, which may be diffuse; None without such walls.
    """

    points: Float[Array, "n 3"]
    directions: Float[Array, "n 3"]
    flux: Float[Array, " n"]
    sin2_exit: Float[Array, " n"]
    fates: Int8[Array, " n"]
    absorbed: Float[Array, " n"] | None = None
    lost_in_glass: Float[Array, " n"] | None = None
    axial: Float[Array, " n"] | None = None
    met: Int8[Array, "n e"] | None = None
    fields: Float[Array, "n 12"] | None = None
    carried: Float[Array, " n"] | None = None
    lost_in_bodies: Float[Array, "b n"] | None = None
    draws: Float[np.ndarray, "n d"] | None = None

    @staticmethod
    def joined(parts: "Sequence[ExitRays]") -> "ExitRays":
        """The rays of all ``parts``, NumPy arrays, one after another."""
        first = {name: value for name, value in vars(parts[0]).items() if value is not None}
        return ExitRays(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in first})

    def take(self, rows: Int[np.ndarray, " k"]) -> "ExitRays":
        """Exit of some of the rays as NumPy arrays: places, directions, flux and fates."""
        columns = (self.points, self.directions, self.flux, self.sin2_exit, self.fates)
        return ExitRays(*(column[rows] for column in columns))

    @property
    def left_lens(self) -> Bool[Array, " n"]:
        """The rays that left the lens, in any direction."""
        return self.fates == Fate.LEFT_LENS


class Sensitivities(NamedTuple):
    """Derivatives of a number with respect to exit rays: to their points (per mm), and to their directions.

    Those to a point have no part along the ray, which is a line in space.
    """

    by_points: Float[np.ndarray, "n 3"]
    by_directions: Float[np.ndarray, "n 3"]
