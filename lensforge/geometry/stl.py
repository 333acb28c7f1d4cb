"""The mesh as binary STL in mm: single precision, and every vertex written once for each of its triangles."""

import io

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.geometry.mesh import BodyMesh


def stl_bytes(mesh: BodyMesh) -> bytes:
    """An STL file of ``mesh``; rims that share vertices have equal ones in the file, too."""
    import trimesh

    content = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(file_type="stl")
    assert isinstance(content, bytes)
    return content


def parse_stl(content: bytes, origin: str = "lens.stl") -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm), equal ones merged, and triangles of an STL file's bytes.

    Raises :class:`InputError` for what is no mesh; ``origin`` is the name that it calls it by.
    """
    import trimesh

    try:
        body = trimesh.load_mesh(io.BytesIO(content), file_type="stl", process=False)
    except Exception as error:  # whatever the reader raises, the file is what is wrong
        raise InputError(f"{origin}: not readable as STL ({error}); run `lensforge export` again") from None
    if len(getattr(body, "faces", ())) == 0:
        raise InputError(f"{origin}: holds no triangles; run `lensforge export` again")
    vertices, index = np.unique(np.asarray(body.vertices, dtype=np.float64), axis=0, return_inverse=True)
    return vertices, index.reshape(-1)[np.asarray(body.faces)]
