"""The opaque bodies of a scene as verification sees them: a mesh in the way of rays to a receiver.

Turned by rotations of its own, and cast through the grid by which it casts the part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from lensforge.proof.facet_casting import Grid, Leg

_AT_END_MM = 1e-6  # a body in the very surface of a receiver is none before it


class ObstacleBody(NamedTuple):
    """Vertices (mm) and triangles of a body in its own frame, which is turned about z, tilted, and then placed."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    rotate_z_deg: float
    tilt_deg: tuple[float, float]
    centre_mm: tuple[float, float, float]

    @property
    def corners(self) -> Float[np.ndarray, "t 3 3"]:
        """Corners (mm) of its triangles, in its place."""
        turn = Rotation.from_euler("zxy", [self.rotate_z_deg, *self.tilt_deg], degrees=True)  # small: about fixed axes
        return np.asarray((turn.apply(self.vertices) + self.centre_mm)[self.triangles])


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Triangles (mm) of all bodies, in the coordinates of the screens."""

    corners: Float[np.ndarray, "t 3 3"]

    @staticmethod
    def of(bodies: Sequence[ObstacleBody]) -> "Obstacles | None":
        """All ``bodies``; None without any."""
        return Obstacles(np.concatenate([body.corners for body in bodies])) if bodies else None

    @cached_property
    def _grid(self) -> Grid:
        import trimesh

        return Grid(trimesh.Trimesh(self.corners.reshape(-1, 3), np.arange(3 * len(self.corners)).reshape(-1, 3)))

    def block(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], paths_mm: Float[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """True for rays that meet a body before the end of their paths."""
        hits = self._grid.first_hits(Leg(points, directions, np.zeros(len(points))))
        blocked: Bool[np.ndarray, " n"] = hits.found & (hits.distances < paths_mm - _AT_END_MM)
        return blocked
