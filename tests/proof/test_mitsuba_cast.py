"""The cast by Mitsuba against closed forms, and in the whole verification; only where Mitsuba is installed."""

import numpy as np
import pytest
from lens_meshes import DISTANCE, INDEX, INNER, OUTER, Quadric, lambertian, oracle, right, sphere

from lensforge.errors import InputError
from lensforge.optics.media import Media, Medium
from lensforge.proof import mitsuba_cast
from lensforge.proof.acceptance import mitsuba_criteria
from lensforge.proof.mitsuba_cast import cast_mitsuba, send_through_mitsuba
from lensforge.proof.part_comparison import Expected
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.sequential_cast import CastFate
from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees, verify_part

mitsuba = pytest.importorskip("mitsuba")
RAYS = lambertian(4000, 2.0, seed=11)
HITS, FLUX, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
SCREEN = Screen.square(DISTANCE, 300.0, 32)


def part(rings=60, outer=OUTER):
    return part_mesh_of(right(rings, outer=outer))


def converged():
    many = lambertian(400_000, 2.0, seed=2)
    landings, flux, _ = oracle(INNER, OUTER, many, INDEX, DISTANCE)
    return SCREEN.irradiance(landings, flux)


def deviation(rings):
    passage = send_through_mitsuba(part(rings), RAYS, Media(Medium(INDEX)))[1].landed(SCREEN)
    landed = (passage.fates == CastFate.LANDED) & np.isfinite(HITS[:, 0])
    assert np.mean(landed == np.isfinite(HITS[:, 0])) > 0.995
    np.testing.assert_allclose(passage.flux[landed], FLUX[landed], rtol=0.02)
    seen = landed & (np.abs(HITS).max(axis=1) < 150.0)
    return np.sqrt(np.mean(np.sum((passage.landings[seen] - HITS[seen]) ** 2, axis=1)))


def test_mitsuba_lands_rays_where_the_closed_form_does():
    coarse, fine = deviation(30), deviation(60)
    assert fine < 0.05
    assert coarse / fine > 3.0  # second order in the edge length, as interpolated normals are


def test_the_body_absorbs_along_the_way_within_it_and_the_cavity_nothing():
    """Between spheres about the LED's point every ray goes 5 mm through the body, after 3 mm in the cavity."""
    rays = lambertian(300, 1e-9, seed=5)
    mesh = part_mesh_of(right(60, inner=sphere(3.0), outer=sphere(8.0), base=None))
    clear, dim = (send_through_mitsuba(mesh, rays, Media(Medium(INDEX, per_mm)))[1] for per_mm in (0.0, 0.04))
    landed = clear.fates == CastFate.LANDED
    assert landed.mean() > 0.95
    np.testing.assert_allclose(dim.flux[landed] / clear.flux[landed], np.exp(-0.04 * 5.0), rtol=1e-3)


def test_a_right_lens_holds_within_the_noise_and_a_wrong_one_does_not():
    expected = [Expected(SCREEN, converged(), HITS, FLUX)]
    ((right, _),) = cast_mitsuba(part(), RAYS, Media(Medium(INDEX)), expected, 3000)
    assert right.rays == 3000
    assert right.version == mitsuba.__version__
    assert all(criterion.holds for criterion in mitsuba_criteria(right, DISTANCE))
    # 3000 rays drawn at random: their picture is off by what the noise of so many makes, not more and not less.
    assert 0.8 < right.nmse_vs_design / right.noise_floor_nmse < 1.2
    other = part(outer=Quadric(OUTER.centre, (14.7, 13, 14)))
    ((wider, _),) = cast_mitsuba(other, RAYS, Media(Medium(INDEX)), expected)
    failed = {criterion.key for criterion in mitsuba_criteria(wider, DISTANCE) if not criterion.holds}
    assert "mitsuba_deviation_rms" in failed


def test_verify_asks_mitsuba_and_leaves_the_variant_of_its_caller():
    stl = right().export(file_type="stl")
    mitsuba.set_variant("scalar_spectral")
    expected = Expected(SCREEN, converged(), HITS, FLUX)
    files, light = FilesOfPart(stl), LightOfDesign(RAYS, Media(Medium(INDEX)), [expected])
    result = verify_part(files, light, Referees(1, mitsuba_rays=500))
    assert mitsuba.variant() == "scalar_spectral"
    assert result.first.mitsuba.rays == 500
    assert result.first.gaps_mitsuba_mm[-1] == result.first.mitsuba.against_design.max
    assert "mitsuba_nmse_vs_design" in {criterion.key for criterion in result.criteria}
    without = verify_part(files, light, Referees(1))
    assert without.first.mitsuba is None and without.first.gaps_mitsuba_mm is None


def test_a_mitsuba_that_does_not_load_is_one_line(monkeypatch):
    monkeypatch.setattr(mitsuba_cast, "VARIANT", "no_such_variant")
    with pytest.raises(InputError, match="mitsuba: does not load"):
        send_through_mitsuba(part(8), RAYS, Media(Medium(INDEX)))
