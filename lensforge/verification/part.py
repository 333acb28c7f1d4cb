"""The exported part as a stranger sees it: a closed triangle mesh, its smooth faces, and normals of its own.

Nothing is known here of the design: faces are found by their sharp edges, normals from the mesh's vertices.
"""

import io
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lensforge.errors import InputError
from lensforge.verification.normals import VertexFit, fit_vertices

# Facets that meet at a larger angle belong to different faces; a mesh of a lens bends by a few degrees at most.
CREASE_RAD = np.deg2rad(30.0)


@dataclass(frozen=True)
class Part:
    """A closed body; lengths in mm, normals point out of the material.

    ``faces`` numbers the smooth face that each triangle belongs to. ``fit`` has one row for each vertex and face that
    meet there, ``corners`` the rows of it at the corners of each triangle.
    """

    mesh: trimesh.Trimesh
    faces: Int[np.ndarray, " t"]
    corners: Int[np.ndarray, "t 3"]
    fit: VertexFit

    @property
    def open_edges(self) -> int:
        """Edges that do not join exactly two triangles of the same sense; 0 for a closed body."""
        edges = self.mesh.edges
        count = len(self.mesh.vertices)
        forth, back = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
        senses, times = np.unique(forth, return_counts=True)
        return int(np.sum(times > 1) + np.sum(~np.isin(senses, back)))

    def curved(
        self, triangles: Int[np.ndarray, " n"], barycentric: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points and unit normals of the curved surface over points of the flat ``triangles``.

        Both blend what the three corners foretell. Half of a linear forecast is exact for a quadratic function, so
        the height over the facet is half of the blended heights of the tangent planes, where a flat facet is off by
        its sagitta; and the normals get half of their bend towards the point, where the mere blend cuts the corner.
        """
        corners = self.mesh.triangles[triangles]
        rows = self.corners[triangles]
        normals = self.fit.normals[rows]
        flat = np.einsum("nk,nki->ni", barycentric, corners)
        away = flat[:, None] - corners
        heights = np.einsum("nki,nki->nk", -away, normals)
        points = flat + 0.5 * np.einsum("nk,nk,nki->ni", barycentric, heights, normals)
        bent = normals + 0.5 * (self.fit.bends[rows] @ away[..., None])[..., 0]
        blended = np.einsum("nk,nki->ni", barycentric, bent)
        return points, blended / np.linalg.norm(blended, axis=1, keepdims=True)


def read_part(stl: bytes) -> Part:
    """Read the bytes of an STL file (mm), merge equal vertices, find its smooth faces and their normals.

    Raises :class:`InputError` for bytes that hold no triangles.
    """
    try:
        mesh = trimesh.load_mesh(io.BytesIO(stl), file_type="stl", process=True)
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        raise InputError(f"STL: not readable as a mesh ({error}); export it again") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0 or not np.isfinite(mesh.vertices).all():
        raise InputError("STL: holds no triangles; export it again")
    return part_of(mesh)


def part_of(mesh: trimesh.Trimesh) -> Part:
    """The part that a mesh with merged vertices bounds."""
    faces = smooth_faces(mesh)
    keys, corners = np.unique(mesh.faces.astype(np.int64) * (faces.max() + 1) + faces[:, None], return_inverse=True)
    corners = corners.reshape(-1, 3)
    vertices, face_of = np.divmod(keys, faces.max() + 1)
    return Part(mesh, faces, corners, fit_vertices(mesh.vertices[vertices], corners, face_of))


def smooth_faces(mesh: trimesh.Trimesh) -> Int[np.ndarray, " t"]:
    """Number of the smooth face of each triangle: a face ends at creases, and at z = 0, where lens and base meet."""
    above = mesh.triangles_center[:, 2] > 0.0
    pairs = mesh.face_adjacency
    joined = (mesh.face_adjacency_angles < CREASE_RAD) & (above[pairs[:, 0]] == above[pairs[:, 1]])
    first, second = pairs[joined].T
    count = len(mesh.faces)
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    numbers: Int[np.ndarray, " t"] = connected_components(graph, directed=False)[1].astype(np.int64)
    return numbers
