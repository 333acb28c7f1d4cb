import numpy as np
import pytest
import trimesh
from lens_meshes import Quadric, lambertian, lens_mesh, sphere

from lensforge.proof import facet_casting
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.proof.trimesh_cast import PlainCaster


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
    "box": trimesh.creation.box((2.0, 3.0, 1.0)),
}


def scattered(count, size, seed):
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:6] = np.concatenate([np.eye(3), -np.eye(3)])  # along the grid's own axes
    return Leg(rng.uniform(-size, size, (count, 3)), directions, np.zeros(count))


@pytest.mark.parametrize("name", MESHES)
def test_grid_finds_the_same_first_hits_as_plain_trimesh(name):
    mesh = MESHES[name]
    leg = scattered(300, 1.2 * mesh.bounds[1].max(), 3)
    plain, hits = PlainCaster(mesh).distances(leg), Grid(mesh).first_hits(leg)
    assert np.array_equal(np.isfinite(plain), hits.found)
    assert 50 < hits.found.sum() < 300 or name == "soup"  # both kinds are there
    np.testing.assert_allclose(hits.distances[hits.found], plain[hits.found], rtol=0, atol=1e-9)


def test_hit_lies_on_the_triangle_it_names():
    mesh = MESHES["on a base"]
    leg = scattered(500, 3.0, 4)
    hits = Grid(mesh).first_hits(leg)
    on_triangle = np.einsum("nk,nki->ni", hits.barycentric[hits.found], mesh.triangles[hits.triangles[hits.found]])
    on_ray = (leg.origins + np.where(hits.found, hits.distances, 0.0)[:, None] * leg.directions)[hits.found]
    np.testing.assert_allclose(on_triangle, on_ray, atol=1e-10)


def test_hits_up_to_the_given_distance_are_passed_over():
    mesh = MESHES["shell"]
    rays = lambertian(200, 1.0)
    first = Grid(mesh).first_hits(Leg(rays.origins, rays.directions, np.zeros(200)))
    second = Grid(mesh).first_hits(Leg(rays.origins, rays.directions, first.distances + 0.1))
    assert (first.distances < 6.7).all()
    assert (second.distances > 12.0).all()


@pytest.mark.parametrize("cell_edges", [0.7, 2.0, 30.0])
def test_cell_size_changes_the_time_and_nothing_else(cell_edges, monkeypatch):
    leg = scattered(300, 3.0, 5)
    usual = Grid(MESHES["on a base"]).first_hits(leg)
    monkeypatch.setattr(facet_casting, "CELL_EDGES", cell_edges)
    other = Grid(MESHES["on a base"]).first_hits(leg)
    assert np.array_equal(usual.distances, other.distances)


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
