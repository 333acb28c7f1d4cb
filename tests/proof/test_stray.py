import numpy as np
import pytest
from lens_meshes import DISTANCE, INDEX, INNER, OUTER, lambertian, oracle, right

from lensforge.errors import InputError
from lensforge.optics.media import CoverGlass, Media, Medium
from lensforge.proof.acceptance import BALANCE, stray_criteria
from lensforge.proof.nonsequential_trace import Limits
from lensforge.proof.proof_result import StrayLight
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.stray_analysis import trace_stray

SIDE, PIXELS = 300.0, 32
RAYS = lambertian(1500, 2.0, seed=7)
SCREEN = Screen.square(DISTANCE, SIDE, PIXELS, 0.0)
STL = right(30).export(file_type="stl")


def run(trace=trace_stray, **changes):
    given = {
        "rays": RAYS,
        "media": Media(Medium(INDEX)),
        "screens": [SCREEN],
    }
    return trace(STL, **{**given, **changes})


MADE_FROM = dict.fromkeys(("lens", "export"), "0" * 64)


def test_pictures_hold_the_flux_of_the_budget_and_are_read_back(tmp_path):
    found = run(inputs=MADE_FROM)
    pixel, seen = (SIDE / PIXELS * 1e-3) ** 2, found.first
    assert seen.stray.sum() * pixel == pytest.approx(found.flux.detected_stray, rel=1e-12)
    assert seen.direct.sum() * pixel == pytest.approx(found.flux.detected_direct, rel=1e-12)
    np.testing.assert_allclose(seen.direct, seen.sequential, rtol=1e-9, atol=1e-12)
    assert found.inputs == MADE_FROM
    found.write(tmp_path)
    assert StrayLight.read(tmp_path) == found
    assert len(found.criteria) == 3 and all(criterion.holds for criterion in found.criteria)
    assert seen.balance_error < 1e-9
    assert sum(seen.detected_stray_by_cause.model_dump().values()) == pytest.approx(found.flux.detected_stray)
    assert seen.misplaced_flux == pytest.approx(found.flux.detected_stray, rel=1e-6)


def test_the_sequential_share_is_the_closed_form_of_the_lens():
    hits, flux, _ = oracle(INNER, OUTER, RAYS, INDEX, DISTANCE)
    inside = np.abs(hits).max(axis=1) <= SIDE / 2
    assert run().efficiency_sequential == pytest.approx(flux[inside].sum(), rel=2e-3)


def test_a_black_base_takes_light_that_a_polished_one_lets_go():
    polished, black = (run(base=base).flux for base in ("polished", "black"))
    assert polished.base == 0.0 < black.base
    assert black.detected_direct == pytest.approx(polished.detected_direct, rel=1e-12)
    assert black.outside_stray <= polished.outside_stray
    assert black.backward < polished.backward


def test_a_cut_off_that_leaves_too_much_out_fails():
    found = run(limits=Limits(cut_off=0.1))
    (missed,) = [criterion for criterion in found.criteria if not criterion.holds]
    assert missed.key == "stray_too_dim"
    assert "lens.absorption_per_mm" in missed.remedy and "--base black" in missed.remedy


def test_the_budget_must_close_on_every_receiver():
    found = run(screens=[SCREEN, Screen.square(90.0, 200.0, PIXELS, 0.0)], names=("far", "near"))
    assert all(criterion.holds for criterion in stray_criteria(found))
    for number in (0, 1):
        for error, passed in ((0.99 * BALANCE, True), (1.01 * BALANCE, False)):
            receivers = list(found.receivers)
            receivers[number] = receivers[number].model_copy(update={"balance_error": error})
            balance = stray_criteria(found.model_copy(update={"receivers": tuple(receivers)}))[0]
            assert (balance.key, balance.holds) == ("stray_balance", passed)


def test_the_cover_glass_takes_of_stray_light_what_it_takes_of_all_light():
    """Direct light is that of the sequential path, whose cover glass other tests know; the rest is in the budget."""
    bare, covered = (
        run(media=Media(Medium(INDEX), cover_glass=glass)) for glass in (None, CoverGlass(1.52, 2.0, 30.0, 0.01))
    )
    seen = covered.first
    np.testing.assert_allclose(seen.direct, seen.sequential, rtol=1e-9, atol=1e-12)
    assert covered.flux.detected_direct == pytest.approx(covered.efficiency_sequential, rel=1e-9)
    assert covered.flux.cover_glass > 0.08 > bare.flux.cover_glass == 0.0
    assert covered.flux.detected_stray < 0.95 * bare.flux.detected_stray
    assert seen.balance_error < 1e-9


def test_bytes_that_are_no_mesh_are_input_error():
    with pytest.raises(InputError, match="STL: "):
        trace_stray(
            b"no mesh",
            rays=RAYS,
            media=Media(Medium(INDEX)),
            screens=[SCREEN],
        )
