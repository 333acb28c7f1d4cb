"""Watertightness of a mesh, tested by manifold3d in double precision."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.geometry.manifold import manifold_of


@dataclass(frozen=True)
class Closure:
    """Result of manifold3d; ``status`` is ``NoError`` for an oriented 2-manifold without boundary.

    ``genus`` counts handles: 0 for a lens, whose cavity and bore are one blind hole; -1 for two bodies.
    ``fault_mm`` is the midpoint of an edge that does not join two consistently oriented triangles; None where all do.
    """

    status: str
    genus: int
    volume_mm3: float
    fault_mm: tuple[float, float, float] | None = None

    @property
    def watertight(self) -> bool:
        """Closed, oriented outwards, and one body."""
        return self.status == "NoError" and self.volume_mm3 > 0.0 and self.genus >= 0


def check_closed(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> Closure:
    """Test a mesh whose neighbouring triangles share vertex indices."""
    body = manifold_of(vertices, triangles)
    return Closure(body.status().name, int(body.genus()), float(body.volume()), _fault(vertices, triangles))


def _fault(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> tuple[float, float, float] | None:
    """Midpoint (mm) of the first edge that is not traversed once in each direction; None if all are."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    forth, back = edges @ [len(vertices), 1], edges @ [1, len(vertices)]
    ordered = np.sort(forth)
    if (np.diff(ordered) > 0).all() and np.array_equal(ordered, np.sort(back)):
        return None
    _, first, times = np.unique(forth, return_index=True, return_counts=True)
    wrong = np.concatenate([first[times > 1], np.flatnonzero(~np.isin(back, forth))])
    x, y, z = vertices[edges[wrong.min()]].mean(axis=0).tolist()
    return x, y, z
