"""STL and 3MF files of the mesh, in mm: written to bytes, and parsed from them.

STL is in single precision and repeats every vertex in each of its triangles; 3MF keeps shared vertices, unit and face
names. The same mesh gives the same bytes: the identifiers that 3MF needs are hashes of the content.

Bytes that come from a file are read within bounds, 3MF in a child process, since its library is C++; bytes that this
process made are read at once.
"""

import ctypes
import hashlib
import uuid
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad.mesh import BodyMesh
from lensforge.errors import InputError
from lensforge.results.file_bounds import (
    MOST_TRIANGLES,
    NamedMesh,
    made_here,
    read_3mf,
    read_named_3mf,
    remembered,
    stl_corners,
)
from lensforge.results.files import file_bytes, read_json, temporary_file, temporary_folder, write_json
from lensforge.results.sandbox import ChildLimits, serve, work_in_child


def set_geometry(body: Any, vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> None:
    """Fill a ``lib3mf.MeshObject``; its vertices are in single precision."""
    import lib3mf

    places = _as_structs(vertices.astype(np.float32), lib3mf.Position)
    corners = _as_structs(triangles.astype(np.uint32), lib3mf.Triangle)
    call = body._wrapper.lib.lib3mf_meshobject_setgeometry
    counts = ctypes.c_uint64(len(places)), ctypes.c_uint64(len(corners))
    body._wrapper.checkError(body, call(body._handle, counts[0], places, counts[1], corners))


def _as_structs(rows: np.ndarray, struct: type[ctypes.Structure]) -> Any:
    return (struct * len(rows)).from_buffer_copy(np.ascontiguousarray(rows).tobytes())


_AGAIN = "run `lensforge export` again"
_THREEMF = "lens.3mf"
_JOB = "job.json"
_READ = "read.npz"
# A mesh of 0.2 million triangles takes 0.2 GiB, and 5 s on a busy machine.
_LIMITS = ChildLimits(memory_mib=1800, seconds=60.0)
_DECIMALS = 9  # of a mm in 3MF, whose vertices are single precision: read back within 3e-6 mm below 32 mm


def stl_bytes(mesh: BodyMesh) -> bytes:
    """An STL file of ``mesh``; shared vertices have equal coordinates in it."""
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("none", "<u2")])
    records["normal"] = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
    records["corners"] = corners
    return remembered(bytes(80) + len(records).to_bytes(4, "little") + records.tobytes())


def parse_stl(content: bytes, origin: str = "lens.stl") -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm), equal ones merged, and triangles of an STL file's bytes.

    Raises :class:`InputError` unless they hold a mesh; ``origin`` names the file in the message.
    """
    corners = stl_corners(content, origin, _AGAIN, None if made_here(content) else MOST_TRIANGLES)
    vertices, index = merged_rows(corners.reshape(-1, 3))
    return vertices, index.reshape(-1, 3)


def merged_rows(rows: Float[np.ndarray, "n d"]) -> tuple[Float[np.ndarray, "m d"], Int[np.ndarray, " n"]]:
    """The distinct rows in ascending order, and the number of each row among them.

    As ``np.unique`` along an axis, in a quarter of the time.
    """
    order = np.lexsort(rows.T[::-1])
    ascending = rows[order]
    begins = np.append(True, (ascending[1:] != ascending[:-1]).any(axis=1))
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(begins) - 1
    return ascending[begins], number


def threemf_bytes(mesh: BodyMesh, product: str) -> bytes:
    """A 3MF file of ``mesh`` as one object; each named face is a triangle set of it."""
    import lib3mf

    library = lib3mf.get_wrapper()
    model = library.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    body = model.AddMeshObject()
    body.SetName(product)
    set_geometry(body, mesh.vertices, mesh.triangles)
    for index, name in enumerate(mesh.names):
        members = np.flatnonzero(mesh.face == index).astype(np.uint32)
        body.AddTriangleSet(f"face-{index}", name).SetTriangleList(members.tolist())
    item = model.AddBuildItem(body, library.GetIdentityTransform())
    digest = hashlib.sha256(mesh.vertices.tobytes() + mesh.triangles.tobytes()).digest()
    for number, owner in enumerate((body.SetUUID, model.SetBuildUUID, item.SetUUID)):
        owner(str(uuid.UUID(bytes=digest[:15] + bytes([number]), version=4)))
    writer = model.QueryWriter("3mf")
    writer.SetDecimalPrecision(_DECIMALS)

    def write(path: Path) -> None:
        try:
            writer.WriteToFile(str(path))
        except lib3mf.ELib3MFException as error:
            raise InputError(f"{product}: the 3MF file could not be written to {path.parent} ({error})") from None

    return remembered(file_bytes("lens.3mf", write))


def parse_3mf(content: bytes, origin: str = _THREEMF) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm) and triangles of the one object in a 3MF file's bytes.

    Raises :class:`InputError` for anything else; ``origin`` names the file in the message.
    """
    if made_here(content):
        with temporary_file(content, _THREEMF) as path:
            return read_3mf(path, origin, _AGAIN)
    return _read_by_child(content, origin, named=False)[:2]


def parse_named_3mf(content: bytes, origin: str = _THREEMF) -> BodyMesh:
    """The mesh in a 3MF file's bytes with the names of its faces, each a triangle set, as :func:`threemf_bytes` has it.

    Raises :class:`InputError` for anything else; ``origin`` names the file in the message.
    """
    if made_here(content):
        with temporary_file(content, _THREEMF) as path:
            mesh = read_named_3mf(path, origin, _AGAIN)
    else:
        mesh = NamedMesh(*_read_by_child(content, origin, named=True))
    return BodyMesh(mesh.vertices, mesh.triangles, mesh.face, tuple(map(str, mesh.names)), rings=0)


def _read_by_child(content: bytes, origin: str, *, named: bool) -> Any:
    with temporary_folder(origin) as folder:
        (folder / _THREEMF).write_bytes(content)
        write_json(folder / _JOB, {"origin": origin, "named": named})
        work_in_child(Path(__file__).resolve(), folder, _LIMITS, origin=origin, remedy=_AGAIN)
        read = np.load(folder / _READ)
        return tuple(read[name] for name in read.files)


def _write_arrays(folder: Path) -> None:
    job = read_json(folder / _JOB)
    reader = read_named_3mf if job["named"] else read_3mf
    np.savez(folder / _READ, *map(np.asarray, reader(folder / _THREEMF, job["origin"], _AGAIN)))


if __name__ == "__main__":
    serve(_write_arrays)
