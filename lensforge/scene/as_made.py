"""A lens as it was made and mounted, where it is not as designed: places and size of source and faces, roughness.

The form of the faces is not here: it is that of the tables, or of the surfaces, that are traced.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import Array, like

Placed = tuple[Float[np.ndarray, "3 3 4"], float, float]
Rough = tuple[Float[np.ndarray, "_ 6"], float, float]

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

    ``source``: displacement of the source, which is ``source_size`` times as large about the centre of that
    displacement; ``lens``: of the whole lens, which is ``scale`` times as large about its seat, ``seat_mm`` below its
    origin; ``outer``: of its outer face against the inner one. ``inner_slope``, ``outer_slope``: roughness, rms of the
    slope along any line on the face.
    """

    source: Displacement = field(default_factory=Displacement)
    lens: Displacement = field(default_factory=Displacement)
    outer: Displacement = field(default_factory=Displacement)
    source_size: float = 1.0
    scale: float = 1.0
    seat_mm: float = 0.0
    inner_slope: float = 0.0
    outer_slope: float = 0.0

    @property
    def placed(self) -> Placed:
        """Frames and factors as the kernels take them, see ``kernels.trace``.

        The seat stays: an origin ``seat_mm`` above it comes to lie ``seat_mm (scale - 1)`` higher.
        """
        lens, outer, source = self.lens.rotation, self.outer.rotation, self.source.rotation
        centre, up = np.array(self.source.centre_mm), np.array([0.0, 0.0, self.seat_mm * (self.scale - 1.0)])
        # source: o' = R (c + k (o - c)) + shift; lens: p' = R (s p + up) + shift
        emitted = source @ centre * (1.0 - self.source_size) + self.source.shift
        at = (lens.T @ (emitted - self.lens.shift) - up) / self.scale
        back = lens @ (self.scale * self.outer.shift + up) + self.lens.shift
        frames = np.stack(
            [
                np.column_stack([lens.T @ source, at]),
                np.column_stack([outer.T, -outer.T @ self.outer.shift]),
                np.column_stack([lens @ outer, back]),
            ]
        )
        return frames, self.source_size / self.scale, self.scale

    def rough(self, rays: int) -> Rough | None:
        """Roughness as the kernels take it, for so many rays; None for polished faces."""
        if self.inner_slope == 0.0 and self.outer_slope == 0.0:
            return None
        return _noise(rays), self.inner_slope, self.outer_slope


def rough_part(rough: Rough | None, part: slice) -> Rough | None:
    """Roughness of some of the rays."""
    return None if rough is None else (rough[0][part], *rough[1:])


@lru_cache(maxsize=2)
def _noise(rays: int) -> Float[np.ndarray, "n 6"]:
    """Standard normal numbers of each ray at both faces, (x, y, z) each."""
    found = np.random.default_rng(_NOISE_SEED).standard_normal((rays, 6))
    found.flags.writeable = False
    return found


def through_frame(
    frame: Float[np.ndarray, "3 4"], points: Float[Array, "n 3"], directions: Float[Array, "n 3"], factor: float = 1.0
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Points (mm) and directions in the next frame."""
    turn, shift = like(points, frame[:, :3]), like(points, frame[:, 3])
    return factor * (points @ turn.T) + shift, directions @ turn.T
