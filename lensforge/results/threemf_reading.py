"""The mesh in a 3MF file, by lib3mf, whose library is C++: files from outside are read in a child process.

Its functions in Python make an object of every vertex and every triangle, 4 s for half a million; here the same
functions of the library are called on whole arrays.
"""

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.results.file_bounds import MOST_MM, MOST_TRIANGLES


def read_3mf(path: Path, origin: str, remedy: str) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm) and triangles of the one object that the file builds, where it is.

    Raises :class:`InputError`, in which ``origin`` names the file and ``remedy`` what to try, for anything else.
    """
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    try:
        reader.ReadFromFile(str(path))
    except lib3mf.ELib3MFException as error:
        raise InputError(f"{origin}: not readable as 3MF ({error}); {remedy}") from None
    if model.GetUnit() != lib3mf.ModelUnit.MilliMeter:
        raise InputError(f"{origin}: holds no mesh in mm; {remedy}")
    body = _only_mesh(model, origin, remedy)
    if not 0 < body.GetTriangleCount() <= MOST_TRIANGLES:
        raise InputError(f"{origin}: {body.GetTriangleCount()} triangles, 1 to {MOST_TRIANGLES} are read; {remedy}")
    vertices, triangles = geometry_of(body)
    if not float(np.abs(vertices).max()) <= MOST_MM:
        raise InputError(f"{origin}: a vertex lies beyond {MOST_MM:g} mm; {remedy}")
    return vertices, triangles


def _only_mesh(model: Any, origin: str, remedy: str) -> Any:
    items, objects = model.GetBuildItems(), model.GetObjects()
    if (items.Count(), objects.Count()) != (1, 1) or not items.MoveNext():
        raise InputError(
            f"{origin}: builds {items.Count()} of {objects.Count()} objects, a part is one of one; {remedy}"
        )
    item = items.GetCurrent()
    if item.HasObjectTransform() and not np.array_equal(np.array(item.GetObjectTransform().Fields), np.eye(4)[:, :3]):
        raise InputError(f"{origin}: moves, turns or scales its object; {remedy}")
    meshes = model.GetMeshObjects()
    if not meshes.MoveNext():
        raise InputError(f"{origin}: holds no mesh in mm; {remedy}")
    return meshes.GetCurrentMeshObject()


def geometry_of(body: Any) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices and triangles of a ``lib3mf.MeshObject``."""
    import lib3mf

    library = body._wrapper.lib
    vertices = np.empty((body.GetVertexCount(), 3), dtype=np.float32)
    triangles = np.empty((body.GetTriangleCount(), 3), dtype=np.uint32)
    reads = (
        (library.lib3mf_meshobject_getvertices, lib3mf.Position, vertices),
        (library.lib3mf_meshobject_gettriangleindices, lib3mf.Triangle, triangles),
    )
    for call, struct, rows in reads:
        if len(rows):
            buffer, needed = (struct * len(rows)).from_buffer(rows), ctypes.c_uint64(0)
            body._wrapper.checkError(body, call(body._handle, ctypes.c_uint64(len(rows)), needed, buffer))
    return vertices.astype(np.float64), triangles.astype(np.int64)
