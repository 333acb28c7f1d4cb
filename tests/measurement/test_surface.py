import json
from dataclasses import replace

import numpy as np
import pytest
from measured_lenses import dent, directions, lens, probed

from lensforge.accuracy import PRESETS
from lensforge.evaluation.evaluate import evaluate_lens
from lensforge.geometry.patch import fit_patch
from lensforge.measurement.deviation import coverage, fit_deviation
from lensforge.measurement.surface import compare_surface, measure_form
from lensforge.sources.build import build_source
from lensforge.surfaces.srbf import SrbfSurface

LENS = lens()
PATCH = fit_patch(LENS.outer)
ROTATION, SHIFT = np.array([0.03, -0.05, 0.08]), np.array([0.4, -0.3, 0.2])
HEIGHT = 0.02


def without_motion(u, radial):
    """``radial`` less the share that a small rigid motion explains: no registration can tell it from a motion."""
    normals = LENS.outer.normal(u)
    points = u * LENS.outer.radius(u)[:, None]
    along = radial * np.sum(normals * u, axis=1)
    motions = np.concatenate([np.cross(points, normals), normals], axis=1)
    return along - motions @ np.linalg.lstsq(motions, along, rcond=None)[0]


def recovered(cloud):
    form = measure_form(PATCH, LENS.basis, cloud)
    u = directions(3000, 99)
    return form, np.sum(LENS.outer.normal(u) * u, axis=1) * form.deviation.surface.radius(u), u


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_deformation_is_found_in_a_moved_cloud(noise):
    cloud = probed(LENS.outer, 5000, height_mm=HEIGHT, noise_mm=noise, rotation=ROTATION, shift=SHIFT)
    form, found, u = recovered(cloud)
    wanted = without_motion(u, dent(u, HEIGHT))
    error = np.sqrt(np.mean((found - wanted) ** 2))
    assert error < 0.02 * HEIGHT + 0.25 * noise
    assert np.corrcoef(found, wanted)[0, 1] > 0.99
    assert form.deviation.residual_rms_mm == pytest.approx(noise, abs=2e-4)


def test_a_perfect_part_has_no_deviation():
    form, found, _ = recovered(probed(LENS.outer, rotation=ROTATION, shift=SHIFT))
    assert np.abs(found).max() < 1e-4
    assert np.abs(form.distances).max() < 1e-5


def test_noise_is_not_believed():
    """Least squares alone would make half of the noise of 400 points a deformation: it has 115 functions for them."""
    noise = 0.01 * np.random.default_rng(0).normal(size=400)
    fitted = fit_deviation(LENS.outer.basis, directions(400, 1), noise)
    assert np.sqrt(np.mean(fitted.surface.radius(directions(2000, 2)) ** 2)) < 0.003


def test_coverage_is_the_share_of_the_hemisphere():
    u = directions(40_000, 5)
    assert coverage(u, 0.05) == pytest.approx(1.0, abs=0.01)
    assert coverage(u[u[:, 0] > 0.0], 0.02) == pytest.approx(0.5, abs=0.02)


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")

    def run(height):
        cloud = probed(LENS.outer, 3000, height_mm=height, noise_mm=0.0005, rotation=ROTATION, shift=SHIFT)
        return compare_surface(
            cloud, folder, lens=LENS, side="outer", source=build_source(LENS.spec.source), preset=PRESETS["draft"]
        )

    return folder, run


def test_a_good_part_makes_the_light_of_the_design(compared):
    _, run = compared
    content = run(0.0)
    assert content["form_deviation_um"]["pv"] < 1.0
    assert content["nmse_between"] < 1e-4
    assert content["measured"]["efficiency"] == pytest.approx(content["design"]["efficiency"], abs=1e-3)
    assert all(gate["passed"] for gate in content["gates"])


def test_a_deformed_part_makes_other_light(compared):
    folder, run = compared
    content = run(HEIGHT)
    assert json.loads((folder / "compare_outer.json").read_text(encoding="utf-8")) == content
    assert 0.3 * HEIGHT * 1e3 < content["form_deviation_um"]["pv"] < 1.2 * HEIGHT * 1e3
    assert content["point_deviation_um"]["rms"] == pytest.approx(content["form_deviation_um"]["rms"], rel=0.25)
    assert content["nmse_between"] > 1e-5
    with np.load(folder / "compare_outer.npz") as stored:
        assert stored["irradiance_measured"].shape == (24, 24)
        assert np.nanmax(stored["deviation_um"]) == pytest.approx(content["form_deviation_um"]["max"])
        peak = np.unravel_index(np.nanargmax(stored["deviation_um"]), stored["deviation_um"].shape)
        chart = stored["chart"][peak[1]], stored["chart"][peak[0]]
    towards = np.array([0.5, 0.3, 0.8]) / np.linalg.norm([0.5, 0.3, 0.8])
    np.testing.assert_allclose(chart, towards[:2] / (1.0 + towards[2]), atol=0.15)
    assert (folder / "compare_outer.png").stat().st_size > 10_000


def deformed_part(height):
    """The lens with a fine random deformation (mm) on its outer surface that holds no rigid motion."""
    outer, u = LENS.outer, directions(4000, 21)
    weights = np.zeros(outer.basis.size)
    weights[-81:] = height * np.random.default_rng(8).normal(size=81)
    values, normals = outer.basis.evaluate(u), outer.normal(u)
    cosine = np.sum(normals * u, axis=1)
    motions = np.concatenate([np.cross(u * outer.radius(u)[:, None], normals), normals], axis=1)
    share = np.linalg.lstsq(motions, cosine * (values @ weights), rcond=None)[0]
    weights -= np.linalg.lstsq(values, motions @ share / cosine, rcond=None)[0]
    return replace(LENS, outer=SrbfSurface(outer.basis, outer.weights + weights, outer.offset_mm))


@pytest.mark.parametrize("freedom", ["rigid", "shift", "none"])
def test_the_light_is_that_of_the_deformed_lens(tmp_path, freedom):
    """The oracle is the tracer on the true part."""
    part, source, preset = deformed_part(0.05), build_source(LENS.spec.source), PRESETS["draft"]
    true = evaluate_lens(part, source, preset).irradiance
    motion = {
        "rigid": {"rotation": ROTATION, "shift": SHIFT},
        "shift": {"shift": SHIFT},
        "none": {},
    }[freedom]
    cloud = probed(part.outer, 3000, noise_mm=0.0005, **motion)
    content = compare_surface(cloud, tmp_path, lens=LENS, side="outer", source=source, preset=preset, freedom=freedom)
    with np.load(tmp_path / "compare_outer.npz") as stored:
        found, designed = stored["irradiance_measured"], stored["irradiance_design"]
    assert np.sum((found - true) ** 2) < 0.05 * np.sum((designed - true) ** 2)
    assert content["nmse_between"] > 1e-3
    assert (content["pose"]["translation_mm"] == [0.0, 0.0, 0.0]) == (freedom == "none")


def test_half_a_surface_fails(tmp_path):
    cloud = probed(LENS.outer, 2500)
    content = compare_surface(
        cloud[cloud[:, 0] > 0.0],
        tmp_path,
        lens=LENS,
        side="outer",
        source=build_source(LENS.spec.source),
        preset=PRESETS["draft"],
    )
    assert {gate["name"] for gate in content["gates"] if not gate["passed"]} == {"surface_covered"}
