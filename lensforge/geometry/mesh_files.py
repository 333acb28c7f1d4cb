"""STL and 3MF files of the mesh, in mm: written to bytes, and parsed from them.

STL is in single precision and repeats every vertex in each of its triangles; 3MF keeps shared vertices, unit and face
names. The same mesh gives the same bytes: the identifiers that 3MF needs are hashes of the content.

Bytes that come from a file are read within bounds, 3MF in a child process, since its library is C++; bytes that this
process made are read at once.
"""

import hashlib
import uuid
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.files import file_bytes, read_json, temporary_file, temporary_folder, write_json
from lensforge.geometry.mesh import BodyMesh
from lensforge.geometry.threemf_arrays import geometry_of, set_geometry
from lensforge.untrusted.archives import require_small_3mf
from lensforge.untrusted.child import ChildLimits, serve, work_in_child
from lensforge.untrusted.own_content import made_here, remembered
from lensforge.untrusted.stl import MOST_MM, MOST_TRIANGLES, stl_corners

_AGAIN = "run `lensforge export` again"
_THREEMF, _JOB = "lens.3mf", "job.json"
# A mesh of 0.2 million triangles takes 0.2 GiB, and 5 s on a busy machine.
_LIMITS = ChildLimits(memory_mib=1800, seconds=60.0)
_DECIMALS = 9  # of a mm in 3MF, whose vertices are single precision: 1e-6 mm at lens size


def stl_bytes(mesh: BodyMesh) -> bytes:
    """An STL file of ``mesh``; shared vertices have equal coordinates in it."""
    import trimesh

    content = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(file_type="stl")
    assert isinstance(content, bytes)
    return remembered(content)


def parse_stl(content: bytes, origin: str = "lens.stl") -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm), equal ones merged, and triangles of an STL file's bytes.

    Raises :class:`InputError` unless they hold a mesh; ``origin`` names the file in the message.
    """
    corners = stl_corners(content, origin, _AGAIN, None if made_here(content) else MOST_TRIANGLES)
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, index.reshape(-1, 3)


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


def parse_3mf(content: bytes, origin: str = "lens.3mf") -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mm) and triangles of the one object in a 3MF file's bytes.

    Raises :class:`InputError` for anything else; ``origin`` names the file in the message.
    """
    if made_here(content):
        with temporary_file(content, _THREEMF) as path:
            return _read_3mf(path, origin)
    require_small_3mf(content, origin, _AGAIN)
    with temporary_folder(origin) as folder:
        (folder / _THREEMF).write_bytes(content)
        write_json(folder / _JOB, {"origin": origin})
        work_in_child(Path(__file__).resolve(), folder, _LIMITS, origin=origin, remedy=_AGAIN)
        vertices, triangles = np.load(folder / "vertices.npy"), np.load(folder / "triangles.npy")
    return vertices, triangles


def _read_3mf(path: Path, origin: str) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    try:
        reader.ReadFromFile(str(path))
    except lib3mf.ELib3MFException as error:
        raise InputError(f"{origin}: not readable as 3MF ({error}); {_AGAIN}") from None
    objects = model.GetMeshObjects()
    if model.GetUnit() != lib3mf.ModelUnit.MilliMeter or not objects.MoveNext():
        raise InputError(f"{origin}: holds no mesh in mm; {_AGAIN}")
    body = objects.GetCurrentMeshObject()
    if not 0 < body.GetTriangleCount() <= MOST_TRIANGLES:
        raise InputError(f"{origin}: {body.GetTriangleCount()} triangles, 1 to {MOST_TRIANGLES} are read; {_AGAIN}")
    vertices, triangles = geometry_of(body)
    if not float(np.abs(vertices).max()) <= MOST_MM:
        raise InputError(f"{origin}: a vertex lies beyond {MOST_MM:g} mm; {_AGAIN}")
    return vertices, triangles


def _write_arrays(folder: Path) -> None:
    """Work of the child process: the arrays of the 3MF file in ``folder``."""
    vertices, triangles = _read_3mf(folder / _THREEMF, read_json(folder / _JOB)["origin"])
    np.save(folder / "vertices.npy", vertices)
    np.save(folder / "triangles.npy", triangles)


if __name__ == "__main__":
    serve(_write_arrays)
