"""First hits of the grid against trimesh's own ray cast, slow and independent, on a sample of the rays."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree
from trimesh.ray.ray_triangle import ray_triangle_id

from lensforge.optics.media import Media
from lensforge.proof.cast_results import PlainCast
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.refraction import LitRays
from lensforge.proof.sequential_cast import MeshBody, at_faces, outside_leg
from lensforge.results.child_pool import IN_TURN, ChildPool
from lensforge.sources.ray_bundle import RayBundle

_BALLS = 1.0 + 1e-6  # of the radii, squared
_ROUNDING = 1e-12  # of the size of the mesh, squared
_BLOCK = 64  # triangles near each other, around which a ball is looked at first: of 256 a cast takes half longer
AGREE_MM = 1e-6  # both compute the same plane intersection; only the last digits may differ


def cast_plain(
    part: PartMesh, grid: Grid, rays: RayBundle, media: Media, count: int, second: ChildPool = IN_TURN
) -> Callable[[], PlainCast]:
    """Begin to cast ``count`` rays, evenly picked, by trimesh and by ``grid``: from the source, and on from their hit.

    trimesh casts them in ``second``, if given; the returned function waits for it.
    """
    rows = np.unique(np.linspace(0, len(rays) - 1, min(count, len(rays))).astype(np.int64))
    outside = outside_leg(rays, part.optical).take(rows)
    light = LitRays.of(rays, media, part.optical.names).take(rows)
    entry = MeshBody(part, grid).surface_hits(outside)
    entered = np.nonzero(entry.found)[0]
    entry = entry.take(entered)
    inside = Leg(entry.points, at_faces(part.optical, media, light.take(entered), entry).bent, entry.skins)
    bare = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)  # what others have cached stays here
    legs = outside, inside
    cast = second.call(_distances, bare, legs)

    def found() -> PlainCast:
        wrong = sum(_disagreements(plain, grid, leg) for plain, leg in zip(cast.result(), legs, strict=True))
        return PlainCast(rays=len(rows), casts=len(rows) + len(entered), disagreements=wrong)

    return found


def _distances(mesh: trimesh.Trimesh, legs: tuple[Leg, ...]) -> list[Float[np.ndarray, " n"]]:
    plain = PlainCaster(mesh)
    return [plain.distances(leg) for leg in legs]


def _disagreements(plain: Float[np.ndarray, " n"], grid: Grid, leg: Leg) -> int:
    if len(leg.origins) == 0:
        return 0
    quick = grid.first_hits(leg).distances
    both = np.isfinite(plain) & np.isfinite(quick)
    apart = np.abs(np.where(both, plain, 0.0) - np.where(both, quick, 0.0)) > AGREE_MM
    return int(np.sum(apart | (np.isfinite(plain) != np.isfinite(quick))))


class PlainCaster:
    """trimesh's own ray cast, never Embree, except for its choice of triangles: those whose balls a line meets.

    trimesh takes all triangles in the box of the whole ray, 31,000 of 500,000, and tests each of them.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._triangles = np.asarray(mesh.triangles)
        self._normals = np.asarray(mesh.face_normals)
        self._bounds = mesh.bounds
        self._centres = self._triangles.mean(axis=1)
        self._reach = np.linalg.norm(self._triangles - self._centres[:, None], axis=2).max(axis=1)
        order = cKDTree(self._centres).indices  # neighbours stand together
        self._blocks = np.pad(order, (0, -len(order) % _BLOCK), mode="edge").reshape(-1, _BLOCK)
        self._middles = self._centres[self._blocks].mean(axis=1)
        away = np.linalg.norm(self._centres[self._blocks] - self._middles[:, None], axis=2)
        self._around = (away + self._reach[self._blocks]).max(axis=1)

    def distances(self, leg: Leg) -> Float[np.ndarray, " n"]:
        """Distance (mm) of each ray's first hit; infinite where there is none."""
        nearest = np.full(len(leg.origins), np.inf)
        for row in range(len(nearest)):
            origin = leg.origins[row : row + 1]
            direction = leg.directions[row : row + 1]
            near = self._blocks[self._met(self._middles, self._around, origin, direction)].ravel()
            near = near[self._met(self._centres[near], self._reach[near], origin, direction)]
            listed = _Listed(near, self._bounds)
            points = ray_triangle_id(self._triangles[near], origin, direction, self._normals[near], listed)[2]
            distance = (np.reshape(points, (-1, 3)) - origin) @ direction[0]
            nearest[row] = distance[distance > leg.beyond[row]].min(initial=np.inf)
        return nearest

    def _met(
        self,
        centres: Float[np.ndarray, "k 3"],
        reach: Float[np.ndarray, " k"],
        origin: Float[np.ndarray, "1 3"],
        direction: Float[np.ndarray, "1 3"],
    ) -> Bool[np.ndarray, " k"]:
        """True for the balls that a line meets."""
        away = centres - origin
        most = (_BALLS * reach) ** 2 + _ROUNDING * float(np.sum((self._bounds[1] - self._bounds[0]) ** 2))
        return np.einsum("ti,ti->t", away, away) - (away @ direction[0]) ** 2 <= most


@dataclass(frozen=True)
class _Listed:
    """Triangles that are already candidates, in the form of the tree that trimesh queries."""

    near: Int[np.ndarray, " k"]
    bounds: Float[np.ndarray, "2 3"]

    def intersection(self, _: Float[np.ndarray, " 6"]) -> Iterable[int]:
        """All candidates."""
        return range(len(self.near))
