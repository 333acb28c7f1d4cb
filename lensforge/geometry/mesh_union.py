"""The mesh of a body on a base of the user's own: the structured mesh of the lens, joined to the kernel's of the base.

The two touch in z = 0 only, so the union keeps every vertex of the optical faces, and adds some to their rims where the
base's outline crosses them.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.geometry.mesh import BodyMesh
from lensforge.geometry.solid import Solid
from lensforge.geometry.step_base import BASE

_ANGLE_RAD = 0.1  # between neighbouring facets of a round face of the base


def join_mesh(mesh: BodyMesh, base: Solid, chord_mm: float) -> BodyMesh:
    """``mesh`` and ``base``, whose facets keep within ``chord_mm``, as one mesh; all of the base is the face ``BASE``.

    Raises :class:`InputError` where the kernel's mesh of the base is not closed.
    """
    lens = _manifold(mesh.vertices, mesh.triangles, mesh.face)
    vertices, triangles = tessellated(base, chord_mm)
    below = _manifold(vertices, triangles, np.full(len(triangles), len(mesh.names)))
    if below.is_empty():
        raise InputError("base.file: the mesh of its solid is not closed; repair the solid where it was made")
    joined = (lens + below).to_mesh64()
    return BodyMesh(
        np.array(joined.vert_properties),  # a copy: the views of the library are read-only
        np.asarray(joined.tri_verts).astype(np.int64),
        np.asarray(joined.face_id).astype(np.int64),
        (*mesh.names, BASE),
        mesh.rings,
    )


def _manifold(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"], face: Int[np.ndarray, " t"]
) -> Any:
    import manifold3d

    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(vertices, dtype=np.float64),
        tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
        face_id=np.ascontiguousarray(face, dtype=np.uint64),
    )
    return manifold3d.Manifold(mesh)


def tessellated(base: Solid, chord_mm: float) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """The kernel's facets, face by face, with the vertices on shared edges merged."""
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    BRepMesh_IncrementalMesh(base.shape.wrapped, chord_mm, False, _ANGLE_RAD)
    points: list[tuple[float, float, float]] = []
    corners = []
    for face in base.shape.Faces():
        vertices, triangles = face.tessellate(chord_mm, _ANGLE_RAD)
        corners.append(np.array(triangles, dtype=np.int64) + len(points))
        points += [vertex.toTuple() for vertex in vertices]
    merged, index = np.unique(np.round(np.array(points), 9), axis=0, return_inverse=True)
    return merged, index.reshape(-1)[np.concatenate(corners)]
