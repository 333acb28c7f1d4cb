"""Closed bodies of a STEP, STL or 3MF file as triangles, read in a child process, as the file comes from outside."""

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.results.file_bounds import read_3mf, stl_corners
from lensforge.results.files import MIB, read_file, read_json, temporary_folder, write_json
from lensforge.results.sandbox import ChildLimits, serve, work_in_child

CHORD_MM = 1e-2  # distance of the triangles from curved faces of a STEP file
ANGLE_RAD = 0.1  # between neighbouring facets of a curved face
_MOST_MIB = 128
_MOST_TRIANGLES = 1_000_000
_LIMITS = ChildLimits(memory_mib=2400, seconds=120.0)
_REMEDY = "repair it in CAD, and export closed bodies as STEP, or as STL or 3MF in mm"
_FILE = "solid"
_JOB = "job.json"
_READ = "read.npz"
_FLAT = 1e-9  # of a length: rounding of two normals that are alike
_DIGITS = 9  # of a mm: vertices of two faces on their common edge are equal


class SolidMesh(NamedTuple):
    """Vertices (mm) and triangles of closed bodies."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]


def read_solid(path: Path, angle_rad: float = ANGLE_RAD) -> SolidMesh:
    """The bodies in the file at ``path``; the same object for the same content.

    ``angle_rad``: between neighbouring facets of a curved face of a STEP file, at most.
    Raises :class:`InputError`, one line, for a missing file, for anything but STEP, STL and 3MF, for bodies that are
    not closed, and for more than a million triangles.
    """
    return _read(read_file(path, missing="the spec names it", most_bytes=_MOST_MIB * MIB), str(path), angle_rad)


@lru_cache(maxsize=4)
def _read(content: bytes, origin: str, angle_rad: float) -> SolidMesh:
    with temporary_folder(_FILE) as folder:
        (folder / _FILE).write_bytes(content)
        write_json(folder / _JOB, {"origin": origin, "angle_rad": angle_rad})
        work_in_child(Path(__file__).resolve(), folder, _LIMITS, origin=origin, remedy=_REMEDY)
        with np.load(folder / _READ) as read:
            return SolidMesh(read["vertices"], read["triangles"])


def _write_mesh(folder: Path) -> None:
    """Work of the child process: the closed mesh of the file in ``folder``."""
    job = read_json(folder / _JOB)
    origin = job["origin"]
    path = folder / _FILE
    start = path.read_bytes()[:1024]
    if b"ISO-10303-21" in start:
        corners = _step_corners(path, origin, job["angle_rad"])
    elif start.startswith(b"PK"):
        mesh = SolidMesh(*read_3mf(path, origin, _REMEDY))
        corners = mesh.vertices[mesh.triangles]
    else:
        corners = stl_corners(path.read_bytes(), origin, _REMEDY)
    if len(corners) > _MOST_TRIANGLES:
        raise InputError(
            f"{origin}: {len(corners)} triangles, at most {_MOST_TRIANGLES} are read; export it more coarsely"
        )
    mesh = merged(corners)
    _require_closed(mesh, origin)
    np.savez(folder / _READ, vertices=mesh.vertices, triangles=mesh.triangles)


def _step_corners(path: Path, origin: str, angle_rad: float) -> Float[np.ndarray, "t 3 3"]:
    from lensforge.surfaces.step_file import parts_of, products_in

    solids = [solid for product in products_in(path, origin, _REMEDY) for solid in parts_of(product.shape, "SOLID")]
    if not solids:
        raise InputError(f"{origin}: holds no solid; {_REMEDY}")
    meshes = [tessellated(solid, CHORD_MM, angle_rad) for solid in solids]
    return np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])


def tessellated(shape: Any, chord_mm: float, angle_rad: float = ANGLE_RAD) -> SolidMesh:
    """Mesh of a solid (TopoDS_Shape) by the CAD kernel, face by face, equal vertices on shared edges merged."""
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    from lensforge.surfaces.step_file import parts_of

    BRepMesh_IncrementalMesh(shape, chord_mm, False, angle_rad)
    return merged(np.concatenate([_face_corners(face) for face in parts_of(shape, "FACE")]))


def _face_corners(face: Any) -> Float[np.ndarray, "t 3 3"]:
    """Corners of the triangles of a face (TopoDS_Face), facing out of its solid."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None:
        return np.zeros((0, 3, 3))
    move = location.Transformation()
    nodes = (mesh.Node(number + 1).Transformed(move) for number in range(mesh.NbNodes()))
    places = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
    triangles = np.array([mesh.Triangle(number + 1).Get() for number in range(mesh.NbTriangles())]) - 1
    if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        triangles = triangles[:, ::-1]
    return np.asarray(places[triangles])


def merged(corners: Float[np.ndarray, "t 3 3"]) -> SolidMesh:
    """The mesh of triangles whose equal corners are one vertex; those without area are left out."""
    vertices, numbers = np.unique(np.round(corners.reshape(-1, 3), _DIGITS) + 0.0, axis=0, return_inverse=True)
    triangles = numbers.reshape(-1, 3)
    return SolidMesh(vertices, triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)])


def open_edges(mesh: SolidMesh) -> int:
    """Number of edges that do not join two triangles, or as many of one sense as of the other."""
    ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    sense = np.where(ends[:, 0] < ends[:, 1], 1, -1)
    _, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    return int((np.bincount(edge.ravel(), sense) != 0).sum())


def rims_of(mesh: SolidMesh) -> Float[np.ndarray, "e 2 3"]:
    """Ends (mm) of the edges in which a mesh is not flat: all at which it may end, as it is seen from anywhere."""
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, edge, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(edges), 3))
    np.add.at(sums, edge.ravel(), np.repeat(normals, 3, axis=0))
    flat = np.linalg.norm(sums, axis=1) > (1.0 - _FLAT) * count  # all normals there are alike
    return np.asarray(mesh.vertices[edges[~flat]])


def _require_closed(mesh: SolidMesh, origin: str) -> None:
    count = open_edges(mesh)
    if count or not len(mesh.triangles):
        raise InputError(f"{origin}: its bodies are not closed, {count} edges bound no body; {_REMEDY}")


if __name__ == "__main__":
    serve(_write_mesh)
