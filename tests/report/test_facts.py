"""Facts against the records that they are of: label, value, unit, limit and state; and what a fact says of itself."""

from contextlib import nullcontext
from dataclasses import replace

import pytest
from addon_rows import addon_rows
from pydantic import TypeAdapter, ValidationError
from shown_folders import FOLDERS, folder_of, make_sensitivity

from lensforge.cad.part import part_facts
from lensforge.errors import CriterionMissed
from lensforge.light.evaluation_result import LightMetrics
from lensforge.light.light_facts import change_facts
from lensforge.made.yield_facts import sensitivity_facts
from lensforge.results import Fact, Group, Metric, Record
from lensforge.results.criteria import Criteria, at_least, at_most, missed, require
from lensforge.results.figure import facts_in
from lensforge.results.record import values_of
from lensforge.results.verdict import Verdict, judge, worst


def numbers_of(value):
    """Every number of a record or a spec, arrays by their peaks."""
    if isinstance(value, Record):
        for name in type(value).model_computed_fields:
            yield from numbers_of(getattr(value, name))
        yield from numbers_of(values_of(value))
    elif isinstance(value, dict | Fact):
        for entry in (vars(value) if isinstance(value, Fact) else value).values():
            yield from numbers_of(entry)
    elif isinstance(value, tuple | list):
        yield len(value)
        for entry in value:
            yield from numbers_of(entry)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)
    elif hasattr(value, "max"):
        yield float(value.max())


@pytest.mark.parametrize("name", FOLDERS)
def test_the_value_of_every_fact_is_one_of_its_record(name):
    """No two numbers of a folder are alike: a fact with the number of another fact, or in another unit, is noticed."""
    results = folder_of(name)
    efficacy = (results.light.lumens_per_watt if "evaluate" in results.found else None) or 1.0
    spec = [*numbers_of(results.spec.model_dump()), results.spec.manufacture.scale, results.spec.photometry.lenses]
    spec += [] if results.spec.lens.density is None else [results.spec.lens.density.g_per_cm3]
    for result in (*results.found.values(), *results.others.values()):
        known = [*numbers_of(result), *spec]
        known += [factor * number for number in known for factor in (100.0, 1e3, efficacy)]
        if result.stage == "yield":
            known += [100.0 * float(bound.kept_by(result.column(bound.metric)).mean()) for bound in result.bounds]
        for group in results.facts(result):
            for fact in group.facts:
                limit = None if fact.key == "share_in_target" else fact.limit  # a part of what is possible
                for value in (fact.value, fact.standard_error, limit):
                    if isinstance(value, int | float):
                        assert any(value == pytest.approx(number, rel=1e-12) for number in known), (group.title, fact)


