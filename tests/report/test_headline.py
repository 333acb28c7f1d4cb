"""The top of the page: verdict, criteria, cards, and stages that are missing or out of date."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from page_text import text_of
from result_folders import criterion, evaluate_arrays, finding, make_folder, make_results, small_lens, text_target
from tir_lenses import spot

from lensforge.cad.part import included_holders
from lensforge.cli.conclusion import _manufacture, _of_mould, _title
from lensforge.report.headline import headline, required_facts
from lensforge.report.stored import load_results
from lensforge.results import Fact, Group, Metric
from lensforge.results.criteria import at_least
from lensforge.shop.check_facts import shape_facts
from lensforge.shop.check_measures import InscribedBall, Mould, MouldedFace, PartingLine


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
    assert "All 39 criteria on simulation and files are met; the required light is not." in text, "another matter"
    assert "✓ CAD files: pass" in text


def test_what_has_not_run_leaves_a_verdict_undecided():
    text = text_of(make_results(("design",)))
    for line in ("Photometry: undecided", "CAD files: undecided", "Manufacture: undecided"):
        assert line in text
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
    records = {**results.found, "check": results.check.model_copy(update={"mould": mould})}
    of_mould = {"Parting line", "Gate", "Thickest place", "Max/min thickness", "Cooling time"}
    for labels in (
        [fact.label for fact in required_facts(replace(results, found=records))],
        [label for label, _ in _manufacture(replace(results, found=records))],
    ):
        assert [label for label in labels if label in of_mould] == told
    look = f"; look at: {', '.join(told).lower()}" if told else ""
    assert _title("cutting", "pass", _of_mould(replace(results, found=records))) == f"Manufacture: pass{look}"


def test_of_a_moulded_lens_the_worst_face_stands_at_the_top():
    """The smallest nose, the least of the draft over what is asked, the least released; not a row for each face."""
    check = make_results(("design", "check")).check
    face = MouldedFace(upper_fraction=1.0, lower_fraction=0.0, undercut_fraction=0.0, draft_deg=3.0)
    mould = SimpleNamespace(faces={"inner": face, "outer": face})
    facts = [
        Fact("inner_nose", "", "any", "mm", limit=0.5), Fact("outer_nose", "", 0.7, "mm", limit=0.5),
        Fact("inner_draft", "", 1.9, "°", limit=1.0), Fact("outer_draft", "", 2.5, "°", limit=2.0),
        Fact("inner_drawn", "", 99.0, "%"), Fact("outer_drawn", "", 100.0, "%"), Fact("other", "", 0.0),
    ]  # fmt: skip
    groups = [Group("any", "", tuple(facts))]
    moulded = check.model_copy(update={"mould": mould})
    assert [fact.key for fact in shape_facts(moulded, groups)] == ["outer_nose", "outer_draft", "inner_drawn"]
    assert [fact.key for fact in shape_facts(check, groups)] == ["inner_nose", "outer_nose"]


def test_a_limit_that_is_kept_by_its_tolerance_alone_shows_it():
    for value, text in ((-0.0004, "≥ 0 deg, within 0.01 deg"), (0.0004, "≥ 0 deg"), (-0.5, "≥ 0 deg")):
        assert at_least("side draft margin", value, 0.0, "deg", "", 0.01).required == text
    assert at_least("side draft margin", 28.0, 0.0, "deg", "").label.endswith(
        "counted to 30° at most, above its minimum"
    )


@pytest.mark.parametrize(
    ("base", "flange", "holders"),
    [("none", False, ""), ("none", True, ", flange included"), ("cylinder", False, ", base included")],
)
def test_only_a_base_that_there_is_counts_as_included(base, flange, holders):
    spec = spot(**({"flange": {"diameter_mm": 20.0, "thickness_mm": 1.0}} if flange else {}))
    made = {"kind": base} if base == "none" else {"kind": base, "diameter_mm": 14.0, "height_mm": 2.0}
    assert included_holders(spec.replace(base=made)) == holders


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
    ("required", "beginning"), [(False, "Manufacture fails (not required)."), (True, "Manufacture fails.")]
)
def test_cutting_that_fails_says_whether_it_counts(required, beginning):
    verdicts = (finding("cutter", "inner", False, "no ball fits"),)
    results = make_results(check={"verdicts": verdicts})
    shop = results.spec.manufacture.model_copy(update={"required": required})
    spec = results.spec.model_copy(update={"manufacture": shop})
    summary = headline(replace(results, lens=replace(results.lens, spec=spec)))
    assert summary.sentence.startswith(beginning)
    assert summary.shown == ("fail" if required else "open")
