"""Solids of manifold3d from meshes, in double precision."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int


def manifold_of(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"], faces: Int[np.ndarray, " t"] | None = None
) -> Any:
    """The ``manifold3d.Manifold`` of a mesh whose neighbouring triangles share vertices, empty where it is not closed.

    ``faces``: numbers that its triangles keep through a union.
    """
    import manifold3d

    numbers = {} if faces is None else {"face_id": np.ascontiguousarray(faces, dtype=np.uint64)}
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(vertices, dtype=np.float64),
        tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
        **numbers,
    )
    return manifold3d.Manifold(mesh)
