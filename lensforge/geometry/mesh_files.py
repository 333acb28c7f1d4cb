"""STL and 3MF files of the mesh, in mm: written to bytes, and parsed from them.

STL is in single precision and repeats every vertex in each of its triangles; 3MF keeps shared vertices, unit and face
names. The same mesh gives the same bytes: the identifiers that 3MF needs are hashes of the content.
"""

import ctypes
import hashlib
import io
import uuid
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.files import file_bytes, temporary_file
from lensforge.geometry.mesh import BodyMesh

_DECIMALS = 9  # of a mm in 3MF, whose vertices are single precision: 1e-6 mm at lens size


def stl_bytes(mesh: BodyMesh) -> bytes:
    """An STL file of ``mesh``; shared vertices have equal coordinates in it."""
    import trimesh

    content = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(file_type="stl")
    assert isinstance(content, bytes)
    return content


def parse_stl(content: bytes, origin: str = "lens.stl") -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm), equal ones merged, and triangles of an STL file's bytes.

    Raises :class:`InputError` unless they hold a mesh; ``origin`` names the file in the message.
    """
    import trimesh

    try:
        body = trimesh.load_mesh(io.BytesIO(content), file_type="stl", process=False)
    except Exception as error:  # the reader raises many kinds; the cause is always the file
        raise InputError(f"{origin}: not readable as STL ({error}); run `lensforge export` again") from None
    if len(getattr(body, "faces", ())) == 0:
        raise InputError(f"{origin}: holds no triangles; run `lensforge export` again")
    vertices, index = np.unique(np.asarray(body.vertices, dtype=np.float64), axis=0, return_inverse=True)
    return vertices, index.reshape(-1)[np.asarray(body.faces)]


def threemf_bytes(mesh: BodyMesh, product: str) -> bytes:
    """A 3MF file of ``mesh`` as one object; each named face is a triangle set of it."""
    import lib3mf

    library = lib3mf.get_wrapper()
    model = library.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    body = model.AddMeshObject()
    body.SetName(product)
    body.SetGeometry(
        _as_structs(mesh.vertices.astype(np.float32), lib3mf.Position),
        _as_structs(mesh.triangles.astype(np.uint32), lib3mf.Triangle),
    )
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

    return file_bytes("lens.3mf", write)


def parse_3mf(content: bytes, origin: str = "lens.3mf") -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm) and triangles of the one object in a 3MF file's bytes.

    Raises :class:`InputError` for anything else; ``origin`` names the file in the message.
    """
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    try:
        with temporary_file(content, "lens.3mf") as path:
            reader.ReadFromFile(str(path))
    except lib3mf.ELib3MFException as error:
        raise InputError(f"{origin}: not readable as 3MF ({error}); run `lensforge export` again") from None
    objects = model.GetMeshObjects()
    if model.GetUnit() != lib3mf.ModelUnit.MilliMeter or not objects.MoveNext():
        raise InputError(f"{origin}: holds no mesh in mm; run `lensforge export` again")
    body = objects.GetCurrentMeshObject()
    vertices = np.array([vertex.Coordinates[:] for vertex in body.GetVertices()], dtype=np.float64)
    triangles = np.array([triangle.Indices[:] for triangle in body.GetTriangleIndices()], dtype=np.int64)
    return vertices, triangles


def _as_structs(rows: np.ndarray, struct: type[ctypes.Structure]) -> Any:
    return (struct * len(rows)).from_buffer_copy(np.ascontiguousarray(rows).tobytes())
