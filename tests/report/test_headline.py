"""The top of the page: verdict, criteria, cards, and stages that are missing or out of date."""

from dataclasses import replace

import numpy as np
import pytest
from page_text import Page, text_of, undrawn_page_of
from result_folders import (
    STAGES,
    criterion,
    evaluate_arrays,
    finding,
    make_folder,
    make_results,
    page_of,
    small_lens,
)

from lensforge.report.cards import cards
from lensforge.report.headline import headline
from lensforge.report.numerals import number
from lensforge.results import Metric
from lensforge.runs.results import load_results


@pytest.fixture(scope="module")
def page():
    return Page(undrawn_page_of(make_results()))


def test_criteria_that_hold_are_said_to_hold(page):
    assert "All 9 criteria on light and files are met." in page.text
    table = page.text[page.text.index("All criteria") :]
    assert table.count("✓ pass") == 9


def test_the_three_verdicts_stand_at_the_top(page):
    for words in ("✓ Light: pass", "✓ Files: pass", "✓ Cutting: pass"):
        assert page.text.index(words) < page.text.index("All 9 criteria on light and files are met.")


def test_a_verdict_that_is_no_pass_comes_with_its_reason():
    worse = {"nmse": Metric(value=0.3, standard_error=0.001)}
    reason = "a ball of 1 mm radius reaches 75.0 % of the inner face"
    verdicts = (finding("cutter", "inner", False, reason),)
    text = text_of(make_results(evaluate=worse, check={"verdicts": verdicts}))
    assert "✗ Light: fail" in text
    assert "Light: NMSE = 0.3000 ± 0.0010, at most 0.1" in text
    assert "✗ Cutting: fail" in text
    sentence = "A ball of 1 mm radius reaches 75.0 % of the inner face."
    assert text.index("Asked, got, possible") < text.index(f"Cutting: fail {sentence}") < text.index("Peak irradiance")
    assert "All 9 criteria on light and files are met." in text, "they are another matter"
    assert "✓ Files: pass" in text


def test_what_has_not_run_leaves_a_verdict_undecided():
    text = text_of(make_results(("design",)))
    for words in ("Light: undecided", "Files: undecided", "Cutting: undecided"):
        assert words in text
    assert "Cutting: undecided The part has not been checked." in text


def test_headline_numbers_say_whether_they_are_what_was_asked_for():
    criteria = (
        criterion("cavity clearance", 0.5, -0.001, ">="),
        criterion("radius margin", -0.25, -0.001, ">="),
    )
    results = make_results(("design", "check"), design={"criteria": criteria})
    states = {card.label: card.state for card in cards(results)}
    assert states["Cavity clearance"] == "pass"
    assert states["Farthest from the LED"] == "fail"
    assert states["Thinnest wall"] == "pass"
    assert states["Ball mill"] == "open", "0.77 mm at most, the shop has 1 mm"
    assert states["Lens height"] == ""
    text = text_of(results)
    assert text.index("radius marginTry") < text.index("Lens, farthest point from the LED"), "what fails comes first"


def test_every_card_has_the_number_that_its_label_names():
    """All numbers of the records differ, the largest of an error from its rms, one ray sample from the other."""
    found = {card.label: (card.value, card.unit, card.note) for card in cards(make_results())}
    assert found == {
        "NMSE": ("0.0123", "", "± 0.0004; error of the pattern, 0 is perfect; with ray noise 0.0125"),
        "Efficiency": ("85.0\u2009%", "", "± 0.020\u2009%; of the emitted flux within 280 × 280 mm"),
        "Peak irradiance": (number(evaluate_arrays()["map"].max(), 3), "W/m²", "on the receiver"),
        "Farthest from the LED": ("10.75", "mm", "the lens without its base; at most 11 mm allowed"),
        "Lens height": ("10.5", "mm", "above the source plane, without the base"),
        "Cavity clearance": ("0.5", "mm", "to the 1 mm high, 3 mm wide keep-out space"),
        "Form error": ("1.8", "nm", "of the STEP file as read back; normals within 0.0075 mrad"),
        "Volume": ("3833.5", "mm³", "of the solid, base included"),
        "Ball mill": ("0.77", "mm", "largest radius that reaches all of both faces; the shop has 1 mm"),
        "Thinnest wall": ("1.875", "mm", "along the normal; required: 1 mm"),
        "Exported part": (
            "0.0225", "", "NMSE against the design, by 20\u2009000 rays through it; ray noise alone: 0.033",
        ),
    }  # fmt: skip


