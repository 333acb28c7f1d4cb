import pytest
from lens_meshes import DISTANCE, INDEX, lambertian, right

from lensforge.errors import InputError
from lensforge.optics.media import Media, Medium
from lensforge.proof.nonsequential_trace import Limits, trace_stray
from lensforge.proof.proof_result import BALANCE
from lensforge.proof.receiver_screen import Screen

SIDE = 300.0
PIXELS = 32
RAYS = lambertian(1500, 2.0, seed=7)
SCREEN = Screen.square(DISTANCE, SIDE, PIXELS, 0.0)
STL = right(30).export(file_type="stl")


def run(trace=trace_stray, **changes):
    given = {"rays": RAYS, "media": Media(Medium(INDEX)), "screens": [SCREEN]}
    return trace(STL, **{**given, **changes})


MADE_FROM = dict.fromkeys(("lens", "export"), "0" * 64)


def test_a_black_base_takes_light_that_a_polished_one_lets_go():
    polished, black = (run(base=base).flux for base in ("polished", "black"))
    assert polished.base == 0.0 < black.base
    assert black.detected_direct == pytest.approx(polished.detected_direct, rel=1e-12)
    assert black.outside_stray <= polished.outside_stray
    assert black.backward < polished.backward


def test_a_cut_off_that_leaves_too_much_out_fails():
    proof = run(limits=Limits(cut_off=0.1))
    (missed,) = [criterion for criterion in proof.criteria if not criterion.holds]
    assert missed.key == "stray_too_dim"
    assert "lens.absorption_per_mm" in missed.remedy and "--base black" in missed.remedy


def test_the_budget_must_close_on_every_receiver():
    proof = run(screens=[SCREEN, Screen.square(90.0, 200.0, PIXELS, 0.0)], names=("far", "near"))
    assert all(criterion.holds for criterion in proof.judge())
    for number in (0, 1):
        for error, passed in ((0.99 * BALANCE, True), (1.01 * BALANCE, False)):
            receivers = list(proof.receivers)
            receivers[number] = receivers[number].model_copy(update={"balance_error": error})
            balance, *_ = proof.changed(receivers=tuple(receivers)).judge()
            assert (balance.key, balance.holds) == ("stray_balance", passed)


def test_bytes_that_are_no_mesh_are_input_error():
    with pytest.raises(InputError, match="STL: "):
        trace_stray(b"no mesh", rays=RAYS, media=Media(Medium(INDEX)), screens=[SCREEN])
