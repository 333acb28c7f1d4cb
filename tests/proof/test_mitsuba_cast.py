"""The cast by Mitsuba against closed forms, and in the whole verification; only where Mitsuba is installed."""

from dataclasses import replace

import numpy as np
import pytest
from lens_meshes import Quadric, lambertian, lens_mesh, oracle

from lensforge.errors import InputError
from lensforge.optics.media import CoatingLayer, IndexCurve, LayerStack, Media
from lensforge.proof import mitsuba_cast
from lensforge.proof.acceptance import mitsuba_criteria
from lensforge.proof.facet_casting import Grid
from lensforge.proof.mitsuba_cast import cast_mitsuba, send_through_mitsuba
from lensforge.proof.part_comparison import Expected
from lensforge.proof.part_mesh import part_mesh_of
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.refraction import refract
from lensforge.proof.sequential_cast import CastFate, LandedRays, send_through
from lensforge.proof.verification import verify_part
from lensforge.sources.ray_bundle import RayBundle

mitsuba = pytest.importorskip("mitsuba")
INDEX, DISTANCE = 1.4936, 150.0
INNER = Quadric((0.3, -0.2, 0.1), (6.0, 6.5, 5.5))
OUTER = Quadric((-0.4, 0.3, -0.5), (13.7, 13.0, 14.0))
RAYS = lambertian(4000, 2.0, seed=11)
HITS, FLUX, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
SCREEN = Screen.square(DISTANCE, 300.0, 32)


def part(rings=60, outer=OUTER):
    return part_mesh_of(lens_mesh(INNER.radius, outer.radius, rings, (16.0, 2.0)))


def converged():
    many = lambertian(400_000, 2.0, seed=2)
    landings, flux, _ = oracle(INNER, OUTER, many, INDEX, DISTANCE)
    return SCREEN.irradiance(landings, flux)


def deviation(rings):
    passage = LandedRays.of(send_through_mitsuba(part(rings), RAYS, Media(INDEX))[1], SCREEN)
    landed = (passage.fates == CastFate.LANDED) & np.isfinite(HITS[:, 0])
    assert np.mean(landed == np.isfinite(HITS[:, 0])) > 0.995
    np.testing.assert_allclose(passage.flux[landed], FLUX[landed], rtol=0.02)
    seen = landed & (np.abs(HITS).max(axis=1) < 150.0)
    return np.sqrt(np.mean(np.sum((passage.landings[seen] - HITS[seen]) ** 2, axis=1)))


def test_mitsuba_lands_rays_where_the_closed_form_does():
    coarse, fine = deviation(30), deviation(60)
    assert fine < 0.05
    assert coarse / fine > 3.0  # second order in the edge length, as interpolated normals are


def test_rays_lose_by_their_paths_in_the_body_what_the_law_says():
    some, lens = RAYS.take(slice(500)), part()
    (_, clear), (_, dim) = (send_through_mitsuba(lens, some, Media(INDEX, each)) for each in (0.0, 0.05))
    left = clear.fates == CastFate.LANDED
    entered = some.origins + INNER.far_hit(some.origins, some.directions)[:, None] * some.directions
    lengths = np.linalg.norm(clear.points - entered, axis=1)
    lost, once = -np.expm1(-0.05 * lengths), refract(some.directions, INNER.normal(entered), 1.0 / INDEX)[1]
    np.testing.assert_allclose(dim.flux[left], (clear.flux * (1.0 - lost))[left], rtol=1e-3)
    np.testing.assert_allclose(dim.absorbed[left], (some.flux * once * lost)[left], rtol=0.01)


def test_coated_faces_transmit_at_the_angles_that_mitsuba_finds():
    some, lens = RAYS.take(slice(400)), part()
    layer = LayerStack((CoatingLayer(IndexCurve((2.1,)), 80.0),), IndexCurve((INDEX,)), (300.0, 900.0))
    media = Media(INDEX, inner_coating=layer, outer_coating=layer)
    some = replace(some, wavelengths_nm=np.linspace(420.0, 680.0, 400))
    (_, found), mesh = send_through_mitsuba(lens, some, media), send_through(lens, Grid(lens.mesh), some, media)
    left = (found.fates == CastFate.LANDED) & (mesh.fates == CastFate.LANDED)
    assert left.sum() > 350
    np.testing.assert_allclose(found.flux[left], mesh.flux[left], rtol=2e-3)
    assert not np.allclose(found.flux[left], send_through_mitsuba(lens, some, Media(INDEX))[1].flux[left], rtol=0.05)


