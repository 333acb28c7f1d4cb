from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lens_meshes import lambertian, lens_mesh, sphere

from lensforge.optics.media import Media
from lensforge.proof import trimesh_cast
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.trimesh_cast import PlainCaster, cast_plain


def test_plain_path_is_not_embree():
    assert trimesh_cast.ray_triangle_id.__module__ == "trimesh.ray.ray_triangle"


def _leg(count: int, size: float, beyond: float) -> Leg:
    """Rays from in and around a body; the first along the axes, where a box of a ray has no width."""
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(count, 3))
    directions[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Leg(rng.uniform(-size, size, (count, 3)), directions, np.full(count, beyond))


@pytest.mark.parametrize("beyond", [0.0, 4.0])
@pytest.mark.parametrize(
    "mesh",
    [
        lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 10, (4.0, 1.0)),
        trimesh.creation.box((20.0, 12.0, 8.0)),  # triangles larger than the pieces of a ray
    ],
    ids=["lens", "box"],
)
def test_the_triangles_near_a_ray_give_the_hits_of_all_triangles(mesh: trimesh.Trimesh, beyond: float) -> None:
    leg = _leg(400, 12.0, beyond)
    whole = trimesh.ray.ray_triangle.RayMeshIntersector(mesh)
    points, ray, _ = whole.intersects_location(leg.origins, leg.directions, multiple_hits=True)
    distance = np.sum((points - leg.origins[ray]) * leg.directions[ray], axis=1)
    expected = np.full(len(leg.origins), np.inf)
    np.minimum.at(expected, ray[distance > beyond], distance[distance > beyond])
    found = PlainCaster(mesh).distances(leg)
    assert np.array_equal(np.isfinite(found), np.isfinite(expected)) and 20 < np.isfinite(found).sum() < 400
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def test_a_grid_that_is_wrong_is_noticed(monkeypatch):
    part = part_mesh_of(lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 10))
    grid, rays = Grid(part.mesh), lambertian(400, 1.0)
    found = cast_plain(part, grid, rays, Media(1.5), 50)()
    assert (found.rays, found.casts, found.disagreements) == (50, 100, 0)
    honest = Grid.first_hits

    def shifted(self, leg):
        hits = honest(self, leg)
        return replace(hits, distances=hits.distances + 1e-5)

    monkeypatch.setattr(Grid, "first_hits", shifted)
    assert cast_plain(part, grid, rays, Media(1.5), 50)().disagreements == 100
