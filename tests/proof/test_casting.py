"""First hits on a mesh: the grid and trimesh, against all triangles one by one."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lens_meshes import Quadric, lambertian, lens_mesh, sphere

from lensforge.optics.media import Media, Medium
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.trimesh_cast import PlainCaster, cast_plain


def soup(count):
    """Triangles of all sizes through each other: hits far ahead are found before near ones."""
    rng = np.random.default_rng(7)
    size = 10.0 ** rng.uniform(-1.0, 0.5, (count, 1, 1))
    corners = rng.uniform(-1.0, 1.0, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False)


MESHES = {
    "soup": soup(150),
    "shell": lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 10),
    "on a base": lens_mesh(Quadric((0.2, 0.1, 0.0), (1.0, 0.8, 0.9)).radius, sphere(2.45).radius, 12, (4.0, 1.0)),
    "box": trimesh.creation.box((20.0, 12.0, 8.0)),
}


def scattered(count, size, seed, beyond=0.0):
    """Rays from in and around a body; the first along the axes, where a box of a ray has no width."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    return Leg(rng.uniform(-size, size, (count, 3)), directions, np.full(count, beyond))


@pytest.mark.parametrize("share", [0.0, 0.3], ids=["all", "beyond"])
@pytest.mark.parametrize("name", MESHES)
def test_both_casters_find_the_first_hits_among_all_triangles(name, share):
    """Those of trimesh, which asks every triangle; hits up to the given distance are passed over."""
    mesh = MESHES[name]
    size = mesh.bounds[1].max()
    leg = scattered(300, 1.2 * size, 3, share * size)
    whole = trimesh.ray.ray_triangle.RayMeshIntersector(mesh)
    points, ray, _ = whole.intersects_location(leg.origins, leg.directions, multiple_hits=True)
    distance = np.sum((points - leg.origins[ray]) * leg.directions[ray], axis=1)
    expected = np.full(300, np.inf)
    beyond = distance > share * size
    np.minimum.at(expected, ray[beyond], distance[beyond])
    plain = PlainCaster(mesh).distances(leg)
    hits = Grid(mesh).first_hits(leg)
    assert np.array_equal(np.isfinite(plain), hits.found) and np.array_equal(np.isfinite(expected), hits.found)
    assert 20 < hits.found.sum() < 300 or name == "soup"  # both kinds are there
    np.testing.assert_allclose(plain[hits.found], expected[hits.found], rtol=0, atol=1e-9)
    np.testing.assert_allclose(hits.distances[hits.found], expected[hits.found], rtol=0, atol=1e-9)


def test_hit_lies_on_the_triangle_it_names():
    mesh = MESHES["on a base"]
    leg = scattered(500, 3.0, 4)
    hits = Grid(mesh).first_hits(leg)
    on_triangle = np.einsum("nk,nki->ni", hits.barycentric[hits.found], mesh.triangles[hits.triangles[hits.found]])
    on_ray = (leg.origins + np.where(hits.found, hits.distances, 0.0)[:, None] * leg.directions)[hits.found]
    np.testing.assert_allclose(on_triangle, on_ray, atol=1e-10)


def test_no_ray_slips_between_triangles():
    """From inside one ball, behind which nothing else is hit."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    edges = mesh.vertices[mesh.edges_unique]
    targets = np.concatenate([mesh.vertices, edges.mean(axis=1), (edges * [[[0.3], [0.7]]]).sum(axis=1)])
    origins = np.random.default_rng(6).uniform(-0.5, 0.5, targets.shape)
    away = np.linalg.norm(targets - origins, axis=1)
    hits = Grid(mesh).first_hits(Leg(origins, (targets - origins) / away[:, None], np.zeros(len(targets))))
    assert hits.found.all()
    np.testing.assert_allclose(hits.distances, away, rtol=1e-12)


def test_a_grid_that_is_wrong_is_noticed(monkeypatch):
    part = part_mesh_of(lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 10))
    grid = Grid(part.mesh)
    rays = lambertian(400, 1.0)
    cast = cast_plain(part, grid, rays, Media(Medium(1.5)), 50)()
    assert (cast.rays, cast.casts, cast.disagreements) == (50, 100, 0)
    honest = Grid.first_hits

    def shifted(self, leg):
        hits = honest(self, leg)
        return replace(hits, distances=hits.distances + 1e-5)

    monkeypatch.setattr(Grid, "first_hits", shifted)
    assert cast_plain(part, grid, rays, Media(Medium(1.5)), 50)().disagreements == 100
