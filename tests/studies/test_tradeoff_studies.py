import numpy as np
import pytest
from scenes import random_surface, small_spec, table_of
from scipy.stats import linregress

from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene
from lensforge.runs.tradeoff import rays as rays_module
from lensforge.runs.tradeoff.convergence import order_of
from lensforge.runs.tradeoff.exported import CURVED, EQUAL, FLAT, SPLIT, casting_study, mesh_study, nurbs_study
from lensforge.runs.tradeoff.pixels import bias, filter_study, pixel_study
from lensforge.runs.tradeoff.rays import PLAIN, QMC, ray_study
from lensforge.runs.tradeoff.reference import ExactReference, directions
from lensforge.runs.tradeoff.runs import TracedRun, resample, trace_run
from lensforge.runs.tradeoff.tables import table_normals, table_study
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(100)
SPEC = small_spec(base={"kind": "none"})


@pytest.fixture(scope="module")
def lens():
    inner, outer = (random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2))
    return Lens(inner, outer, SPEC, 0, "draft")


@pytest.fixture(scope="module")
def traced(lens):
    scene = Scene(lens.media, GRID)
    return TracedLens(scene, table_of(lens.inner, GRID), table_of(lens.outer, GRID), {})


@pytest.fixture(scope="module")
def source(lens):
    return build_source(lens.spec.source)


@pytest.fixture(scope="module")
def by_rays(lens, traced, source):
    return ray_study(traced, lens.spec, source, (2**10, 2**12, 2**14))


@pytest.fixture(scope="module")
def measured(lens, source):
    return table_study(lens, source, (3.0, 5.0, 8.0, 12.0))


@pytest.fixture(scope="module")
def by_nodes(measured):
    return measured.study


def levels(study, series):
    return [level for level in study.levels if level.series == series]


def test_plain_monte_carlo_falls_with_the_root_of_the_rays_and_quasi_monte_carlo_faster(by_rays):
    orders = by_rays[0].order
    assert orders[PLAIN]["irradiance_nmse"].value == pytest.approx(-1.0, abs=0.05)
    assert abs(orders[PLAIN]["efficiency"].value + 0.5) < 4.0 * orders[PLAIN]["efficiency"].standard_error
    assert orders[QMC]["irradiance_nmse"].value < -1.05
    plain, quasi = (levels(by_rays[0], series)[-1].errors for series in (PLAIN, QMC))
    assert quasi["irradiance_nmse"].value < 0.9 * plain["irradiance_nmse"].value


def test_the_spread_of_plain_monte_carlo_is_that_of_independent_rays(traced, source):
    pool = trace_run(traced, receivers_of(SPEC, 16)[0], source, 2**12, 0)
    drawn = [resample(pool, 256, np.random.default_rng(k)).flux.sum() for k in range(400)]
    expected = len(pool) * pool.flux.std() / np.sqrt(256)
    assert np.std(drawn, ddof=1) == pytest.approx(expected, rel=0.15)
    assert np.mean(drawn) == pytest.approx(pool.flux.sum(), abs=4.0 * expected / np.sqrt(400))


def test_the_ray_reference_is_the_finest_level_together_and_without_error(by_rays):
    (reference,) = levels(by_rays[0], "reference")
    assert reference.setting == 8 * 2**14 and reference.reference
    assert {estimate.value for estimate in reference.errors.values()} == {0.0}
    top = levels(by_rays[0], QMC)[-1].errors["efficiency"].value
    assert reference.errors["efficiency"].standard_error == pytest.approx(top / np.sqrt(8))


def test_noise_raises_the_nmse_by_about_its_own_share(by_rays):
    for level in levels(by_rays[0], PLAIN):
        raised, noise = level.errors["nmse_raised"], level.errors["irradiance_nmse"]
        assert 0.3 * noise.value < raised.value < 3.0 * noise.value


def test_the_table_converges_to_the_exact_sum_with_the_fourth_power_and_its_normals_with_the_third(by_nodes):
    orders = by_nodes.order["table"]
    assert orders["rho"].value == pytest.approx(-4.0, abs=0.5)
    assert orders["normal"].value == pytest.approx(-3.0, abs=0.6)
    assert orders["hit_99_percent"].value < -2.4
    (exact,) = (level for level in by_nodes.levels if level.reference)
    assert {estimate.value for estimate in exact.errors.values()} == {0.0}