@pytest.mark.parametrize(("efficacy", "peak"), [(None, "42.5 W/m²"), (301.7, "12 800 lx")])
def test_light_is_in_watts_or_by_the_efficacy_in_lux(efficacy, peak):
    image = evaluate_arrays()["map"]
    image *= 42.5 / image.max()
    markup = page_of(make_results(("evaluate",), small_lens(lumens_per_watt=efficacy), evaluate={"map": image}))
    assert peak in Page(markup).text
    label = "illuminance (lx)" if efficacy else "irradiance (W/m²)"
    assert markup.count(label) >= 6, "three maps and three lines"
    assert ("irradiance (W/m²)" in markup) == (efficacy is None)


def test_the_level_is_the_mean_in_the_mask():
    image = np.arange(256.0).reshape(16, 16)
    changes = {"map": image, "uniformity": Metric(value=0.5), "rsd": Metric(value=0.25)}
    results = make_results(("evaluate",), small_lens(uniform_mm=100.0), evaluate=changes)
    found = {card.label: card for card in cards(results)}
    inside = slice(5, 11)  # pixels of 18.75 mm whose centres lie within 50 mm of the axis
    assert float(found["Mean irradiance"].value.replace("\u2009", "")) == pytest.approx(
        image[inside, inside].mean(), 0.01
    )
    assert found["Mean irradiance"].note == "in the mask of 100 mm"
    assert found["Uniformity"].value == "0.5"


def test_a_failed_criterion_comes_with_its_remedy():
    text = text_of(make_results(("export",), export={"criteria": (criterion("form_error", 12.5, 10.0),)}))
    assert "1 of 1 criterion on light and files is not met: form error." in text
    assert "Try: try something else." in text


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_has_not_run_is_one_sentence(stage):
    text = text_of(make_results([other for other in STAGES if other != stage]))
    assert text.count(f"There is no {stage}.json") == 1
    assert f"run lensforge {stage}." in text
    assert f"Not run yet: {stage}." in text


def test_an_outdated_stage_is_named_with_its_reason():
    why = "it was made from another lens; run `lensforge evaluate` again"
    text = text_of(make_results(("design", "export", "check", "verify", "photometry"), outdated={"evaluate": why}))
    assert f"evaluate.json does not count: {why}." in text
    assert "Out of date: evaluate." in text
    assert "Not run yet" not in text
    assert "There is no evaluate.json" not in text


def test_a_record_of_an_earlier_version_is_named_without_the_path_of_its_folder(tmp_path):
    make_folder(tmp_path)
    path = tmp_path / "evaluate.json"
    path.write_text(path.read_text(encoding="utf-8").replace("lensforge-evaluate-3", "lensforge-evaluate-2"))
    text = text_of(load_results(tmp_path), tmp_path)
    assert 'evaluate.json does not count: schema = "lensforge-evaluate-2"' in text
    assert str(tmp_path) not in text


def test_the_page_says_where_the_time_went():
    assert "Time: search 2.5 s, simulated light 1.2 s." in text_of(
        make_results(("design", "evaluate"), design={"seconds": 2.46}, evaluate={"seconds": 1.23})
    )


@pytest.mark.parametrize(("whole", "beside"), [(3.04, " (stages can run side by side)"), (9.04, "")])
def test_the_page_says_how_long_the_whole_command_took(whole, beside):
    results = make_results(("design", "evaluate"), design={"seconds": 2.46}, evaluate={"seconds": 1.23})
    wanted = f"Time: search 2.5 s, simulated light 1.2 s; the whole command, up to this page, {whole:.1f} s{beside}."
    assert wanted in text_of(replace(results, seconds=whole))


@pytest.mark.parametrize(("required", "words"), [(False, "Cutting fails (not required)."), (True, "Cutting fails.")])
def test_cutting_that_fails_says_whether_it_counts(required, words):
    verdicts = (finding("cutter", "inner", False, "no ball fits"),)
    results = make_results(check={"verdicts": verdicts})
    shop = results.spec.manufacture.model_copy(update={"required": required})
    spec = results.spec.model_copy(update={"manufacture": shop})
    found = headline(replace(results, lens=replace(results.lens, spec=spec)))
    assert found.sentence.startswith(words)
    assert found.shown == ("fail" if required else "open")