# Key of a fact, its label, its unit, and the number of the record.
TOLD = (
    ("nmse", "Pattern error (NMSE)", "", lambda r: r.light.first.nmse.value),
    ("efficiency", "Efficiency", "%", lambda r: 100.0 * r.light.first.efficiency.value),
    ("share_in_target", "Light in the target", "%", lambda r: 100.0 * r.light.first.share_in_target.value),
    ("radius", "Outer radius", "mm", lambda r: r.design.max_radius_mm),
    ("height", "Height above the LED", "mm", lambda r: r.design.height_mm),
    ("cavity", "Cavity clearance", "mm", lambda r: r.design.constraints.cavity_clearance_mm),
    ("form_error", "Form error", "nm", lambda r: r.part.form_error_nm.max),
    ("normal_error", "Error of the normals", "mrad", lambda r: r.part.normal_error_mrad.max),
    ("volume", "Volume", "mm³", lambda r: r.part.volume_mm3),
    ("inner_ball", "Largest ball, inner face", "mm", lambda r: r.check.inner.cutter.largest_radius_mm),
    ("outer_ball", "Largest ball, outer face", "mm", lambda r: r.check.outer.cutter.largest_radius_mm),
    ("inner_reached", "Ball reaches", "%", lambda r: 100.0 * r.check.inner.cutter.reachable_fraction),
    ("inner_concave", "Min. concave radius", "mm", lambda r: r.check.inner.curvature.smallest_concave_radius_mm),
    ("outer_tilt", "Max. tool tilt", "°", lambda r: r.check.outer.largest_tilt_deg),
    ("outer_draft", "Draft, outer face", "°", lambda r: r.check.outer.draft_deg.min),
    ("outer_sphere", "Best-fit sphere", "mm", lambda r: r.check.outer.best_fit_sphere.radius_mm),
    ("outer_departure", "Departure, PV", "µm", lambda r: 1e3 * r.check.outer.best_fit_sphere.pv_mm),
    ("outer_departure_rms", "Departure, rms", "µm", lambda r: 1e3 * r.check.outer.best_fit_sphere.rms_mm),
    ("thinnest", "Thinnest wall", "mm", lambda r: r.check.min_wall_mm),
    ("thickest", "Thickest wall", "mm", lambda r: r.check.walls.thickest.thickness_mm),
    ("landing", "Ray displacement", "µm", lambda r: 1e3 * r.proof.deviation_mm.rms),
    ("nmse_vs_design", "NMSE against the design", "", lambda r: r.proof.first.nmse_vs_design),
    ("nmse_same_rays", "NMSE with the same rays", "", lambda r: r.proof.first.nmse_same_rays),
    ("part_efficiency", "Efficiency of the part", "%", lambda r: 100.0 * r.proof.first.efficiency),
    ("exit_lm", "Luminous flux", "lm", lambda r: r.photometry.exit_lm.value),
    ("peak_cd", "Peak intensity", "cd", lambda r: r.photometry.peak_cd.value),
    ("axis_cd", "Intensity on the axis", "cd", lambda r: r.photometry.axis_cd.value),
    ("beam_C 90", "Beam angle, C 90", "°", lambda r: r.photometry.beam_c90.beam_angle_deg.value),
    ("field_C 0", "Field angle, C 0", "°", lambda r: r.photometry.beam_c0.field_angle_deg.value),
    ("detected_stray", "Stray light in window", "%", lambda r: 100.0 * r.found["stray"].first.flux.detected_stray),
    ("stray_absorbed", "Absorbed", "%", lambda r: 100.0 * r.found["stray"].first.flux.absorbed),
    ("misplaced", "Misplaced flux", "%", lambda r: 100.0 * r.found["stray"].first.misplaced_flux),
    ("pass_rate", "Yield", "%", lambda r: 100.0 * r.found["yield"].pass_rate.value),
    *((key, *row) for key, row in addon_rows("FACTS").items()),
)


@pytest.mark.parametrize(
    ("changes", "suffix"),
    [
        ({}, ""),
        ({"photometry": {"lenses": 3}}, " of a lens"),
        ({"lamps": {"kind": "table", "places_mm": [[-30.0, 0.0], [0.0, 0.0], [30.0, 0.0]]}}, " of a lens"),
    ],
)
def test_the_size_of_one_of_several_lenses_is_called_that(changes, suffix):
    part = folder_of("every stage").part
    several = part.changed(lens=replace(part.lens, spec=part.lens.spec.replace(changes)))
    facts = {fact.key: fact.label for group in part_facts(several) for fact in group.facts}
    assert facts["volume"] == f"Volume{suffix}"


@pytest.fixture(scope="module")
def told():
    results = folder_of("every stage")
    facts = [fact for record in results.found.values() for group in results.facts(record) for fact in group.facts]
    return results, facts


@pytest.mark.parametrize(("key", "label", "unit", "value"), TOLD, ids=[row[0] for row in TOLD])
def test_a_fact_has_the_number_that_its_label_names(told, key, label, unit, value):
    results, facts = told
    fact = next(fact for fact in facts if fact.key == key)
    assert (fact.label, fact.unit) == (label, unit)
    assert fact.value == pytest.approx(value(results), rel=1e-15)


@pytest.mark.parametrize(
    ("value", "error", "state"),
    [(0.5, 0.0, "pass"), (1.0, 0.0, "pass"), (1.1, 0.0, "fail"), (0.9, 0.1, "undecided"), (1.1, 0.1, "undecided"),
     (0.7, 0.1, "pass"), (1.3, 0.1, "fail"), (0.5, None, "undecided"), (None, 0.0, "fail")],
)  # fmt: skip
def test_values_are_judged_in_one_place(value, error, state):
    assert judge(value, "<=", 1.0, error) == state
    assert judge(None if value is None else -value, ">=", -1.0, error) == state