def test_errors_of_shapes_are_in_the_units_that_they_name(lens, source):
    """Faces raised by 3 and 7 nm, whose normals are turned by 4 and 2 mrad: the larger of each counts."""
    reference, u = ExactReference(lens, source.sample(1, 0), None, None), directions()
    shapes = {}
    for name, raised_mm, turned in (("inner", 3e-6, 4e-3), ("outer", -7e-6, 2e-3)):
        face = getattr(lens, name)
        normals = face.normal(u)
        across = np.cross(normals, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        shapes[name] = face.radius(u) + raised_mm, np.cos(turned) * normals + np.sin(turned) * across
    found = reference.shape_errors(shapes)
    assert {name: metric.unit for name, metric in found.items()} == {"rho": "nm", "normal": "mrad"}
    assert {name: metric.value for name, metric in found.items()} == pytest.approx(
        {"rho": 7.0, "normal": 4.0}, rel=1e-6
    )


def test_normals_of_a_table_by_differences_are_those_of_the_sum(lens):
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fine = TableGrid(400)
    radius, normals = table_normals(fine, tabulate(fine, lens.outer), directions)
    assert np.abs(radius - lens.outer.radius(directions)).max() < 1e-8
    assert np.abs(normals - lens.outer.normal(directions)).max() < 1e-6


def smooth_runs(count=8, rays=2**18):
    """Runs whose irradiance is a Gaussian, wide against the pixels: the splat's bias has a closed form."""
    made = []
    for k in range(count):
        hits = np.random.default_rng(k).normal(scale=20.0, size=(rays, 2))
        made.append(TracedRun(hits, np.full(rays, 1.0 / rays), 1.0, 0.0, 1.0))
    return made


def test_the_bias_of_the_splat_is_what_its_second_moment_says():
    # Binning widens the Gaussian by a box's variance, p^2/12, the splat by a triangle's, p^2/6.
    study = pixel_study(smooth_runs(), small_spec(), (10, 16, 20))
    for level in study.levels:
        pitch = 200.0 / level.setting
        box, triangle = 20.0**2 + pitch**2 / 12.0, 20.0**2 + pitch**2 / 6.0
        expected = 1.0 + box / triangle - 4.0 * box / (box + triangle)
        found = level.errors["splat_nmse"]
        assert abs(found.value - expected) < 0.05 * expected + 3.0 * found.standard_error
    assert study.order["hard bins"]["splat_nmse"].value == pytest.approx(-4.0, abs=0.6)
    assert study.levels[-1].errors["nmse_shift"].value == 0.0


def test_noise_does_not_count_as_bias():
    noise = np.random.default_rng(1)
    found = [bias(1.0 + noise.normal(size=(8, 30, 30)), np.ones((8, 30, 30))) for _ in range(50)]
    assert abs(np.mean(found)) < 4.0 * np.std(found) / np.sqrt(50)
    assert np.abs(found).max() < 0.03  # the noise's own share is 1/8


def test_the_filter_blurs_more_and_leaves_less_noise_the_wider_it_is(by_rays, lens):
    study = filter_study(by_rays[1], lens.spec, (0.0, 0.5, 1.0))
    noise = [level.errors["noise_nmse"].value for level in study.levels]
    assert noise == sorted(noise, reverse=True)
    assert study.levels[0].errors["irradiance_nmse"].value == 0.0
    # For white noise the share left is the sum of the squared taps.
    tap = np.exp(-1.0)
    left = ((1.0 + 2.0 * tap**2) / (1.0 + 2.0 * tap) ** 2) ** 2
    white = [
        TracedRun(np.random.default_rng(k).uniform(-100, 100, (2**12, 2)), np.ones(2**12), 1.0, 0.0, 1.0)
        for k in range(8)
    ]
    flat = filter_study(white, lens.spec, (0.0, 0.5))
    assert flat.levels[1].errors["noise_nmse"].value / flat.levels[0].errors["noise_nmse"].value == pytest.approx(
        left, rel=0.25
    )


def test_the_faces_converge_to_the_sum_and_the_mesh_to_the_faces(lens):
    by_knots, plan = nurbs_study(lens, (20, 28, 40), cad=False)
    assert by_knots.order["quintic spline"]["form"].value < -5.0
    by_rings = mesh_study(plan, (12, 24, 48))
    assert by_rings.order[EQUAL]["chord"].value == pytest.approx(-2.0, abs=0.15)
    assert by_rings.order[EQUAL]["normal"].value == pytest.approx(-1.0, abs=0.15)
    triangles = {level.setting: level.other["triangles"] for level in levels(by_rings, EQUAL)}
    assert triangles[24] == 2 * 6 * 24**2
    (exported,) = levels(by_rings, SPLIT)
    assert exported.used_by == ("the export",)
    assert exported.errors["chord"].value <= 1.0


def test_an_order_is_the_slope_and_knows_its_error():
    n = np.array([1e3, 1e4, 1e5, 1e6])
    exact = order_of(n, 3.0 * n**-0.75)
    assert exact.value == pytest.approx(-0.75, abs=1e-12) and exact.standard_error < 1e-12
    found = [
        order_of(n, n**-0.5 * np.exp(0.2 * np.random.default_rng(k).normal(size=4)), np.full(4, 0.2))
        for k in range(300)
    ]
    assert np.std([order.value for order in found]) == pytest.approx(found[0].standard_error, rel=0.15)
    y = np.array([0.31, 0.12, 0.02, 0.014])  # the textbook's error, from residuals with two degrees of freedom less
    for count in (3, 4):
        line = linregress(np.log(n[:count]), np.log(y[:count]))
        seen = order_of(n[:count], y[:count])
        assert (seen.value, seen.standard_error) == pytest.approx((line.slope, line.stderr))


@pytest.mark.nightly("a study of seven seconds")
def test_curved_facets_converge_and_flat_ones_hardly(measured, lens):
    _, plan = nurbs_study(lens, (40,), cad=False)
    study = casting_study(measured.reference.thinned(2), plan, (12, 24, 48))
    assert study.order[CURVED]["hit_99_percent"].value == pytest.approx(-4.0, abs=0.5)
    assert study.order[FLAT]["irradiance_nmse"].value > -2.2
    curved, flat = (levels(study, series)[-1].errors for series in (CURVED, FLAT))
    assert curved["hit_99_percent"].value < 1e-3 * flat["hit_99_percent"].value


def test_a_run_too_long_to_keep_is_as_good_as_its_parts_together(lens, traced, source, monkeypatch):
    monkeypatch.setattr(rays_module, "MOST_AT_ONCE", 2**12)
    study, kept = ray_study(traced, lens.spec, source, (2**10, 2**11, 2**12, 2**14))
    assert len(kept[0]) == 2**12
    short, long = levels(study, QMC)[-2:]
    found = long.errors["irradiance_nmse"].value / short.errors["irradiance_nmse"].value
    assert found == pytest.approx(1 / 4, rel=0.2)  # four scrambles of 2^12: noise falls with their number
    assert [level.setting for level in levels(study, PLAIN)] == [2**10, 2**11, 2**12]
    assert study.order[QMC]["irradiance_nmse"].value < -1.0
