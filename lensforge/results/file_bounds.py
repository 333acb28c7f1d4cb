"""Bounds on STL, 3MF and STEP files before any work is done on them, and bytes of this process, which need none.

Bytes that this very process made need neither bounds nor a child process. A file that is read from a folder may be
anybody's, whatever its record states: only this process's own memory counts. The normals in an STL file are not read:
they may contradict the triangles.

The library of 3MF, lib3mf, is C++: files from outside are read in a child process. Its functions in Python make an
object of every vertex and every triangle, 4 s for half a million; here the same functions are called on whole arrays.
"""

import ctypes
import hashlib
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError, refused

_OWN: set[bytes] = set()


def remembered(content: bytes) -> bytes:
    """``content``, just made by this process, which will recognise it from now on."""
    _OWN.add(hashlib.sha256(content).digest())
    return content


def made_here(content: bytes) -> bool:
    """True if this process made ``content``."""
    return hashlib.sha256(content).digest() in _OWN


_MIB = 2**20
# The STEP file of a lens has 1,500 entities, and a clamp with 1,000 faces 50,000: some MiB.
MOST_STEP_MIB = 128


def require_small_step(content: bytes, origin: str, remedy: str) -> None:
    """Raise :class:`InputError` unless ``content`` begins as a STEP file does and is not too large."""
    if b"ISO-10303-21" not in content[:1024]:
        raise InputError(f"{origin}: not readable as STEP (it does not begin with ISO-10303-21); {remedy}")
    if len(content) > MOST_STEP_MIB * _MIB:
        raise InputError(
            f"{origin}: {len(content) / _MIB:.0f} MiB, at most {MOST_STEP_MIB} MiB of STEP are read; {remedy}"
        )


# No lens or clamping base is 10 m wide, and single precision would be coarser than a micrometre there.
MOST_MM = 1e4
# 500 rings on each surface; a mesh for the default tolerance has 0.2 million. Merging the corners takes 1 GiB.
MOST_TRIANGLES = 3_000_000
MOST_TEXT_TRIANGLES = 1_000_000  # in text every number is parsed by itself: 4 s
_HEADER = 84  # bytes
_RECORD = 50  # bytes a triangle
_RECORDS = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"vertex\s+([-+0-9.eE]{1,40})\s+([-+0-9.eE]{1,40})\s+([-+0-9.eE]{1,40})\s")


def stl_corners(
    content: bytes, origin: str, remedy: str, most_triangles: int | None = MOST_TRIANGLES
) -> Float[np.ndarray, "t 3 3"]:
    """Corners (mm) of the triangles of an STL file; ``most_triangles``: None for bytes of the program's own.

    Raises :class:`InputError`, in which ``origin`` names the file and ``remedy`` what to try, for other bytes, no
    triangles or too many, and coordinates that are not finite or beyond ``MOST_MM``.
    """
    stated = int.from_bytes(content[_HEADER - 4 : _HEADER], "little")
    if len(content) >= _HEADER and len(content) == _HEADER + _RECORD * stated:
        _require_count(stated, most_triangles, origin, remedy)
        with np.errstate(invalid="ignore"):  # a signalling NaN, which is refused below as any other
            corners = np.frombuffer(content, _RECORDS, offset=_HEADER)["corners"].astype(np.float64)
    elif content[:512].lstrip().startswith(b"solid"):
        corners = _of_text(content, most_triangles, origin, remedy)
    else:
        states = f"states {stated} triangles, {_HEADER + _RECORD * stated} bytes, and has {len(content)} bytes"
        raise InputError(f"{origin}: not readable as STL ({states}); {remedy}")
    worst = float(np.abs(corners).max())  # NaN where any is
    if not worst <= MOST_MM:
        raise InputError(f"{origin}: a vertex lies at {worst:g} mm, at most {MOST_MM:g} mm is read; {remedy}")
    return corners


