"""The first table of the page: what was asked for, what came out, what is possible, and the judgement."""

import ast
from dataclasses import replace
from pathlib import Path

import pytest
from page_text import Page, text_of, undrawn_page_of
from result_folders import criterion, finding, make_results, small_lens

import lensforge
from lensforge.cad.part import UntrimmedSurfaces
from lensforge.cli.part_blocks import cutting_rows, solid_rows
from lensforge.light.evaluation_result import Light, LimitResult
from lensforge.report.asked_light_rows import light_rows
from lensforge.report.asked_table import asked_rows
from lensforge.report.cards import cards
from lensforge.report.criterion_words import criterion_words
from lensforge.report.numerals import number
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.search.scene_check import asked_light
from lensforge.shop.check_result import BallClearance, BaseBall, CustomBaseClearance
from lensforge.shop.drawing import tool_notes
from lensforge.shop.handover_files import face_facts
from lensforge.sources.build_source import build_source
from lensforge.spec import parse_spec
from lensforge.spec.source_sections import RayfileSource

WORST = {"fail": 2, "open": 1, "pass": 0, "": 0}
STATES = {"fail": "fail", "undecided": "open", "pass": "pass"}


def limited(state_value: float) -> tuple[Lens, LimitResult]:
    """A lens with a limit of 60 W/m^2 on the axis, and the judgement of a light of ``state_value`` there."""
    limit = {"kind": "points", "name": "HV", "at_mm": [[0, 0]], "unit": "w_per_m2", "at_least": 60.0}
    lens = small_lens()
    spec = parse_spec(lens.spec.model_dump(exclude_unset=True) | {"limits": [limit]}, "test")
    result = LimitResult(
        name="HV", receiver="light", quantity="light", value=Metric(value=state_value, unit="W/m²", standard_error=0.5),
        sense=">=", bound=60.0, unit="W/m²",
    )  # fmt: skip
    return Lens(lens.inner, lens.outer, spec, lens.seed, lens.accuracy), result


def test_the_table_is_the_first_on_the_page_and_has_asked_got_and_possible():
    page = Page(undrawn_page_of(make_results()))
    assert page.text.index("Figure") < page.text.index("Light in the target") < page.text.index("Scaled to the")
    assert page.tags.index("table") < page.tags.index("svg")
    share, pattern, window, *_ = asked_rows(make_results())
    assert (share.asked, share.passes, share.got) == (
        "–",
        "passes from 64.6\u2009%",
        "81.2\u2009% ± 0.030\u2009%",
    )
    assert (share.possible, share.law) == ("≤ 95.0\u2009%", "étendue")
    assert (pattern.asked, pattern.passes, pattern.possible) == ("–", "passes up to 0.1", "≥ 0.001")
    assert window.name == "Efficiency" and window.state == "", "nothing was asked"


@pytest.mark.parametrize("nmse", [0.05, 0.0995, 0.3])
@pytest.mark.parametrize("share", [0.3, 0.645, 0.8])
def test_without_limits_the_table_says_what_the_verdict_says(nmse, share):
    light = {
        "nmse": Metric(value=nmse, standard_error=1e-3),
        "share_in_target": Metric(value=share, standard_error=0.01),
    }
    results = make_results(evaluate=light)
    worst = max((row.state for row in light_rows(results)), key=WORST.__getitem__)
    assert worst == STATES[results.verdict.light]


@pytest.mark.parametrize(
    ("value", "state", "word"), [(65.0, "pass", "✓ pass"), (60.5, "open", "undecided"), (50.0, "fail", "✗ fail")]
)
def test_limits_come_first_and_alone_decide(value, state, word):
    lens, limit = limited(value)
    results = make_results(lens=lens, evaluate={"limits": (limit,), "nmse": Metric(value=0.9, standard_error=1e-3)})
    first, *others = light_rows(results)
    assert (first.name, first.note, first.asked, first.state) == ("HV", "irradiance", "≥ 60 W/m²", state)
    assert first.got == f"{value:g} ± 0.5 W/m²"
    assert not any(row.state or row.passes for row in others)
    assert word in text_of(results)


def test_sizes_are_judged_by_their_criteria():
    criteria = (criterion("cavity clearance", 0.5, -0.001, ">="), criterion("radius margin", -0.25, -0.001, ">="))
    verdicts = (finding("cutter", "inner", False, "a hollow is too tight"),)
    results = make_results(("design", "check"), design={"criteria": criteria}, check={"verdicts": verdicts})
    rows = {row.name: row for row in asked_rows(results)}
    assert results.verdict.cutting == "fail"
    assert rows["Lens, farthest point from the LED"].asked == "≤ 11 mm"
    assert rows["Lens, farthest point from the LED"].state == "fail"
    assert rows["Free space over the LED"].state == "pass"
    assert rows["Height above the LED"].asked == "–" and rows["Height above the LED"].state == ""
    assert rows["Thinnest wall"].asked == "≥ 1 mm"
    mill = rows["Ball mill that reaches every hollow"]
    assert (mill.asked, mill.got, mill.state) == ("radius 1 mm", "radius ≤ 0.77 mm", "fail")


