from dataclasses import replace

from lens_meshes import lambertian, lens_mesh, sphere

from lensforge.optics.media import Media
from lensforge.verification import plain_cast
from lensforge.verification.casting import Grid
from lensforge.verification.part_mesh import part_mesh_of
from lensforge.verification.plain_cast import cast_plain


def test_plain_path_is_not_embree():
    assert plain_cast.RayMeshIntersector.__module__ == "trimesh.ray.ray_triangle"


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
