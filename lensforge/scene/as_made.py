"""A lens as it was made and mounted, where it is not as designed: places and size of source and faces, roughness.

The form of the faces is not here: it is that of the tables, or of the surfaces, that are traced.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.face_records import FacePlacement
from lensforge.optics.arrays import Array, like
from lensforge.optics.face_roles import DOUBLE


class Roughness(NamedTuple):
    """Three standard normal numbers of each ray at every face, and the rms slope of each face."""

    noise: Float[np.ndarray, "n m"]
    slopes: Float[np.ndarray, " f"]


_NOISE_SEED = 20_29  # of the roughness: any number; the same in every trace, so that parts compare ray by ray


@dataclass(frozen=True)
class Displacement:
    """A rigid displacement: a turn about ``centre_mm`` by ``tilt_rad`` about x and y, then a shift by ``shift_mm``.

    The two tilts are the components of one rotation vector.
    """

    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Matrix of the turn (Rodrigues' formula)."""
        x, y = self.tilt_rad
        angle = float(np.hypot(x, y))
        cross = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
        half = np.sinc(0.5 * angle / np.pi)
        turn: Float[np.ndarray, "3 3"] = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross
        return turn

    @property
    def shift(self) -> Float[np.ndarray, "3"]:
        """Image (mm) of the origin."""
        centre = np.array(self.centre_mm)
        moved: Float[np.ndarray, 3] = centre - self.rotation @ centre + np.array(self.shift_mm)
        return moved


@dataclass(frozen=True)
class AsMade:
    """Deviations of one made lens from its design, the same for all rays.

    ``names``: of the faces, from the source on. ``source``: displacement of the source, which is ``source_size`` times
    as large about the centre of that displacement; ``lens``: of the whole lens, which is ``scale`` times as large about
    its seat, ``seat_mm`` below its origin; ``faces``: of a face against the body, whose place is that of the first
    face. ``slopes``: roughness of a face, rms of the slope along any line on it. Faces left out are as designed.
    """

    names: tuple[str, ...] = DOUBLE
    source: Displacement = field(default_factory=Displacement)
    lens: Displacement = field(default_factory=Displacement)
    faces: Mapping[str, Displacement] = field(default_factory=dict)
    source_size: float = 1.0
    scale: float = 1.0
    seat_mm: float = 0.0
    slopes: Mapping[str, float] = field(default_factory=dict)

    @property
    def placed(self) -> FacePlacement:
        """Places of the faces.

        Frames go from the source to the first face, from face to face, and from the last one to the world. The seat
        stays: an origin ``seat_mm`` above it comes to lie ``seat_mm (scale - 1)`` higher.
        """
        lens, source = self.lens.rotation, self.source.rotation
        centre, up = np.array(self.source.centre_mm), np.array([0.0, 0.0, self.seat_mm * (self.scale - 1.0)])
        # source: o' = R (c + k (o - c)) + shift; lens: p' = R (s p + up) + shift
        emitted = source @ centre * (1.0 - self.source_size) + self.source.shift
        at = (lens.T @ (emitted - self.lens.shift) - up) / self.scale
        faces = [self.faces.get(name, Displacement()) for name in self.names]
        turns, shifts = [each.rotation for each in faces], [each.shift for each in faces]
        back = lens @ (self.scale * shifts[-1] + up) + self.lens.shift
        between = pairwise(zip(turns, shifts, strict=True))
        frames = np.stack(
            [
                np.column_stack([turns[0].T @ lens.T @ source, turns[0].T @ (at - shifts[0])]),
                *(np.column_stack([own.T @ last, own.T @ (left - shift)]) for (last, left), (own, shift) in between),
                np.column_stack([lens @ turns[-1], back]),
            ]
        )
        return FacePlacement(frames, self.source_size / self.scale, self.scale)

    def rough(self, rays: int) -> Roughness | None:
        """Roughness of all faces for so many rays; None where all are polished."""
        slopes = np.array([self.slopes.get(name, 0.0) for name in self.names])
        return Roughness(_noise(rays, len(slopes)), slopes) if slopes.any() else None


@lru_cache(maxsize=2)
def _noise(rays: int, faces: int) -> Float[np.ndarray, "n m"]:
    """Standard normal numbers of each ray at every face, (x, y, z) each."""
    noise = np.random.default_rng(_NOISE_SEED).standard_normal((rays, 3 * faces))
    noise.flags.writeable = False
    return noise


def through_frame(
    frame: Float[np.ndarray, "3 4"], points: Float[Array, "n 3"], directions: Float[Array, "n 3"], factor: float = 1.0
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Points (mm) and directions in the next frame."""
    turn, shift = like(points, frame[:, :3]), like(points, frame[:, 3])
    return factor * (points @ turn.T) + shift, directions @ turn.T
