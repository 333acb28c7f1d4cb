"""First hits of the grid against trimesh's own ray cast, slow and independent, on a sample of the rays."""

from collections.abc import Callable
from time import perf_counter

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.ray.ray_triangle import RayMeshIntersector

from lensforge.optics.media import Media
from lensforge.sources.bundle import RayBundle
from lensforge.verification.casting import Grid, Leg
from lensforge.verification.coated_face import RefractingFace
from lensforge.verification.part_mesh import PartMesh
from lensforge.verification.passage import cross, outside_leg
from lensforge.verification.proof import PlainCast
from lensforge.workers.second_process import IN_TURN, SecondProcess

_CANDIDATES = 2**20  # triangles tested together: bounds the memory, 2.8 GB where all rays were cast at once
AGREE_MM = 1e-6  # both compute the same plane intersection; only the last digits may differ


def cast_plain(
    part: PartMesh, grid: Grid, rays: RayBundle, media: Media, count: int, second: SecondProcess = IN_TURN
) -> Callable[[], PlainCast]:
    """Begin to cast ``count`` rays, evenly picked, by trimesh and by ``grid``: from the source, and on from their hit.

    trimesh casts them in ``second``, where there is one; the function that is returned waits for it.
    """
    rows = np.unique(np.linspace(0, len(rays) - 1, min(count, len(rays))).astype(np.int64))
    outside, into = outside_leg(rays).take(rows), RefractingFace.inner(rays, media).take(rows)
    entry = grid.first_hits(outside)
    entered = np.nonzero(entry.found)[0]
    inside = cross(part, outside.take(entered), entry.take(entered), into.take(entered)).leg
    bare = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)  # what others have cached stays here
    legs = outside, inside
    cast = second.call(_timed_distances, bare, legs)

    def found() -> PlainCast:
        distances, seconds = cast.result()
        wrong = sum(_disagreements(plain, grid, leg) for plain, leg in zip(distances, legs, strict=True))
        casts = len(rows) + len(entered)
        return PlainCast(rays=len(rows), casts=casts, disagreements=wrong, rate=casts / max(seconds, 1e-9))

    return found


def _timed_distances(mesh: trimesh.Trimesh, legs: tuple[Leg, ...]) -> tuple[list[Float[np.ndarray, " n"]], float]:
    """Distances of the first hits of each leg, and the seconds that they took."""
    mesh.triangles_tree  # noqa: B018  built here, so that it is not timed as casting
    start = perf_counter()
    return [plain_distances(mesh, leg) for leg in legs], perf_counter() - start


def _disagreements(plain: Float[np.ndarray, " n"], grid: Grid, leg: Leg) -> int:
    if len(leg.origins) == 0:
        return 0
    quick = grid.first_hits(leg).distances
    both = np.isfinite(plain) & np.isfinite(quick)
    apart = np.abs(np.where(both, plain, 0.0) - np.where(both, quick, 0.0)) > AGREE_MM
    return int(np.sum(apart | (np.isfinite(plain) != np.isfinite(quick))))


def plain_distances(mesh: trimesh.Trimesh, leg: Leg) -> Float[np.ndarray, " n"]:
    """Distance (mm) of each ray's first hit by trimesh's own ray cast, never Embree; infinite where there is none."""
    nearest = np.full(len(leg.origins), np.inf)
    plain, together = RayMeshIntersector(mesh), max(1, _CANDIDATES // len(mesh.faces))
    for start in range(0, len(nearest), together):
        rows = slice(start, start + together)
        origins, directions = leg.origins[rows], leg.directions[rows]
        points, ray, _ = plain.intersects_location(origins, directions, multiple_hits=True)
        if len(ray):
            distance = np.sum((points - origins[ray]) * directions[ray], axis=1)
            ahead = distance > leg.beyond[rows][ray]
            np.minimum.at(nearest[rows], ray[ahead], distance[ahead])
    return nearest
