"""The opaque bodies of a scene as verification sees them: a mesh in the way of rays to a receiver.

Turned by rotations of its own, and cast through the grid by which it casts the part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from lensforge.proof.facet_casting import Grid, Leg

Placed = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"], float, tuple[float, float], tuple[float, float, float]]

_AT_END_MM = 1e-6  # a body in the very surface of a receiver is none before it


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Triangles (mm) of all bodies, in the coordinates of the screens."""

    corners: Float[np.ndarray, "t 3 3"]

    @staticmethod
    def of(bodies: Sequence[Placed]) -> "Obstacles | None":
        """Bodies by vertices and triangles in their own frames, turn (degrees), tilts and place; None without any."""
        corners = []
        for vertices, triangles, rotate_z_deg, tilt_deg, centre_mm in bodies:
            turn = Rotation.from_euler("zxy", [rotate_z_deg, *tilt_deg], degrees=True)  # small: about fixed axes
            corners.append((turn.apply(vertices) + centre_mm)[triangles])
        return Obstacles(np.concatenate(corners)) if corners else None

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
