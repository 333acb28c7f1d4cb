"""Advice of the check: the fields that it names exist, and their values make the finding hold."""

import re

import pytest
from scenes import small_spec
from test_findings import NO_BASE

import lensforge as lf
from lensforge.shop.check_facts import finding_groups
from lensforge.shop.check_result import Cutter, FaceName, Finding
from lensforge.shop.findings import advice, cutter_finding, tilt_finding
from lensforge.spec import Spec

_CHANGE = re.compile(r"([a-z]+\.[a-z_]+) = ([\d.]+)")


def changes(finding: Finding, spec: Spec, check: lf.Check) -> dict[str, float]:
    """Fields and values that the advice names."""
    return {field: float(value) for field, value in _CHANGE.findall(advice(finding, spec, check))}


def cutter(radius_mm: float, largest_mm: float) -> Finding:
    found = Cutter(
        radius_mm=radius_mm,
        reachable_fraction=0.69,
        local_ok_fraction=0.7,
        largest_radius_mm=largest_mm,
        residual_mm=0.1,
    )
    return cutter_finding("inner", found, NO_BASE)


def test_a_ball_of_the_advised_radius_reaches_all(small_run: lf.Run) -> None:
    spec, largest = small_spec(), 0.27949
    found = changes(cutter(1.0, largest), spec, small_run.check)
    assert set(found) == {"constraints.inner_concave_radius_mm", "manufacture.cutter_radius_mm"}
    assert found["constraints.inner_concave_radius_mm"] == 1.0
    advised = spec.replace({"manufacture.cutter_radius_mm": found["manufacture.cutter_radius_mm"]})
    assert cutter(advised.manufacture.cutter_radius_mm, largest).holds
    assert found["manufacture.cutter_radius_mm"] > largest - 2e-3, "hardly smaller than the largest"


@pytest.mark.parametrize("surface", ["inner", "outer"])
@pytest.mark.parametrize("allowed", [90.0, 75.0, 30.0])
def test_a_machine_that_tilts_as_advised_is_enough(small_run: lf.Run, surface: FaceName, allowed: float) -> None:
    spec, steepest = small_spec(manufacture__max_tilt_deg=allowed), 97.684
    found = changes(tilt_finding(surface, steepest, allowed), spec, small_run.check)
    assert tilt_finding(surface, steepest, found["manufacture.max_tilt_deg"]).holds
    draft = found.get(f"constraints.{surface}_draft_deg")
    assert (draft is None) == (allowed < 65.0), "a spec takes a draft of 25 degrees at most"
    assert draft is None or draft + allowed == 90.0


def test_what_the_search_has_kept_already_is_not_advised_again(small_run: lf.Run) -> None:
    spec = small_spec(constraints__inner_concave_radius_mm=1.0, manufacture__cutter_radius_mm=1.0)
    assert set(changes(cutter(1.0, 0.9), spec, small_run.check)) == {"manufacture.cutter_radius_mm"}


def test_what_holds_needs_no_advice(small_run: lf.Run) -> None:
    assert advice(cutter(0.2, 0.3), small_spec(), small_run.check) == ""


def test_every_finding_is_a_sentence_on_its_face(small_run: lf.Run) -> None:
    check = small_run.check
    facts = [fact for group in finding_groups(check, small_run.spec) for fact in group.facts]
    for finding in check.verdicts:
        shown = [fact for fact in facts if fact.note == finding.reason]
        assert len(shown) == (0 if finding.name == "draft" else 1), finding.reason
        assert all((fact.value, fact.state) == (("yes", "pass") if finding.holds else ("no", "fail")) for fact in shown)