def _of_text(content: bytes, most_triangles: int | None, origin: str, remedy: str) -> Float[np.ndarray, "t 3 3"]:
    count = content.count(b"endfacet")
    _require_count(count, None if most_triangles is None else MOST_TEXT_TRIANGLES, origin, remedy)
    numerals = (word for vertex in _VERTEX.finditer(content) for word in vertex.groups())
    with refused(origin, f"not readable as STL (…); {remedy}", ValueError):
        numbers = np.fromiter((float(word) for word in numerals), dtype=np.float64)
    if len(numbers) != 9 * count:
        raise InputError(f"{origin}: {count} facets, but {len(numbers) / 3:g} vertices, must be 3 each; {remedy}")
    return numbers.reshape(-1, 3, 3)


def _require_count(count: int, most: int | None, origin: str, remedy: str) -> None:
    if count == 0:
        raise InputError(f"{origin}: holds no triangles; {remedy}")
    if most is not None and count > most:
        raise InputError(f"{origin}: {count} triangles, at most {most} are read; {remedy}")


def read_3mf(path: Path, origin: str, remedy: str) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm) and triangles of the only object that the file builds, in place.

    Raises :class:`InputError`, in which ``origin`` names the file and ``remedy`` what to try, for anything else.
    """
    model = _model_of_3mf(path, origin, remedy)
    return _bounded(_only_mesh(model, origin, remedy), origin, remedy)


class NamedMesh(NamedTuple):
    """Vertices (mm) and triangles of a mesh, the number of each triangle's face, and the names of the faces."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    face: Int[np.ndarray, " t"]
    names: tuple[str, ...]


def read_named_3mf(path: Path, origin: str, remedy: str) -> NamedMesh:
    """Vertices (mm) and triangles, as :func:`read_3mf` has them, the number of each triangle's face, and the names.

    Raises :class:`InputError` for a triangle in no named face, too.
    """
    model = _model_of_3mf(path, origin, remedy)
    body = _only_mesh(model, origin, remedy)
    vertices, triangles = _bounded(body, origin, remedy)
    named = [body.GetTriangleSet(number) for number in range(body.GetTriangleSetCount())]
    face = np.full(len(triangles), -1, dtype=np.int64)
    for number, members in enumerate(named):
        face[members.GetTriangleList()] = number
    if (face < 0).any():
        raise InputError(f"{origin}: {int((face < 0).sum())} triangles belong to no named face; {remedy}")
    return NamedMesh(vertices, triangles, face, tuple(members.GetName() for members in named))


def _model_of_3mf(path: Path, origin: str, remedy: str) -> Any:
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    with refused(origin, f"not readable as 3MF (…); {remedy}", lib3mf.ELib3MFException):
        reader.ReadFromFile(str(path))
    if model.GetUnit() != lib3mf.ModelUnit.MilliMeter:
        raise InputError(f"{origin}: holds no mesh in mm; {remedy}")
    return model


def _bounded(body: Any, origin: str, remedy: str) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices and triangles of a mesh of no more, and no farther, than any part has."""
    if not 0 < body.GetTriangleCount() <= MOST_TRIANGLES:
        raise InputError(f"{origin}: {body.GetTriangleCount()} triangles, 1 to {MOST_TRIANGLES} are read; {remedy}")
    vertices, triangles = geometry_of(body)
    if not float(np.abs(vertices).max()) <= MOST_MM:
        raise InputError(f"{origin}: a vertex lies beyond {MOST_MM:g} mm; {remedy}")
    return vertices, triangles


def _only_mesh(model: Any, origin: str, remedy: str) -> Any:
    items = model.GetBuildItems()
    objects = model.GetObjects()
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
            buffer = (struct * len(rows)).from_buffer(rows)
            needed = ctypes.c_uint64(0)
            body._wrapper.checkError(body, call(body._handle, ctypes.c_uint64(len(rows)), needed, buffer))
    return vertices.astype(np.float64), triangles.astype(np.int64)