def test_a_failure_outweighs_a_doubt():
    outcomes = [worst(states) for states in (("pass", "undecided"), ("undecided", "fail"), ())]
    assert outcomes == ["undecided", "fail", "pass"]


def test_a_mean_square_below_nothing_is_at_most_its_error_and_a_change_is_what_it_is() -> None:
    below = Metric(value=-0.0012, standard_error=0.0031)
    nmse = LightMetrics(nmse=below, uniformity=None, rsd=None, efficiency=Metric(value=0.8, standard_error=0.01))
    assert next(fact.text for fact in facts_in(nmse)) == "≤ 0.0031"
    study = make_sensitivity()
    _, of_row = sensitivity_facts(study.changed(rows=(study.rows[0].changed(change=nmse),)))
    assert of_row.fact("nmse").text == next(fact.text for fact in change_facts(nmse)) == "−0.0012 ± 0.0031"


def test_a_fact_says_value_limit_and_reason():
    metric = Metric(value=0.123, standard_error=0.004)
    fact = Fact.measured("nmse", "NMSE", metric, "a note", limit=0.1, remedy="try this")
    assert (fact.text, fact.required, fact.bounded_by) == ("0.1230 ± 0.0040", "≤ 0.1", "–")
    assert fact.sentence == "0.1230 ± 0.0040 (required ≤ 0.1); a note"
    assert fact.reason == "NMSE = 0.1230 ± 0.0040, must be ≤ 0.1: try this"
    assert fact.plain() == {
        "key": "nmse", "label": "NMSE", "value": 0.123, "unit": "", "standard_error": 0.004, "limit": "<= 0.1",
        "state": "fail", "note": "a note",
    }  # fmt: skip
    assert Fact.share("a", "A", 0.8765, sense=">=", limit=0.9).sentence == "87.65\u2009% (required ≥ 90\u2009%)"
    assert Fact("a", "A", None, "mm", limit=1.0).text == "not measured"


@pytest.mark.parametrize(
    ("value", "error", "state"),
    [
        (0.79, 0.1, "pass"),
        (0.81, 0.1, "undecided"),
        (1.19, 0.1, "undecided"),
        (1.21, 0.1, "fail"),
        (1.19, None, "fail"),
    ],
)
def test_a_criterion_with_a_standard_error_can_be_undecided(value, error, state):
    """Which is no failure: nothing is required of it, and the verdict on its files is undecided."""
    judged = [at_most("gap", value, 1.0, "mm", "look again", error=error),
              at_least("gap", -value, -1.0, "mm", "look again", error=error)]  # fmt: skip
    assert [limit.state for limit in judged] == [state] * 2
    assert [outcome for outcome, _ in missed(judged)] == [state] * 2 * (state != "pass")
    with nullcontext() if state != "fail" else pytest.raises(CriterionMissed, match=r"missed by .* mm; look again"):
        require(judged)
    assert ("too close to tell" in str(judged[0])) == (state == "undecided")
    assert Verdict.of([], list(missed(judged)), []).files == state
    records = TypeAdapter(Criteria)
    stored = records.dump_python(tuple(judged), mode="json")
    assert [("standard_error" in record, record["passed"]) for record in stored] == [
        (error is not None, state == "pass")
    ] * 2
    assert records.validate_python(stored) == tuple(judged)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"passed": False}, "passed: not as it follows"),
        ({"limit": None}, "limit: must be a number"),
        ({"value": "0.5"}, "value: must be a number"),
        ({"held": True}, "held: no such entry"),
        ({"unit": ...}, "unit: missing"),
        ({"sense": "<"}, "should be '<=' or '>='"),
    ],
)
def test_a_stored_criterion_is_what_its_entries_make(changes, message):
    records = TypeAdapter(Criteria)
    (stored,) = records.dump_python((at_most("gap", 0.5, 1.0, "mm", "look again"),), mode="json")
    forged = {name: entry for name, entry in {**stored, **changes}.items() if entry is not ...}
    with pytest.raises(ValidationError, match=message):
        records.validate_python([forged])


def test_a_group_selects_in_order_and_fits_in_a_line():
    group = Group("g", "G", tuple(Fact(key, key.upper(), value, "mm") for key, value in (("a", 1.5), ("b", 2.5))))
    assert group.select("b", "c", "a").line == "B 2.5 mm, A 1.5 mm"
