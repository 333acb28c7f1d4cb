"""The top of the page: verdict, criteria, cards, and stages that are missing or out of date."""

from dataclasses import replace

import pytest
from page_text import text_of
from result_folders import criterion, evaluate_arrays, finding, make_folder, make_results, small_lens, text_target

from lensforge.cli.conclusion import _manufacture, _of_mould, _title
from lensforge.report.headline import headline, required_facts
from lensforge.report.stored import load_results
from lensforge.results import Metric
from lensforge.shop.check_result import InscribedBall, Mould, PartingLine


def test_a_verdict_that_is_no_pass_comes_with_its_reason():
    worse = {"nmse": Metric(value=0.3, standard_error=0.001)}
    reason = "a ball of 1 mm radius reaches 75.0 % of the inner face"
    verdicts = (finding("cutter", "inner", False, reason),)
    text = text_of(make_results(evaluate=worse, check={"verdicts": verdicts}))
    assert "✗ Photometry: fail" in text
    assert "Photometry: Pattern error (NMSE) = 0.3000 ± 0.0010, must be ≤ 0.1: a larger lens" in text
    assert "✗ Manufacture: fail" in text
    sentence = "A ball of 1 mm radius reaches 75.0 % of the inner face."
    assert (
        text.index("Required and achieved")
        < text.index(f"Manufacture: fail {sentence}")
        < text.index("Peak irradiance")
    )
    assert "All 30 criteria on simulation and files are met; the required light is not." in text, "another matter"
    assert "✓ CAD files: pass" in text


def test_what_has_not_run_leaves_a_verdict_undecided():
    text = text_of(make_results(("design",)))
    for words in ("Photometry: undecided", "CAD files: undecided", "Manufacture: undecided"):
        assert words in text
    assert "Manufacture: undecided The part has not been checked." in text


def test_what_was_asked_for_says_whether_it_came_out():
    criteria = (criterion("cavity clearance", 0.5, -0.001, ">="), criterion("radius margin", -0.25, -0.001, ">="))
    verdicts = (finding("cutter", "inner", False, "no"),)
    results = make_results(("design", "check"), design={"criteria": criteria}, check={"verdicts": verdicts})
    states = {fact.label: fact.state for fact in required_facts(results)}
    assert states == {
        "Outer radius": "fail",
        "Height above the LED": "",
        "Cavity clearance": "pass",
        "Thinnest wall": "pass",
        "Largest ball, inner face": "fail",
        "Largest ball, outer face": "",
    }
    text = text_of(results)
    assert text.index("radius marginTry") < text.index("Outer radius"), "what fails comes first"


@pytest.mark.parametrize(("ratio", "gate", "told"), [(2.9, "base", []), (3.1, None, ["Gate", "Max/min thickness"])])
def test_what_a_moulder_would_ask_stands_at_the_top_and_on_the_screen(ratio, gate, told):
    """Where it is amber; thicker than thrice the thinnest wall it may sink."""
    results = make_results(("design", "check"))
    line = PartingLine(places=("outer",), radius_mm=5.0, low_mm=2.0, high_mm=2.0)
    ball = InscribedBall(diameter_mm=ratio * results.check.min_wall_mm, centre_mm=(0.0, 0.0, 1.0))
    mould = Mould(faces={}, parting=line, thickest=ball, gate=gate, cooling_s=None)
    found = {**results.found, "check": results.check.model_copy(update={"mould": mould})}
    of_mould = {"Parting line", "Gate", "Thickest place", "Max/min thickness", "Cooling time"}
    for labels in (
        [fact.label for fact in required_facts(replace(results, found=found))],
        [label for label, _ in _manufacture(replace(results, found=found))],
    ):
        assert [label for label in labels if label in of_mould] == told
    look = f"; look at: {', '.join(told).lower()}" if told else ""
    assert _title("cutting", "pass", _of_mould(replace(results, found=found))) == f"Manufacture: pass{look}"


@pytest.mark.parametrize(("aim", "shown"), [("pattern", ["nmse", "share_in_target"]), ("share", ["share_in_target"])])
def test_where_only_the_share_counts_no_error_of_the_pattern_is_shown(aim, shown):
    results = make_results(lens=small_lens(wanted={"target": text_target("+", None), "optimise": {"aim": aim}}))
    keys = [fact.key for fact in required_facts(results)]
    assert [key for key in keys if key in ("nmse", "share_in_target")] == shown
    assert ("Pattern error by level" in text_of(results)) == ("nmse" in shown)


@pytest.mark.parametrize(("efficacy", "peak"), [(301.7, "12 800 lx"), (None, "42.5 W/m²")])
def test_light_is_in_watts_or_by_the_efficacy_in_lux(efficacy, peak):
    image = evaluate_arrays()["map"]
    image *= 42.5 / image.max()
    assert peak in text_of(make_results(("evaluate",), small_lens(lumens_per_watt=efficacy), evaluate={"map": image}))


def test_an_outdated_stage_is_named_with_its_reason():
    why = "it was made from another lens; run `lensforge evaluate` again"
    text = text_of(make_results(("design", "export", "check", "verify", "photometry"), outdated={"evaluate": why}))
    assert f"evaluate.json is out of date and ignored: {why}." in text
    assert "Out of date: evaluate." in text
    assert "Not run yet" not in text
    assert "There is no evaluate.json" not in text


def test_a_record_of_an_earlier_version_is_named_without_the_path_of_its_folder(tmp_path):
    make_folder(tmp_path)
    path = tmp_path / "evaluate.json"
    path.write_text(path.read_text(encoding="utf-8").replace("lensforge-evaluate-3", "lensforge-evaluate-2"))
    text = text_of(load_results(tmp_path), tmp_path)
    assert 'evaluate.json is out of date and ignored: schema = "lensforge-evaluate-2"' in text
    assert str(tmp_path) not in text


@pytest.mark.parametrize(
    ("required", "words"), [(False, "Manufacture fails (not required)."), (True, "Manufacture fails.")]
)
def test_cutting_that_fails_says_whether_it_counts(required, words):
    verdicts = (finding("cutter", "inner", False, "no ball fits"),)
    results = make_results(check={"verdicts": verdicts})
    shop = results.spec.manufacture.model_copy(update={"required": required})
    spec = results.spec.model_copy(update={"manufacture": shop})
    found = headline(replace(results, lens=replace(results.lens, spec=spec)))
    assert found.sentence.startswith(words)
    assert found.shown == ("fail" if required else "open")
