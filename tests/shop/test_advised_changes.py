"""The remedy of each finding that does not hold, on both sides of what a spec takes."""

import re

import pytest
from scenes import small_spec
from test_findings import NO_BASE, cutter, face, tool

from lensforge.shop.check_result import Finding
from lensforge.shop.findings import (
    check_findings,
    cutter_finding,
    draft_finding,
    tilt_finding,
    tool_finding,
    wall_finding,
)

WIDER = "lens.outer.concave_radius_mm = 1 and design again"
SMALLER = "manufacture.cutter_radius_mm = 0.279"


def test_a_thin_wall_is_designed_again_or_taken_as_it_is() -> None:
    spec = small_spec(constraints__min_thickness_mm=1.5)
    again = "a larger lens.outer.offset_mm and design again"
    there = f"{again}, or constraints.min_thickness_mm = 1.432 where that is enough"
    assert wall_finding(1.4329, spec).remedy == there
    assert wall_finding(1.4329, spec.replace({"constraints.min_thickness_mm": 1.432})).holds
    assert wall_finding(-11.42, spec).remedy == again
    assert wall_finding(1.5, spec).remedy == ""


@pytest.mark.parametrize(
    ("make", "kept", "expected"),
    [
        ("part", {}, f"{WIDER}, or {SMALLER}"),
        ("insert", {}, SMALLER),
        ("part", {"lens__outer__concave_radius_mm": 1.0}, SMALLER),
        ("part", {"lens__outer__concave_radius_mm": 0.9}, f"{WIDER}, or {SMALLER}"),
    ],
)
def test_a_smaller_ball_or_a_search_for_wider_hollows_is_advised(make, kept, expected) -> None:
    spec = small_spec(manufacture__make=make, manufacture__cutter_radius_mm=1.0, **kept)
    assert cutter_finding("outer", cutter(1.0, 0.27949), NO_BASE, spec).remedy == expected
    assert cutter_finding("outer", cutter(0.279, 0.27949), NO_BASE, spec).holds, "as advised"


@pytest.mark.parametrize(
    ("allowed", "steepest", "expected"),
    [
        (90.0, 95.05, "lens.inner.draft_deg = 0 and design again, or manufacture.max_tilt_deg = 95.1"),
        (65.0, 95.0, "lens.inner.draft_deg = 25 and design again, or manufacture.max_tilt_deg = 95"),
        (64.9, 95.0, "manufacture.max_tilt_deg = 95"),
        (95.0, 119.99, "manufacture.max_tilt_deg = 120"),
        (95.0, 120.0, ""),
        (95.0, 130.0, ""),
    ],
)
def test_more_draft_or_more_tilt_is_advised_as_far_as_a_spec_takes_it(allowed, steepest, expected) -> None:
    found = tilt_finding("inner", steepest, small_spec(manufacture__max_tilt_deg=allowed))
    assert found.remedy == expected
    for wide in re.findall(r"max_tilt_deg = ([\d.]+)", expected):
        assert tilt_finding("inner", steepest, small_spec(manufacture__max_tilt_deg=float(wide))).holds


def test_the_draft_of_a_mould_or_of_the_spec_is_asked_of_the_search() -> None:
    mould = small_spec(manufacture__make="insert")
    assert draft_finding("outer", face(1.0), mould).remedy == "lens.outer.draft_deg = 2 and design again"
    kept = draft_finding("outer", face(1.0), small_spec(lens__outer__draft_deg=3.0))
    assert not kept.holds and kept.remedy == "", "the search has kept it"


@pytest.mark.parametrize(
    ("ball", "whole", "largest_mm", "expected"),
    [
        (0.8, 0.8, 0.456789, "a tool in manufacture.tools with radius_mm = 0.456 or less"),
        (0.8, 0.8, 0.5, ""),
        (0.8, 0.7, 0.5, "a tool with length_mm above 8"),
        (0.8, 0.7, None, "a tool with length_mm above 8"),
        (0.8, 0.7, 0.3, "a tool in manufacture.tools with radius_mm = 0.3 or less, or a tool with length_mm above 8"),
    ],
)
def test_a_smaller_or_a_longer_tool_is_advised_by_what_limits_it(ball, whole, largest_mm, expected) -> None:
    found = tool(ball, whole)
    assert tool_finding(found, "inner", found.faces["inner"], largest_mm).remedy == expected
    assert tool_finding(found, "outer", found.faces["outer"], None).remedy == "", "it holds"


def test_each_tool_is_judged_by_the_face_that_it_is_to_reach() -> None:
    spec = small_spec()
    hollow = face(90.0).model_copy(update={"cutter": cutter(0.1, 0.3)})
    found = check_findings(spec, {"inner": hollow, "outer": face(90.0)}, 1.0, NO_BASE, (tool(0.8, 0.8),))
    inner, outside = (each for each in found if each.name == "tool")
    assert isinstance(inner, Finding) and "radius_mm = 0.3 or less" in inner.remedy and not inner.holds
    assert outside.holds and outside.surface == "outer"
