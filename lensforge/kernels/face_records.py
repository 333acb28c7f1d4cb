"""Sides, places and scatter of the faces of a body, as the kernels take them; free of the compiler."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int8


class FaceMedia(NamedTuple):
    """Media before and behind each face, and the reflectance of its mirror, negative without one."""

    before: Int8[np.ndarray, " f"]
    behind: Int8[np.ndarray, " f"]
    mirrors: Float[np.ndarray, " f"]


class FacePlacement(NamedTuple):
    """Transforms between the frames of the faces: rotations with a shift (mm) in the last column.

    From the frame of the rays to the first face's, from there to the next face's, and from the last back; if any face
    may be met next, all have one frame. ``factor_in``: of lengths on the way into the first frame, ``factor_out``: on
    the way back; those of a lens that has shrunk, and of a source of another size.
    """

    frames: Float[np.ndarray, "g 3 4"]
    factor_in: float
    factor_out: float


class RingShifts(NamedTuple):
    """Shifts of light behind faces that scatter by rings (``optics.scattering.RingScatter``).

    ``numbers`` (n, 2 f): in [0, 1), two of each ray for each face that it meets the first time. ``sizes`` (f, 2): of
    the ``cosines`` of incidence and of the ``squares`` of the radii of a face, none of one that does not scatter so.
    ``shares`` (f, k, r): within each radius at each incidence. ``follows``: 1 where scattered light keeps its direction
    along the face, 0 where it does not.
    """

    numbers: Float[np.ndarray, "n m"]
    sizes: Int[np.ndarray, "f 2"]
    cosines: Float[np.ndarray, "f k"]
    squares: Float[np.ndarray, "f r"]
    shares: Float[np.ndarray, "f k r"]
    follows: Float[np.ndarray, " f"]

    def part(self, part: slice) -> "RingShifts":
        """Shifts of some of the rays."""
        return self._replace(numbers=self.numbers[part])
