"""Vertices and triangles between arrays and an object of lib3mf, in one copy each.

lib3mf's functions in Python make an object of every vertex and every triangle, 4 s for half a million; these call the
same functions of the library on whole arrays.
"""

import ctypes
from typing import Any

import numpy as np
from jaxtyping import Float, Int


def set_geometry(body: Any, vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> None:
    """Fill a ``lib3mf.MeshObject``; its vertices are in single precision."""
    import lib3mf

    places = _as_structs(vertices.astype(np.float32), lib3mf.Position)
    corners = _as_structs(triangles.astype(np.uint32), lib3mf.Triangle)
    call = body._wrapper.lib.lib3mf_meshobject_setgeometry
    counts = ctypes.c_uint64(len(places)), ctypes.c_uint64(len(corners))
    body._wrapper.checkError(body, call(body._handle, counts[0], places, counts[1], corners))


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


def _as_structs(rows: np.ndarray, struct: type[ctypes.Structure]) -> Any:
    return (struct * len(rows)).from_buffer_copy(np.ascontiguousarray(rows).tobytes())
