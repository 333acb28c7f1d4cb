"""The exported part as OBJ with vertex normals, for programs that trace meshes: facets alone would refract wrongly."""

import numpy as np

from lensforge.proof.part_mesh import PartMesh

_HEAD = "# Body in mm, normals out of the material; axis z.\n"


def obj_bytes(part: PartMesh) -> bytes:
    """An OBJ file of ``part``; a vertex at an edge is there once for each smooth face."""
    rows = part.corners
    points = np.empty((len(part.fit.fitted), 3))
    points[rows.ravel()] = part.mesh.vertices[part.mesh.faces.ravel()]
    places = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
    normals = [f"vn {x:.7g} {y:.7g} {z:.7g}" for x, y, z in part.fit.fitted.tolist()]
    facets = [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (rows + 1).tolist()]
    return (_HEAD + "\n".join([*places, *normals, *facets]) + "\n").encode("ascii")