def test_every_place_that_names_a_larger_ball_names_the_base_s_own():
    face = make_results().check.inner
    wide = face.model_copy(update={"cutter": face.cutter.model_copy(update={"largest_radius_mm": 1.92})})
    words = "; the base clears up to 1.04 mm, to within 0.004 mm"
    balls = (BaseBall(radius_mm=mm, within_mm=0.004) for mm in (1.0404, None))
    below, any_ball = (CustomBaseClearance(retreat_mm=0.0, flush_fraction=1.0, ball=ball) for ball in balls)
    for each, told in ((below, True), (any_ball, False), (None, False)):
        relief = BallClearance(outer=each, inner=each)
        results = make_results(check={"inner": wide, "outer": wide, "relief": relief})
        check, (row,) = results.check, [row for row in asked_rows(results) if row.name.startswith("Ball mill")]
        (card,) = (card for card in cards(results) if card.label == "Ball mill")
        screen, tables = dict(cutting_rows(check))["Inner face"], face_facts("inner", wide, relief)
        places = [row.note, card.note, screen, tool_notes(results.lens, check)[0]]
        places.append(tables["Largest ball that reaches the whole face"])
        assert [words in place for place in places] == 5 * [told]
        assert "at most 1.92 mm" in screen


def test_the_screen_names_the_file_with_the_scaled_faces_of_an_insert():
    spec = small_lens().spec.replace({"manufacture": {"make": "insert", "shrinkage": 0.006}})
    lens = replace(small_lens(), spec=spec)
    faces = UntrimmedSurfaces(runout_deg=5.0, scale=1.006, form_error_nm=1.0, normal_error_mrad=0.001)
    plain, scaled = (
        dict(solid_rows(make_results(lens=each).part.model_copy(update={"untrimmed_surfaces": with_faces})))
        for each, with_faces in ((small_lens(), None), (lens, faces))
    )
    without = dict(solid_rows(make_results(lens=lens).part))
    assert not {"Faces", "Insert"} & set(plain)
    assert scaled["Faces"].startswith("lens_surfaces.step: the optical faces times 1.006 for the mould insert")
    assert "lens.step is the moulded lens" in scaled["Faces"]
    assert "`lensforge export --runout DEG` writes the faces times 1.006" in without["Insert"]


def test_a_lens_alone_has_no_table():
    assert asked_rows(make_results(())) == []
    assert "Asked, got, possible" not in text_of(make_results(()))


def _criterion_names() -> set[str]:
    """Names that the modules of the library give their criteria, where they are written out."""
    found = set()
    for path in Path(lensforge.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            named = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
            if named and node.func.id in ("at_most", "at_least") and isinstance(node.args[0], ast.Constant):
                found.add(node.args[0].value)
    return found


def test_every_criterion_has_words():
    names = _criterion_names()
    assert len(names) > 20
    assert {name for name in names if criterion_words(name) in (name, name.replace("_", " "))} == set()
    assert criterion_words("far: form_error") == "far: form of the optical faces in the STEP file"
    assert criterion_words("of_tomorrow") == "of tomorrow"


def test_what_étendue_leaves_for_a_limit_stands_beside_it():
    lens, limit = limited(65.0)
    row, *_ = light_rows(make_results(lens=lens, evaluate={"limits": (limit,)}))
    _, (asked,) = asked_light(lens.spec, build_source(lens.spec.source))
    assert asked.possible > 60.0
    assert row.possible == f"≤ {number(asked.possible, 3)} W/m²" and row.law == "étendue"
    upper = limit.model_copy(update={"sense": "<=", "bound": 90.0})
    assert light_rows(make_results(lens=lens, evaluate={"limits": (upper,)}))[0].possible == "–"


def test_of_a_ray_file_that_is_elsewhere_nothing_is_said():
    lens, limit = limited(65.0)
    source = RayfileSource(file=Path("/somewhere/led.tm25ray"))
    lens = replace(lens, spec=lens.spec.model_copy(update={"source": source}))
    assert light_rows(make_results(lens=lens, evaluate={"limits": (limit,)}))[0].possible == "–"


@pytest.mark.parametrize(("least", "words"), [(0.0, "–"), (0.002, "≥ 0.002")])
def test_a_bound_that_says_nothing_is_not_shown(least, words):
    possible = make_results().find(Light).possible.model_copy(update={"nmse": least})
    _, pattern, *_ = asked_rows(make_results(evaluate={"possible": possible}))
    assert (pattern.asked, pattern.possible, bool(pattern.law)) == ("–", words, least > 0.0)
