"""The mesh as binary STL in mm: single precision, and every vertex written once for each of its triangles."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.geometry.mesh import BodyMesh


def write_stl(mesh: BodyMesh, path: Path) -> None:
    """Write ``mesh``; rims that share vertices have equal ones in the file, too."""
    import trimesh

    body = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    with replacing(path) as temporary:
        body.export(str(temporary), file_type="stl")


def read_stl(path: Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm), equal ones merged, and triangles of an STL file. Raises :class:`InputError`."""
    import trimesh

    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; run `lensforge export` first")
    try:
        body = trimesh.load_mesh(str(path), file_type="stl", process=False)
    except Exception as error:  # whatever the reader raises, the file is what is wrong
        raise InputError(f"{path}: not readable as STL ({error}); run `lensforge export` again") from None
    if len(getattr(body, "faces", ())) == 0:
        raise InputError(f"{path}: holds no triangles; run `lensforge export` again")
    vertices, index = np.unique(np.asarray(body.vertices, dtype=np.float64), axis=0, return_inverse=True)
    return vertices, index.reshape(-1)[np.asarray(body.faces)]
