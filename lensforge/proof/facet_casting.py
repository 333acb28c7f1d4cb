"""First hits of many rays on a mesh: places on triangles by trimesh, the triangle by a walk through a grid.

trimesh queries an R-tree for all triangles in the bounding box of the whole ray, half of the mesh for a ray through a
lens, and traces a few hundred rays per second. Here a compiled walk through the cells of a uniform grid tests the
triangles of the cells that each ray visits until the first hit.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from trimesh.intersections import planes_lines
from trimesh.triangles import points_to_barycentric

from lensforge.errors import InputError

CELL_EDGES = 1.0  # edge of a cell in typical triangle edges
MAX_CELLS = 4e6  # about this many cells at most: bounds the memory
# Bounds for meshes that somebody has changed, whose triangles may span the whole part. The boxes of all triangles of a
# usual mesh have 3 million cells, and a triangle shares its cells with 70 others; of a lens on a plate of a hundred
# times its width, with 1,000.
_BOX_CELLS = 2e7
_BOX_CELLS_EACH = 16
MOST_TOGETHER = 5000.0


_Rows = TypeVar("_Rows", bound="RayRows")


class RayRows:
    """Base of dataclasses whose fields are arrays with a row for each ray."""

    def take(self: _Rows, rows: Int[np.ndarray, " k"]) -> _Rows:
        """Values of the rays ``rows``."""
        return type(self)(*(values[rows] for values in vars(self).values()))


@dataclass(frozen=True)
class FacetHits(RayRows):
    """First hits: triangle (-1: none), distance along the ray (mm, infinite: none), barycentric coordinates."""

    triangles: Int[np.ndarray, " n"]
    distances: Float[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]

    @property
    def found(self) -> Bool[np.ndarray, " n"]:
        """True for rays that hit a facet."""
        return self.triangles >= 0


class Leg(NamedTuple):
    """Rays to cast: start (mm), unit direction, and distance (mm) within which a hit is the surface just left."""

    origins: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    beyond: Float[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "Leg":
        """Select rays by row."""
        return Leg(*(values[rows] for values in self))


class Grid:
    """Triangles of ``mesh``, listed by the cells of a uniform grid that they touch.

    Raises :class:`InputError` for a mesh whose triangles all lie in each other's way.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.triangles = np.asarray(mesh.triangles, dtype=np.float64)
        self.normals = np.asarray(mesh.face_normals, dtype=np.float64)
        low = self.triangles.min(axis=1)
        high = self.triangles.max(axis=1)
        extent = high.max(axis=0) - low.min(axis=0)
        edge = float(np.sqrt(2.0 * np.median(mesh.area_faces)))
        least = float(extent.max()) / MAX_CELLS  # where half of the triangles have no area
        self.cell = max(CELL_EDGES * edge, float(np.cbrt(extent.prod() / MAX_CELLS)), least)
        most = max(_BOX_CELLS, _BOX_CELLS_EACH * len(self.triangles))
        while self.cell < extent.max() and (
            (extent / self.cell + 2.0).prod() > 2.0 * MAX_CELLS  # a part that is flat, or a line
            or ((high - low) / self.cell + 2.0).prod(axis=1).sum() > most
        ):
            self.cell *= 1.26  # twice the volume
        self.corner = low.min(axis=0) - 0.5 * self.cell
        self.shape = np.ceil((extent + self.cell) / self.cell).astype(np.int64)
        self._sort_into_cells(low, high)
        count = np.diff(self.starts).astype(np.float64)
        together = float(count @ count / count.sum())
        if together > MOST_TOGETHER:
            raise InputError(
                f"STL: each of its triangles lies among {together:.0f} others within {self.cell:.3g} mm, at most "
                f"{MOST_TOGETHER:.0f} can be cast; it is no mesh of a lens, export it again"
            )

    def _sort_into_cells(self, low: Float[np.ndarray, "t 3"], high: Float[np.ndarray, "t 3"]) -> None:
        """List the triangles by the cells of their boxes that their planes cross: counted first, then sorted."""
        from lensforge.proof.grid_walk import CellGrid, FacetBoxes, FacetMesh, sort_into_cells

        pad = 1e-6 * self.cell
        first = np.floor((low - self.corner - pad) / self.cell).astype(np.int64)
        span = np.floor((high - self.corner + pad) / self.cell).astype(np.int64) - first + 1
        reach = 0.5 * self.cell * np.abs(self.normals).sum(axis=1) + pad
        boxed = FacetMesh(self.triangles, self.normals), FacetBoxes(first, span, reach)
        grid = CellGrid(self.corner, self.cell, self.shape)
        counts = np.zeros(int(self.shape.prod()), dtype=np.int64)
        sort_into_cells(*boxed, grid, counts, np.empty(0, dtype=np.int64))
        self.starts = np.concatenate([[0], np.cumsum(counts)])
        self.members = np.empty(self.starts[-1], dtype=np.int64)
        sort_into_cells(*boxed, grid, self.starts[:-1].copy(), self.members)

    def first_hits(self, leg: Leg) -> FacetHits:
        """First hit of each ray."""
        from lensforge.proof.grid_walk import CellGrid, FacetMesh, walk

        numbers = np.empty(len(leg.origins), dtype=np.int64)
        distances = np.empty(len(leg.origins))
        rays = Leg(*(np.ascontiguousarray(values, dtype=np.float64) for values in leg))
        mesh = FacetMesh(self.triangles, self.normals)
        grid = CellGrid(self.corner, self.cell, self.shape)
        walk(rays, mesh, grid, self.starts, self.members, numbers, distances)
        hits = FacetHits(numbers, distances, np.zeros((len(numbers), 3)))
        rows = np.nonzero(hits.found)[0]
        facets = self.triangles[numbers[rows]]
        ways = (leg.origins[rows], leg.directions[rows])
        points, _, distances[rows] = planes_lines(
            facets[:, 0], self.normals[numbers[rows]], *ways, return_distance=True
        )
        hits.barycentric[rows] = points_to_barycentric(facets, points)
        return hits
