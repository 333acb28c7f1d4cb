"""The exported part read from its STL alone: a closed mesh, its smooth faces, its vertex normals, and its size.

Nothing of the design is used: faces are found by their sharp edges, normals by a local polynomial fit to the mesh's
vertices. Averages of facet normals do not suffice: they lean inward at a rim, where facets lie on one side only, by
6 mrad on a lens of 100,000 triangles.

Flat facets change the size. The facets of another program have another chord error, which follows from the mesh itself:
two facets that meet at a small angle lie on one curved face, whose radius is their breadth over that angle.
"""

from dataclasses import dataclass
from functools import cached_property
from threading import Lock

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lensforge.errors import InputError
from lensforge.proof.cast_results import SizedFile
from lensforge.proof.file_form import open_edges
from lensforge.proof.optical_faces import FAR_MM, NO_FACE, USUAL_LENS, OpticalFaces, PlateOfLenses
from lensforge.results import BodySize, Box
from lensforge.results.file_bounds import MOST_TRIANGLES, made_here, stl_corners

# Facets that meet at a larger angle belong to different faces; a mesh of a lens bends by a few degrees at most.
CREASE_RAD = np.deg2rad(30.0)
LEVEL_MM = 1e-4  # what is nearer to z = 0 lies there, in single precision too
NEIGHBOURS = 48  # for 20 terms: fewer leave an irregular mesh undetermined, more reach over the surface's own detail
_LEANS = 1e-4  # z of the normals of a wall with draft
_MOST_LEANING = 0.5  # a face that is round both ways has more
_EVEN = 4.0  # the broadest facet of a round wall over the narrowest: 1.2 of a design's, hundreds at flat sides


