from dataclasses import replace

import numpy as np
import pytest
import trimesh
from lens_meshes import INDEX, lambertian, right
from nightly import first_by_day
from own_media import coatings, with_own

from lensforge.optics.media import Media, Medium, ReflectanceTable
from lensforge.proof.facet_casting import Grid
from lensforge.proof.nonsequential_trace import Cause, Limits, PartBody, follow
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.receiver_screen import Screen
from lensforge.sources.ray_bundle import RayBundle

SCREEN = Screen.square(150.0, 300.0, 8)
R = ((INDEX - 1.0) / (INDEX + 1.0)) ** 2
EVERYTHING = Limits(cut_off=1e-14, depth=60)
LENS = part_mesh_of(right(30))
GRID = Grid(LENS.mesh)


def body(mesh, absorption=0.0, **changes):
    part = part_mesh_of(mesh)
    return PartBody(part, Grid(part.mesh), Media(Medium(INDEX, absorption), **changes))


def window(thickness, **changes):
    mesh = trimesh.creation.box((40.0, 40.0, thickness)).subdivide().subdivide().subdivide()
    return body(mesh.apply_translation((0.0, 0.0, 5.0 + thickness / 2)), **changes)


def beam(count=50, slant=0.0):
    directions = np.tile([np.sin(slant), 0.0, np.cos(slant)], (count, 1))
    origins = np.random.default_rng(0).uniform(-3.0, 3.0, (count, 3)) * [1.0, 1.0, 0.0]
    return RayBundle(origins, directions, np.full(count, 1.0 / count))


def places(budget):
    """Where the light lands that has left the part; NaN where it goes back."""
    escaped = budget.escaped()
    return SCREEN.land(escaped.points, escaped.directions)


def landed(budget, cause=None):
    escaped = budget.escaped()
    reached = ~np.isnan(places(budget)[:, 0])
    return escaped.flux[reached if cause is None else reached & (escaped.causes == cause)].sum()


def backward(budget):
    return budget.escaped().flux.sum() - landed(budget)


def total(budget):
    ends = backward(budget) + budget.absorbed + budget.base + budget.cut_off + budget.leaked
    return landed(budget) + ends


@pytest.mark.parametrize("absorption", [0.0, 0.05])
def test_a_plane_window_transmits_as_the_series_of_its_echoes(absorption):
    thickness = 2.0
    dims = np.exp(-absorption * thickness)
    budget = follow(window(thickness, absorption=absorption), beam(), EVERYTHING)
    assert landed(budget, Cause.SEQUENTIAL) == pytest.approx((1 - R) ** 2 * dims, rel=1e-12)
    assert landed(budget) == pytest.approx((1 - R) ** 2 * dims / (1 - (R * dims) ** 2), rel=1e-12)
    if absorption == 0.0:
        assert landed(budget) == pytest.approx(2 * INDEX / (INDEX**2 + 1), rel=1e-12)
        assert backward(budget) == pytest.approx((INDEX - 1) ** 2 / (INDEX**2 + 1), rel=1e-12)
    assert total(budget) == pytest.approx(1.0, abs=1e-12)


def test_a_coated_window_transmits_as_the_series_of_its_echoes_and_its_bare_base_as_fresnel_says():
    first, second = (ReflectanceTable((0.0, 90.0), ((share, share),)) for share in (0.02, 0.3))
    budget = follow(window(2.0, coatings=coatings(first, second)), beam(), EVERYTHING)
    assert landed(budget, Cause.SEQUENTIAL) == pytest.approx(0.98 * 0.7, rel=1e-12)
    assert landed(budget) == pytest.approx(0.98 * 0.7 / (1 - 0.02 * 0.3), rel=1e-12)
    assert backward(budget) == pytest.approx(0.02 + 0.98 * 0.3 * 0.98 / (1 - 0.02 * 0.3), rel=1e-12)
    assert total(budget) == pytest.approx(1.0, abs=1e-12)
    by_wave = ReflectanceTable((0.0, 90.0), ((0.1, 0.1), (0.2, 0.2)), (400.0, 500.0))
    rays = beam().with_wavelengths(np.full(50, 450.0))
    budget = follow(window(2.0, coatings=coatings(outer=by_wave)), rays, EVERYTHING)
    assert landed(budget, Cause.SEQUENTIAL) == pytest.approx((1 - R) * 0.85, rel=1e-12)
    assert (budget.escaped().wavelengths_nm == 450.0).all()
    low = window(2.0, coatings=coatings(first, second))
    low.part.mesh.apply_translation((0.0, 0.0, -12.0))  # below z = 0: no optical face
    start = replace(beam(), origins=beam().origins - np.array([0.0, 0.0, 20.0]))
    budget = follow(PartBody(part_mesh_of(low.part.mesh), Grid(low.part.mesh), low.media), start, EVERYTHING)
    assert landed(budget) == pytest.approx(2 * INDEX / (INDEX**2 + 1), rel=1e-9)


