"""Advice on each finding that does not hold, on both sides of what a spec takes."""

import pytest
from scenes import small_spec
from test_findings import BASE, NO_BASE, cutter, face, outer, tool

from lensforge.shop.check_result import BallClearance, Check, Finding, ToolResult
from lensforge.shop.findings import (
    advice,
    clearance_findings,
    cutter_finding,
    draft_finding,
    tilt_finding,
    tool_findings,
    wall_finding,
)

WIDER = "constraints.outer_concave_radius_mm = 1 and design again"
SMALLER = "manufacture.cutter_radius_mm = 0.279"


def with_tools(*tools: ToolResult) -> Check:
    return Check.model_construct(tools=tools)


def test_a_thin_wall_is_designed_again_or_taken_as_it_is() -> None:
    spec = small_spec(constraints__min_thickness_mm=1.5)
    missing = Finding(name="wall", surface="body", value=None, sense=">=", limit=1.5, unit="mm", reason="none")
    again = "a larger lens.outer_offset_mm and design again"
    assert advice(missing, spec, with_tools()) == again
    there = f"{again}, or constraints.min_thickness_mm = 1.432 where that is enough"
    assert advice(wall_finding(1.4329, spec), spec, with_tools()) == there
    lower = spec.replace({"constraints.min_thickness_mm": 1.432})
    assert wall_finding(1.4329, lower).holds
    assert advice(wall_finding(-11.42, spec), spec, with_tools()) == again
    assert advice(wall_finding(1.5, spec), spec, with_tools()) == ""


def test_a_reason_of_the_relief_is_advice_enough() -> None:
    (found,) = clearance_findings(BallClearance(outer=outer(0.5), inner=None), BASE)
    assert advice(found, small_spec(), with_tools()) == ""


@pytest.mark.parametrize(
    ("make", "kept", "expected"),
    [
        ("part", {}, f"{WIDER}, or {SMALLER}"),
        ("insert", {}, SMALLER),
        ("part", {"constraints__outer_concave_radius_mm": 1.0}, SMALLER),
        (
            "part",
            {"constraints__outer_concave_radius_mm": 0.9},
            f"{WIDER}, or {SMALLER}",
        ),
    ],
)
def test_a_smaller_ball_or_a_search_for_wider_hollows_is_advised(make, kept, expected) -> None:
    spec = small_spec(manufacture__make=make, manufacture__cutter_radius_mm=1.0, **kept)
    assert advice(cutter_finding("outer", cutter(1.0, 0.27949), NO_BASE), spec, with_tools()) == expected
    unknown = Finding(name="cutter", surface="outer", value=None, sense="<=", limit=None, unit="mm", reason="none")
    assert "cutter_radius_mm =" not in advice(unknown, spec, with_tools())


@pytest.mark.parametrize(
    ("allowed", "steepest", "expected"),
    [
        (90.0, 95.05, "constraints.inner_draft_deg = 0 and design again, or manufacture.max_tilt_deg = 95.1"),
        (65.0, 95.0, "constraints.inner_draft_deg = 25 and design again, or manufacture.max_tilt_deg = 95"),
        (64.9, 95.0, "manufacture.max_tilt_deg = 95"),
        (95.0, 119.99, "manufacture.max_tilt_deg = 120"),
        (95.0, 120.0, ""),
        (95.0, 130.0, ""),
    ],
)
def test_more_draft_or_more_tilt_is_advised_as_far_as_a_spec_takes_it(allowed, steepest, expected) -> None:
    spec = small_spec(manufacture__max_tilt_deg=allowed)
    assert advice(tilt_finding("inner", steepest, allowed), spec, with_tools()) == expected
    unknown = Finding(name="tilt", surface="inner", value=None, sense="<=", limit=allowed, unit="deg", reason="none")
    assert advice(unknown, spec, with_tools()).endswith("manufacture.max_tilt_deg = 0")


def test_the_draft_of_a_mould_or_of_the_spec_is_asked_of_the_search() -> None:
    mould = small_spec(manufacture__make="insert")
    assert (
        advice(draft_finding("outer", face(1.0), mould), mould, with_tools())
        == "constraints.outer_draft_deg = 2 and design again"
    )
    part = small_spec(manufacture__make="part", constraints__outer_draft_deg=3.0)
    assert advice(draft_finding("outer", face(1.0), part), part, with_tools()) == "", "the search has kept it"


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
    checked = with_tools(tool(1.0, 0.9, 0.1, name="other"), tool(ball, whole, largest_mm))
    finding = tool_findings(checked.tools[1])[0]
    assert advice(finding, small_spec(), checked) == expected
    assert advice(finding, small_spec(), with_tools()) == ""
    swapped = checked.tools[1].model_copy(update={"inner": checked.tools[1].outer, "outer": checked.tools[1].inner})
    assert advice(tool_findings(swapped)[1], small_spec(), with_tools(swapped)) == expected
