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

from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.pose import IN_PLACE, ORIGIN, FacePoses, Pose, Vector


class Roughness(NamedTuple):
    """Three standard normal numbers of each ray at every face, and the rms slope of each face."""

    noise: Float[np.ndarray, "n m"]
    slopes: Float[np.ndarray, " f"]


_NOISE_SEED = 20_29  # of the roughness: any number; the same in every trace, so that parts compare ray by ray


@dataclass(frozen=True)
class AsMade:
    """Deviations of one made lens from its design, the same for all rays.

    ``names``: of the faces, from the source on. ``source``: displacement of the source, which is ``source_size`` times
    as large about ``source_centre_mm``; ``lens``: of the whole lens, which is ``scale`` times as large about its seat,
    ``seat_mm`` below its origin; ``faces``: of a face against the body, whose place is that of the first face.
    ``slopes``: roughness of a face, rms of the slope along any line on it. Faces left out are as designed.
    """

    names: tuple[str, ...] = DOUBLE
    source: Pose = IN_PLACE
    source_centre_mm: Vector = ORIGIN
    lens: Pose = IN_PLACE
    faces: Mapping[str, Pose] = field(default_factory=dict)
    source_size: float = 1.0
    scale: float = 1.0
    seat_mm: float = 0.0
    slopes: Mapping[str, float] = field(default_factory=dict)

    @property
    def placed(self) -> FacePoses:
        """Places of the faces.

        Frames go from the source to the first face, from face to face, and from the last one to the world. The seat
        stays: an origin ``seat_mm`` above it comes to lie ``seat_mm (scale - 1)`` higher.
        """
        # source: o' = R (c + k (o - c)) + shift; lens: p' = R (s p + up) + shift
        centre, up = np.array(self.source_centre_mm), np.array([0.0, 0.0, self.seat_mm * (self.scale - 1.0)])
        emitted = self.source.directions(centre) * (1.0 - self.source_size) + np.array(self.source.origin_mm)
        source = self.source.seen_from(self.lens).at((self.lens.own_points(emitted) - up) / self.scale)
        faces = [self.faces.get(name, IN_PLACE) for name in self.names]
        last = faces[-1].at(self.scale * np.array(faces[-1].origin_mm) + up)
        between = tuple(one.seen_from(other) for one, other in pairwise(faces))
        into, back = source.seen_from(faces[0]), self.lens.after(last)
        return FacePoses(into, between, back, self.source_size / self.scale, self.scale)

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