def test_echoes_in_a_slanted_window_land_side_by_side():
    thickness = 2.0
    slant = 0.3
    bent = np.arcsin(np.sin(slant) / INDEX)
    ray = RayBundle(np.zeros((1, 3)), np.array([[np.sin(slant), 0.0, np.cos(slant)]]), np.ones(1))
    budget = follow(window(thickness), ray, EVERYTHING)
    x = np.sort(places(budget)[:, 0])
    np.testing.assert_allclose(np.diff(x)[:2], 2.0 * thickness * np.tan(bent), rtol=1e-9)


@pytest.mark.parametrize("absorption", first_by_day(1, [0.02, 0.0], "another absorption"))
def test_a_source_inside_of_a_ball_shell_gets_out_by_the_closed_form(absorption):
    outer, inner = (trimesh.creation.icosphere(subdivisions=4, radius=radius) for radius in (13.0, 6.0))
    inner.invert()
    shell = body(trimesh.util.concatenate([outer, inner]), absorption=absorption)
    dims = np.exp(-absorption * 7.0)
    through = (1 - R) ** 2 * dims / (1 - (R * dims) ** 2)
    back = R + (1 - R) ** 2 * R * dims**2 / (1 - (R * dims) ** 2)
    rays = lambertian(20, 0.0)
    budget = follow(shell, rays, Limits(cut_off=1e-10, depth=60))
    assert landed(budget) + backward(budget) == pytest.approx(through / (1 - back), rel=1e-6)
    assert landed(budget, Cause.SEQUENTIAL) == pytest.approx((1 - R) ** 2 * dims, rel=1e-6)
    assert total(budget) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("base", first_by_day(2, ["polished", "black"], "more bases"))
@pytest.mark.parametrize("absorption", [0.0, 0.01])
def test_all_flux_of_a_lens_is_accounted_for(base, absorption):
    rays = lambertian(2000, 2.0, seed=4)
    budget = follow(PartBody(LENS, GRID, Media(Medium(INDEX, absorption)), base), rays, Limits())
    assert total(budget) == pytest.approx(1.0, abs=1e-9)
    assert (budget.base > 0.0) == (base == "black")
    assert (budget.absorbed > 0.0) == (absorption > 0.0)
    assert budget.leaked < 1e-4


def test_what_the_cut_off_leaves_out_falls_with_it():
    rays = lambertian(1000, 2.0, seed=6)
    shares = []
    for cut_off in (1e-2, 1e-4, 1e-6):
        budget = follow(PartBody(LENS, GRID, Media(Medium(INDEX))), rays, Limits(cut_off))
        shares.append((budget.cut_off, landed(budget)))
    (coarse, few), (fine, more), (finest, most) = shares
    assert finest < 0.1 * fine < 0.01 * coarse
    assert most - few <= coarse and most - more <= fine


def test_threads_and_chunks_of_rays_lose_none_and_change_no_bit():
    rays = lambertian(400, 2.0, seed=6)
    part = PartBody(LENS, GRID, Media(Medium(INDEX, 0.01)), "black")
    one, two = (follow(part, rays, Limits(), threads, chunk=150) for threads in (1, 2))
    assert total(one) == pytest.approx(1.0, abs=1e-9) and one.base > 0.0
    for name in ("absorbed", "base", "cut_off", "leaked"):
        assert getattr(one, name) == getattr(two, name)
    for name, values in vars(one.escaped()).items():
        np.testing.assert_array_equal(values, getattr(two.escaped(), name))


def test_light_that_starts_in_the_material_is_no_sequential_light():
    rays = RayBundle(np.array([[0.0, 0.0, 9.0]]), np.array([[0.0, 0.0, 1.0]]), np.ones(1))
    budget = follow(PartBody(LENS, GRID, Media(Medium(INDEX))), rays, Limits())
    assert landed(budget, Cause.SEQUENTIAL) == 0.0
    assert landed(budget) == pytest.approx(1.0, abs=0.06)


def test_a_window_with_a_gap_reports_what_leaks():
    mesh = window(2.0).part.mesh
    above = np.abs(mesh.triangles_center[:, 2] - 7.0) < 1e-9
    broken = body(trimesh.Trimesh(mesh.vertices, mesh.faces[~above], process=True))
    budget = follow(broken, beam(), EVERYTHING)
    assert budget.leaked == pytest.approx(1 - R, rel=1e-9)
    assert total(budget) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.nightly("two seconds; by day the sequential casts")
def test_rays_with_an_index_each_go_as_if_the_lens_had_it():
    rays = lambertian(12, 2.0, seed=5)
    for index in (1.45, 1.55):
        given, medium = with_own(rays, Medium(INDEX), np.full(12, index))
        alone = follow(PartBody(LENS, GRID, Media(Medium(index))), rays, EVERYTHING)
        traced = follow(PartBody(LENS, GRID, Media(medium)), given, EVERYTHING)
        for name in ("points", "directions", "flux"):
            np.testing.assert_array_equal(getattr(traced.escaped(), name), getattr(alone.escaped(), name))