@dataclass(eq=False)
class VertexFit:
    """Local shape at each of the ``places`` (mm): unit normals, and derivatives of the height over the tangent plane.

    A quintic is fitted around a vertex when it is first asked for: of a plate a tenth is met by rays. ``normals``: of
    the facets around each, which tell the outside. ``faces`` numbers the smooth face of each vertex; neighbours are
    taken from the same face only. On those of ``walls`` no polynomial is fitted, and the normals stay.
    """

    places: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, " k"]
    walls: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        self._shapes = np.zeros((len(self.places), 13))
        order = np.argsort(self.faces, kind="stable")
        ends = np.cumsum(np.bincount(self.faces))[:-1]
        # A few facets, such as those of a box, keep the mean of their normals.
        groups = {k: rows for k, rows in enumerate(np.split(order, ends)) if k not in self.walls}
        self._members = {k: rows for k, rows in groups.items() if len(rows) >= NEIGHBOURS}
        self._left = np.isin(self.faces, list(self._members))
        self._trees = dict[int, cKDTree]()
        self._lock = Lock()

    def at(self, rows: Int[np.ndarray, "*n"]) -> tuple[Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 13"]]:
        """Unit normals at some of the vertices, and their shapes.

        A shape is two tangent vectors f and g, and derivatives (1/mm, 1/mm^2) of the height by the places x and y along
        them: xx, xy, yy, xxx, xxy, xyy, yyy.
        """
        wanted = np.zeros(len(self.places), dtype=bool)
        wanted[rows] = True
        with self._lock:  # threads trace blocks of rays, and a vertex is fitted once
            self._fit(np.flatnonzero(wanted & self._left))
        return self.normals[rows], self._shapes[rows]

    @property
    def fitted(self) -> Float[np.ndarray, "k 3"]:
        """Unit normals at all of the vertices."""
        return self.at(np.arange(len(self.places)))[0]

    def _fit(self, rows: Int[np.ndarray, " n"]) -> None:
        from lensforge.proof.vertex_fit import fit_polynomials, fit_space

        space = fit_space(NEIGHBOURS)
        numbers = self.faces[rows]
        for number in np.unique(numbers).tolist():
            members = self._members[number]
            if number not in self._trees:
                self._trees[number] = cKDTree(self.places[members])
            vertices = rows[numbers == number]
            near = members[self._trees[number].query(self.places[vertices], k=NEIGHBOURS)[1]]
            fit_polynomials(self.places, vertices, near, self.normals, self._shapes, space)
        self._left[rows] = False


@dataclass(frozen=True)
class PartMesh:
    """A closed body as a triangle mesh; lengths in mm, normals point out of the material.

    ``fit`` has a row for each vertex and smooth face that meet there, ``corners`` its rows at each triangle's corners.
    ``faces``: number of the optical face, of ``optical``, to which each triangle belongs; ``far``: how many lie far
    from every face of the design.
    """

    mesh: trimesh.Trimesh
    corners: Int[np.ndarray, "t 3"]
    fit: VertexFit
    optical: OpticalFaces
    faces: Int[np.ndarray, " t"]
    far: int

    @cached_property
    def open_edges(self) -> int:
        """Edges that do not join exactly two triangles of the same sense; 0 for a closed body."""
        return open_edges(self.mesh.faces, len(self.mesh.vertices))

    def curved(
        self, triangles: Int[np.ndarray, " n"], barycentric: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points and unit normals of the curved surface over points of the flat ``triangles``.

        Both are interpolated from the three corners. Half of a linear extrapolation is exact for a quadratic function,
        two thirds of it with a third of the quadratic term for a cubic one: the height over the facet (its sag) is half
        of the interpolated heights of the corners' tangent planes, and so are the normals those of a quartic height.
        """
        corners = self.mesh.triangles[triangles]
        rows = self.corners[triangles]
        normals, shapes = self.fit.at(rows)
        flat = np.einsum("nk,nki->ni", barycentric, corners)
        away = flat[:, None] - corners
        heights = np.einsum("nki,nki->nk", -away, normals)
        points = flat + 0.5 * np.einsum("nk,nk,nki->ni", barycentric, heights, normals)
        f = shapes[..., :3]
        g = shapes[..., 3:6]
        (xx, xy, yy, xxx, xxy, xyy, yyy) = np.moveaxis(shapes[..., 6:], -1, 0)
        x, y = np.sum(away * f, axis=-1), np.sum(away * g, axis=-1)
        along = (2.0 * (xx * x + xy * y) + 0.5 * (xxx * x * x + 2.0 * xxy * x * y + xyy * y * y)) / 3.0
        across = (2.0 * (xy * x + yy * y) + 0.5 * (xxy * x * x + 2.0 * xyy * x * y + yyy * y * y)) / 3.0
        bent = normals - along[..., None] * f - across[..., None] * g
        blended = np.einsum("nk,nki->ni", barycentric, bent)
        return points, blended / np.linalg.norm(blended, axis=1, keepdims=True)


def read_part_mesh(stl: bytes, optical: OpticalFaces = USUAL_LENS) -> PartMesh:
    """Read the bytes of an STL file (mm), merge equal vertices, find its smooth faces and their normals.

    ``optical``: the faces that it should have. Raises :class:`InputError` for bytes that hold no triangles, too many,
    or none that has an area.
    """
    mesh = read_mesh(stl, "STL", optical.plate)
    if not (mesh.area_faces > 0.0).any():
        raise InputError("STL: none of its triangles has an area; export it again")
    return part_mesh_of(mesh, optical)


def read_mesh(stl: bytes, origin: str, plate: PlateOfLenses | None = None) -> trimesh.Trimesh:
    """Read the bytes of an STL file, of a ``plate`` in the coordinates of its lit lens, and merge equal vertices.

    Raises :class:`InputError`, in which ``origin`` names the file, for bytes that hold no triangles, or too many.
    """
    corners = stl_corners(stl, origin, "export it again", None if made_here(stl) else MOST_TRIANGLES).reshape(-1, 3)
    rows = np.arange(len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(corners if plate is None else plate.from_lit(corners), rows, process=True)


def part_mesh_of(mesh: trimesh.Trimesh, optical: OpticalFaces = USUAL_LENS) -> PartMesh:
    """Build the part that a mesh with merged vertices bounds."""
    numbers, apart = optical.sorted(mesh.triangles_center, mesh.face_normals)
    faces = smooth_faces(mesh, None if optical.inverse_radii is None else numbers)
    bare = numbers == NO_FACE
    if optical.plate is None:  # all neighbours on a tall wall stand on one ring: where it leans, that tells no slope
        highest = np.zeros(faces.max() + 1)
        np.maximum.at(highest, faces, np.abs(mesh.face_normals[:, 2]))
        bare &= ((highest > _LEANS) & (highest < _MOST_LEANING))[faces]
    even = _evenly_broad(mesh, faces)
    flat = bare & ~even
    drawn = ~bare & _drawn_along_y(mesh, faces)
    walls = frozenset(faces[(bare & even) | drawn].tolist())
    faces[flat] = faces.max() + 1 + np.arange(np.count_nonzero(flat))
    keys, corners = np.unique(mesh.faces.astype(np.int64) * (faces.max() + 1) + faces[:, None], return_inverse=True)
    corners = corners.reshape(-1, 3)
    vertices, face_of = np.divmod(keys, faces.max() + 1)
    places = np.ascontiguousarray(mesh.vertices[vertices], dtype=np.float64)
    fit = VertexFit(places, facet_average(places, corners), face_of, walls)
    return PartMesh(mesh, corners, fit, optical, numbers, int(np.sum(apart > FAR_MM)))


def smooth_faces(mesh: trimesh.Trimesh, optical: Int[np.ndarray, " t"] | None = None) -> Int[np.ndarray, " t"]:
    """Number of the smooth face of each triangle; faces end at creases, and at z = 0, where lens and base meet.

    ``optical``: number of each triangle's optical face, which ends at shallow creases, too.
    """
    parts = mesh.triangles_center[:, 2] > 0.0 if optical is None else optical
    pairs = mesh.face_adjacency
    joined = (mesh.face_adjacency_angles < CREASE_RAD) & (parts[pairs[:, 0]] == parts[pairs[:, 1]])
    first, second = pairs[joined].T
    count = len(mesh.faces)
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _drawn_along_y(mesh: trimesh.Trimesh, faces: Int[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
    """True for triangles of faces that are drawn along y: strips from end to end, whose vertices tell no slope there.

    The mean of the normals of two strips is that between them.
    """
    steepest = np.zeros(faces.max() + 1)
    np.maximum.at(steepest, faces, np.abs(mesh.face_normals[:, 1]))
    return (steepest < _LEANS)[faces]


def _evenly_broad(mesh: trimesh.Trimesh, faces: Int[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
    """True for triangles of walls whose facets are about equally broad: the mean of two is the normal between them.

    Where sides turn from flat to round without a crease, it would tilt the ends of a flat one by half of that turn.
    """
    x, y = mesh.face_normals[:, :2].T
    breadths = np.ptp(np.einsum("tki,ti->tk", mesh.triangles[:, :, :2], np.column_stack([-y, x])), axis=1)
    narrowest = np.full(faces.max() + 1, np.inf)
    broadest = np.zeros(faces.max() + 1)
    np.minimum.at(narrowest, faces, breadths)
    np.maximum.at(broadest, faces, breadths)
    return ((narrowest > 0.0) & (broadest < _EVEN * narrowest))[faces]


def facet_average(vertices: Float[np.ndarray, "k 3"], triangles: Int[np.ndarray, "t 3"]) -> Float[np.ndarray, "k 3"]:
    """Mean of the facet normals around each vertex by Max's weights, exact where all vertices lie on a sphere.

    N. Max, "Weights for computing vertex normals from facet normals", J. Graphics Tools 4 (1999).
    """
    corners = vertices[triangles]
    weighted = np.empty_like(corners)
    for corner in range(3):
        left = corners[:, (corner + 1) % 3] - corners[:, corner]
        right = corners[:, (corner + 2) % 3] - corners[:, corner]
        lengths = np.sum(left * left, axis=1) * np.sum(right * right, axis=1)
        weighted[:, corner] = np.cross(left, right) / np.maximum(lengths, np.finfo(float).tiny)[:, None]
    columns = weighted.transpose(2, 1, 0).reshape(3, -1)
    rows = triangles.T.ravel()
    total = np.stack([np.bincount(rows, column, len(vertices)) for column in columns], axis=1)
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.maximum(lengths, np.finfo(float).tiny)


def as_box(corners: Float[np.ndarray, "2 3"]) -> Box:
    """Least and largest corner as plain numbers."""
    (x0, y0, z0), (x1, y1, z1) = corners.tolist()
    return (x0, y0, z0), (x1, y1, z1)


def sized_mesh(mesh: trimesh.Trimesh) -> SizedFile:
    """Size of a closed mesh (mm), and bounds of the error of its facets, by the angles between them.

    Over an equilateral facet of height h on a sphere of radius R the sphere rises to 2 h^2 / (9 R), and its neighbours
    turn by 2 h / (3 R): so by h / 3 times that angle; over the strip of a cylinder by h / 8 times it. The facets of a
    sphere lack 0.6 of the square of that angle of their area, and flat faces the segments cut off by the chords of
    their rims.
    """
    ends = mesh.vertices[mesh.face_adjacency_edges]
    between = (np.abs(ends[:, :, 2]) < LEVEL_MM).all(axis=1)  # at z = 0 lens and base meet, at any angle
    smooth = (mesh.face_adjacency_angles < CREASE_RAD) & ~between
    pairs = mesh.face_adjacency[smooth]
    angles = mesh.face_adjacency_angles[smooth]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    heights = 2.0 * mesh.area_faces[pairs] / np.maximum(lengths[smooth], np.finfo(float).tiny)[:, None]
    rises = np.zeros(len(mesh.faces))
    turns = np.zeros(len(mesh.faces))
    np.maximum.at(rises, pairs, angles[:, None] * heights / 3.0)
    np.maximum.at(turns, pairs, angles[:, None])
    at_rims = rises[mesh.face_adjacency[~smooth]].max(axis=1)
    return SizedFile(
        size=BodySize(volume_mm3=float(mesh.volume), area_mm2=float(mesh.area), bounds_mm=as_box(mesh.bounds)),
        chord_mm=float(rises.max(initial=0.0)),
        facets_mm3=float(mesh.area_faces @ rises),
        facets_mm2=float(mesh.area_faces @ turns**2 + lengths[~smooth] @ at_rims),
    )