def test_a_right_lens_holds_within_the_noise_and_a_wrong_one_does_not():
    expected = [Expected(SCREEN, converged(), HITS, FLUX)]
    ((right, _),) = cast_mitsuba(part(), RAYS, Media(INDEX), expected, 3000)
    assert right.rays == 3000
    assert right.version == mitsuba.__version__
    assert all(criterion.passed for criterion in mitsuba_criteria(right, DISTANCE))
    # 3000 rays drawn at random: their picture is off by what the noise of so many makes, not more and not less.
    assert 0.8 < right.nmse_vs_design / right.noise_floor_nmse < 1.2
    other = part(outer=Quadric(OUTER.centre, (14.7, 13, 14)))
    ((wider, _),) = cast_mitsuba(other, RAYS, Media(INDEX), expected)
    failed = {criterion.name for criterion in mitsuba_criteria(wider, DISTANCE) if not criterion.passed}
    assert "mitsuba_deviation_rms" in failed


def test_rays_with_an_index_each_are_bent_by_it():
    both = [RayBundle(RAYS.origins, RAYS.directions, RAYS.flux, np.full(4000, index)) for index in (1.4, 1.6)]
    some = np.arange(50)
    for rays, index in zip(both, (1.4, 1.6), strict=True):
        _, own = send_through_mitsuba(part(), rays.take(some), Media(INDEX))
        _, given = send_through_mitsuba(part(), RAYS.take(some), Media(index))
        np.testing.assert_array_equal(own.points, given.points)
        np.testing.assert_array_equal(own.directions, given.directions)


def test_rays_that_cannot_pass_say_why():
    start = [[0, 0, 0], [0, 0, 9], [40, 0, 0.5], [0, 0, 20], [0.3, 5.3, 0.5], [0, 0, 5], [0, 0, 5]]
    towards = [[0.999, 0, -0.0447], [0, 0, 1], [0, 1, 0], [0.1, 0, -1], [1, 0, -0.1], [1, 0, -0.02], [1, 0, -0.9]]
    directions = np.array(towards, dtype=float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    _, passage = send_through_mitsuba(
        part(), RayBundle(np.array(start, dtype=float), directions, np.ones(7)), Media(INDEX)
    )
    assert [CastFate(fate).name for fate in passage.fates] == [
        "OPENING", "STARTS_INSIDE", "NO_HIT", "STARTS_OUTSIDE", "BASE", "LANDED", "OPENING",
    ]  # fmt: skip


def test_verify_asks_mitsuba_and_leaves_the_variant_of_its_caller():
    stl = lens_mesh(INNER.radius, OUTER.radius, 36, (16.0, 2.0)).export(file_type="stl")
    mitsuba.set_variant("scalar_spectral")
    expected = Expected(SCREEN, converged(), HITS, FLUX)
    given = {"rays": RAYS, "media": Media(INDEX), "expected": [expected], "plain_rays": 1}
    result = verify_part(stl, **given, mitsuba_rays=500)
    assert mitsuba.variant() == "scalar_spectral"
    assert result.mitsuba.rays == 500
    assert result.first.gaps_mitsuba_mm[-1] == result.mitsuba.against_design.max
    assert "mitsuba_nmse_vs_design" in {criterion.name for criterion in result.criteria}
    without = verify_part(stl, **given)
    assert without.mitsuba is None and without.first.gaps_mitsuba_mm is None


def test_a_mitsuba_that_does_not_load_is_one_line(monkeypatch):
    monkeypatch.setattr(mitsuba_cast, "VARIANT", "no_such_variant")
    with pytest.raises(InputError, match="mitsuba: does not load"):
        send_through_mitsuba(part(8), RAYS, Media(INDEX))
