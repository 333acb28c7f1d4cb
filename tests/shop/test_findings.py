"""Findings of the check one by one: value, limit and words on both sides of every limit, and what is advised."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from scenes import small_spec
from shop_lenses import bare_part

from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG
from lensforge.results.fact import Fact
from lensforge.shop.check_facts import cutting_reasons
from lensforge.shop.check_measures import (
    BallClearance,
    BoreClearance,
    CustomBaseClearance,
    Cutter,
    Draft,
    FaceResult,
    Mould,
    MouldedFace,
    StepClearance,
    ToolReach,
    ToolResult,
    Wall,
    Walls,
)
from lensforge.shop.findings import (
    check_findings,
    clearance_findings,
    cutter_finding,
    design_again,
    draft_finding,
    plate_findings,
    tilt_finding,
    tool_finding,
    wall_finding,
)
from lensforge.spec import BaseSection, Spec, parse_spec

NO_BASE = BallClearance(faces={}, note="there is no base")


def cutter(radius_mm: float, largest_mm: float | None, reached: float = 0.6789) -> Cutter:
    return Cutter(radius_mm=radius_mm, reachable_fraction=reached, largest_radius_mm=largest_mm, residual_mm=0.0)


@pytest.mark.parametrize(
    ("radius_mm", "largest_mm", "holds", "phrase"),
    [
        (0.5, None, True, "a ball of 0.5 mm radius reaches the whole inner face; usable radius: any"),
        (0.5, 0.5, True, "usable radius: at most 0.5 mm"),
        (0.5 * (1.0 + 0.9e-6), 0.5, True, "usable radius: at most 0.5 mm"),
        (0.5 * (1.0 + 1.1e-6), 0.5, False, "67.9 % of the inner face; largest usable radius: 0.5 mm"),
    ],
)
def test_a_ball_up_to_the_largest_reaches_all_but_for_rounding(radius_mm, largest_mm, holds, phrase) -> None:
    finding = cutter_finding("inner", cutter(radius_mm, largest_mm), NO_BASE, small_spec())
    assert "base" not in finding.note
    assert finding.holds == holds and phrase in plain(finding.note)
    assert (finding.key, finding.place, finding.sense, finding.unit, finding.value) == (
        "cutter",
        "inner",
        "<=",
        "mm",
        radius_mm,
    )
    assert finding.limit == largest_mm, "the largest itself; its tolerance stands beside it"


def test_tilt_has_the_tolerance_of_angles_and_the_wall_that_of_the_search() -> None:
    spec = small_spec(constraints__min_thickness_mm=2.0)
    degrees = ANGLE_TOLERANCE_DEG
    mm = spec.constraints.tolerance_mm
    within = tilt_finding("outer", face(-90.0 - 0.99 * degrees), spec)
    beyond = tilt_finding("outer", face(-90.0 - 1.01 * degrees), spec)
    assert within.holds and not beyond.holds
    assert "the outer face is undercut by up to 90.02 deg" in beyond.note and "max_tilt_deg = 90" in beyond.note
    assert tilt_finding("outer", face(1.0), spec).note == "an upright axis reaches the outer face"
    assert (within.place, within.sense, within.unit) == ("outer", "<=", "deg")
    thin = wall_finding(2.0 - 1.01 * mm, spec)
    enough = wall_finding(2.0 - 0.99 * mm, spec)
    assert not thin.holds and "less than constraints.min_thickness_mm = 2" in thin.note
    assert enough.holds and "at least constraints" in enough.note and enough.sense == ">="


@pytest.mark.parametrize(("largest_mm", "larger"), [(None, True), (0.51, True), (0.5, False), (0.3, False)])
def test_a_larger_ball_than_the_shops_names_the_ball_for_which_the_base_is_checked(largest_mm, larger) -> None:
    suffix = " (base: 0.5 mm ball)"
    ball = cutter(0.5, largest_mm)
    for surface, relief in (
        ("outer", BallClearance(faces={"outer": outer()})),
        ("inner", BallClearance(faces={"inner": inner(0.0, 0.0)})),
    ):
        assert cutter_finding(surface, ball, relief, small_spec()).note.endswith(suffix) == larger


WALL = Wall(thickness_mm=1.5, cavity_point_mm=(1.0, -1e-9, 0.123456), envelope_point_mm=(0.0, 0.0, 2.0))
THICK = Wall(thickness_mm=2.5, cavity_point_mm=(0.0, 1.0, 0.0), envelope_point_mm=(0.0, 3.5, 0.0))


def criteria_on(walls: Walls, spec: Spec) -> list[Fact]:
    part, check = bare_part()
    measured = {"walls": walls, "min_wall_mm": walls.thinnest.thickness_mm, "edges": ()}
    return list(check.model_copy(update={"lens": replace(part.lens, spec=spec), **measured}).judge())


def test_both_walls_have_the_tolerance_of_the_search() -> None:
    spec = small_spec(constraints__min_thickness_mm=1.5)
    walls = Walls(thinnest=WALL, thickest=THICK)
    allowed = spec.constraints.tolerance_mm
    (least,) = criteria_on(walls, spec)
    assert (
        (least.limit, least.tolerance) == (1.5, allowed)
        and least.holds
        and "thinnest at (1, 0, 0.1235) mm" in least.remedy
    )
    for limit, passed in ((2.5 - 0.99 * allowed, True), (2.5 - 1.01 * allowed, False)):
        _, most = criteria_on(walls, spec.replace({"constraints.max_wall_mm": limit}))
        assert (most.limit, most.tolerance) == (limit, allowed) and most.value == 2.5 and most.holds == passed
        assert "raise lens.inner.offset_mm" in most.remedy and "thickest at (0, 1, 0) mm" in most.remedy


def face(least_deg: float, undercut: float = 0.0, free_deg: float = 90.0) -> FaceResult:
    tilt = {"largest_tilt_deg": max(-least_deg, 0.0), "free_tilt_deg": free_deg}
    draft = Draft(min=least_deg)
    return FaceResult.model_construct(draft_deg=draft, undercut_fraction=undercut, cutter=cutter(0.5, None), **tilt)


def test_a_mould_needs_two_degrees_and_a_part_what_its_spec_asks_to_the_error_of_the_samples() -> None:
    mould = small_spec(manufacture__process="moulded")
    for least_deg, holds in ((2.0, True), (1.99998, True), (1.981, True), (1.979, False)):  # the second: a cone of 2
        assert draft_finding("inner", face(least_deg), mould).holds == holds
    assert "a mould needs 2 deg" in draft_finding("inner", face(1.0), mould).note
    for process in ("milled", "moulded"):
        asked = small_spec(manufacture__process=process, lens__inner__draft_deg=3.0)
        assert draft_finding("inner", face(2.981), asked).holds
        low = draft_finding("inner", face(2.979), asked)
        assert not low.holds and "the spec requires 3 deg" in low.note


@pytest.mark.parametrize(
    ("least_deg", "undercut", "value", "beginning"),
    [
        (1.5, 0.0, 1.5, "the minimum draft of the outer face is 1.5 deg; a mould needs"),
        (-1e-9, 0.0, 0.0, "the minimum draft of the outer face is 0 deg"),
        (-3.0, 0.02, -3.0, "2 % of the outer face is undercut, down to a draft of −3 deg"),
    ],
)
def test_a_vertical_rim_is_no_undercut(least_deg, undercut, value, beginning) -> None:
    finding = draft_finding("outer", face(least_deg, undercut), small_spec(manufacture__process="moulded"))
    assert finding.value == value and plain(finding.note).startswith(beginning)


def plain(text: str) -> str:
    """A text with plain spaces."""
    return text.replace("\u2009", " ")


def outer(step=0.0, wall=0.0, flange=0.0) -> StepClearance:
    return StepClearance(
        smallest_step_mm=step, step_clearance_mm=wall, flange_clearance_mm=flange, flush_fraction=0.456
    )


def inner(bore: float | None, pocket: float | None) -> BoreClearance:
    return BoreClearance(bore_clearance_mm=bore, pocket_diameter_mm=pocket, flush_fraction=0.5)


BASE = BaseSection(height_mm=3.0)
SMALLER = "a smaller base.flange_diameter_mm in place of the height"
CUT_BACK = "cut the base in its file back by up to 0.25 mm where the ball hits it"
FLANGED = BaseSection(height_mm=3.0, flange_diameter_mm=40.0, flange_height_mm=1.0)


@pytest.mark.parametrize(
    ("relief", "base", "value", "remedy"),
    [
        (outer(), BASE, 0.0, ""),
        (outer(None, None, None), BASE, None, ""),
        (outer(0.50001), BASE, 0.50001, "base.relief_step_mm = 0.5001"),
        (outer(0.5, 0.2), BASE, 0.5, "base.relief_step_mm = 0.5 and base.relief_setback_mm = 0.2"),
        (outer(0.0, 0.2), BASE, 0.2, "base.relief_setback_mm = 0.2"),
        (outer(0.5, 0.0, 0.7), FLANGED, 0.7, f"base.relief_step_mm = 0.5 and base.height_mm = 3.7, or {SMALLER}"),
        (outer(0.0, 0.0, 0.7), FLANGED, 0.7, f"base.height_mm = 3.7, or {SMALLER}"),
        (outer(3.0), BASE, 3.0, "base.relief_step_mm = 3 and base.height_mm = 3.1"),
        (outer(2.9999), BASE, 2.9999, "base.relief_step_mm = 2.9999"),
        (outer(2.0), FLANGED, 2.0, "base.relief_step_mm = 2 and base.height_mm = 3.1"),
        (outer(1.9999), FLANGED, 1.9999, "base.relief_step_mm = 1.9999"),
        (outer(2.8, 0.0, 0.5), FLANGED, 2.8, f"base.relief_step_mm = 2.8 and base.height_mm = 3.9, or {SMALLER}"),
    ],
)
def test_a_base_in_the_way_of_the_dome_is_told_how_to_clear_it(relief, base, value, remedy) -> None:
    (finding,) = clearance_findings(BallClearance(faces={"outer": relief}), base)
    assert (finding.value, finding.holds, finding.remedy) == (value, value == 0.0, remedy)
    assert (finding.key, finding.place, finding.sense, finding.limit) == ("relief", "outer", "<=", 0.0)
    says = {None: "reaches no part of the outer face, with or without the base", 0.0: "the base clears the ball"}
    assert says.get(value, "with this base the ball reaches 45.6 % of the outer face") in plain(finding.note)
    assert ("rim is undercut" in finding.note) == bool(relief.step_clearance_mm)
    alone = [change for change in finding.changes if change.field.startswith("base.")]
    assert [str(change) for change in alone] == ([] if " and " in remedy or not remedy else [remedy.split(", or ")[0]])


@pytest.mark.parametrize(
    ("relief", "value", "remedy"),
    [
        (inner(0.0, 0.0), 0.0, ""),
        (inner(0.2, 0.0), 0.2, "base.bore_setback_mm = 0.2"),
        (inner(0.0, 6.0), 6.0, "base.pocket_diameter_mm = 6"),
        (inner(0.2, 6.0), 6.0, "base.bore_setback_mm = 0.2 and base.pocket_diameter_mm = 6"),
        (inner(None, None), None, ""),
        (CustomBaseClearance(retreat_mm=0.25, flush_fraction=0.5), 0.25, CUT_BACK),
        (CustomBaseClearance(retreat_mm=0.0, flush_fraction=0.5), 0.0, ""),
    ],
)
def test_a_base_in_the_way_in_the_cavity_is_told_how_to_clear_it(relief, value, remedy) -> None:
    (finding,) = clearance_findings(BallClearance(faces={"inner": relief}), BASE)
    assert (finding.value, finding.holds, plain(finding.remedy), finding.place) == (
        value,
        value == 0.0,
        remedy,
        "inner",
    )


def tool(ball: float, whole: float, name: str = "mill") -> ToolResult:
    reach = ToolReach(ball_reachable_fraction=ball, reachable_fraction_untilted=0.0, reachable_fraction=whole)
    all_of_it = ToolReach(ball_reachable_fraction=1.0, reachable_fraction_untilted=1.0, reachable_fraction=1.0)
    return ToolResult(
        name=name,
        radius_mm=0.5,
        shank_radius_mm=0.5,
        length_mm=8.0,
        holder_half_angle_deg=10.0,
        faces={"inner": reach, "outer": all_of_it},
    )


@pytest.mark.parametrize(
    ("ball", "whole", "holds", "collides", "largest"),
    [
        (1.0, 1.0, True, False, False),
        (1.0, 1.0 - 0.5e-9, True, False, False),
        (1.0, 1.0 - 2e-9, False, True, False),
        (0.8, 0.8, False, False, True),
        (0.8, 0.7, False, True, True),
        (1.0 - 2e-9, 1.0 - 2e-9, False, False, True),
    ],
)
def test_what_limits_a_tool_is_its_ball_or_its_shank(ball, whole, holds, collides, largest) -> None:
    mill = tool(ball, whole)
    finding, other = (tool_finding(mill, name, reach, 0.456789) for name, reach in mill.faces.items())
    assert (finding.place, finding.value, finding.holds) == ("inner", whole, holds)
    assert plain(finding.note).startswith(f"mill reaches {100.0 * whole:.0f} % of the inner face")
    assert (f"its ball alone reaches {100.0 * ball:.0f} %" in plain(finding.note)) == collides
    assert ("radius: 0.4568 mm" in finding.note) == largest
    assert (other.place, other.holds, plain(other.note)) == ("outer", True, "mill reaches 100 % of the outer face")
    assert "has" not in tool_finding(tool(0.8, 0.8), "inner", tool(0.8, 0.8).faces["inner"], None).note


def test_all_findings_are_there_and_each_has_its_own_numbers() -> None:
    custom = CustomBaseClearance(retreat_mm=0.1, flush_fraction=0.5)
    relief = BallClearance(faces={"inner": custom, "outer": outer(0.5)})
    spec = small_spec(manufacture__max_tilt_deg=60.0, manufacture__process="moulded")
    faces = {"inner": face(1.0), "outer": face(5.0)}
    halves = MouldedFace(upper_fraction=1.0, lower_fraction=0.0, undercut_fraction=0.0, draft_deg=3.0)
    hidden = {"upper_fraction": 0.75, "undercut_fraction": 0.25, "undercut_heights_mm": (0.0, 1.0), "draft_deg": 1.5}
    mould = Mould.model_construct(faces={"inner": halves, "outer": halves.changed(**hidden)})
    findings = check_findings(spec, faces, 1.25, relief, (tool(1.0, 1.0), tool(0.5, 0.5, name="drill")), mould)
    subjects = ["cutter inner", "cutter outer", "relief inner", "relief outer", "wall body"]
    subjects += ["undercut inner", "undercut outer", "draft inner", "draft outer"]
    subjects += ["tool inner", "tool outer", "tool inner", "tool outer"]
    assert [f"{finding.key} {finding.place}" for finding in findings] == subjects, "no tilt of a tool"
    assert [finding.value for finding in findings[2:]] == [0.1, 0.5, 1.25, 0.0, 0.25, 3.0, 1.5, 1.0, 1.0, 0.5, 1.0]
    cut = check_findings(spec.replace({"manufacture.process": "milled"}), faces, 1.25, relief, ())
    assert [(finding.value, finding.limit) for finding in cut if finding.key == "tilt"] == [(0.0, 90.0), (0.0, 90.0)]
    part = check_findings(small_spec(lens__outer__draft_deg=1.0), faces, 1.25, relief, ())
    assert [finding.place for finding in part if finding.key == "draft"] == ["outer"], (
        "where a part that is cut needs one"
    )


WIDER = "lens.outer.concave_radius_mm = 1 and design again"
SMALLER = "manufacture.cutter_radius_mm = 0.279"


def test_a_thin_wall_is_designed_again_or_taken_as_it_is() -> None:
    spec = small_spec(constraints__min_thickness_mm=1.5)
    again = "a larger lens.outer.offset_mm and design again"
    there = f"{again}, or constraints.min_thickness_mm = 1.432 where that is enough"
    assert wall_finding(1.4329, spec).remedy == there
    assert wall_finding(1.4329, spec.replace({"constraints.min_thickness_mm": 1.432})).holds
    assert "min_thickness_mm = 0.001 where" in wall_finding(1.19e-3, spec).remedy
    assert {wall_finding(wall, spec).remedy for wall in (-11.42, -0.01, 9e-4)} == {again}, "that is no wall"
    assert wall_finding(1.5, spec).remedy == ""


@pytest.mark.parametrize(
    ("process", "kept", "expected"),
    [
        ("milled", {}, f"{WIDER}, or {SMALLER}"),
        ("moulded", {}, SMALLER),
        ("milled", {"lens__outer__concave_radius_mm": 1.0}, SMALLER),
        ("milled", {"lens__outer__concave_radius_mm": 0.9}, f"{WIDER}, or {SMALLER}"),
    ],
)
def test_a_smaller_ball_or_a_search_for_wider_hollows_is_advised(process, kept, expected) -> None:
    spec = small_spec(manufacture__process=process, manufacture__cutter_radius_mm=1.0, **kept)
    assert cutter_finding("outer", cutter(1.0, 0.27949), NO_BASE, spec).remedy == expected
    assert cutter_finding("outer", cutter(0.279, 0.27949), NO_BASE, spec).holds, "as advised"


@pytest.mark.parametrize(
    ("allowed", "undercut", "expected"),
    [
        (25.0, 30.05, "lens.inner.draft_deg = 0 and design again, or manufacture.max_tilt_deg = 30.1"),
        (90.0, 119.99, "lens.inner.draft_deg = 0 and design again, or manufacture.max_tilt_deg = 120"),
        (90.0, 120.1, "lens.inner.draft_deg = 0 and design again"),
    ],
)
def test_no_undercut_or_more_tilt_is_advised_as_far_as_a_spec_takes_it(allowed, undercut, expected) -> None:
    spec = small_spec(manufacture__max_tilt_deg=allowed)
    assert tilt_finding("inner", face(-undercut, free_deg=allowed), spec).remedy == expected
    for wide in map(float, re.findall(r"max_tilt_deg = ([\d.]+)", expected)):
        farther = small_spec(manufacture__max_tilt_deg=wide)
        assert tilt_finding("inner", face(-undercut, free_deg=wide), farther).holds


def test_no_machine_that_tilts_farther_is_advised_where_the_mouth_of_the_cavity_is_in_the_way() -> None:
    finding = tilt_finding("inner", face(-30.0, free_deg=25.0), small_spec())
    assert (finding.holds, finding.limit, finding.remedy) == (False, 25.0, "lens.inner.draft_deg = 0 and design again")
    assert "the mouth of the cavity leaves 25" in finding.note


def test_the_draft_of_a_mould_or_of_the_spec_is_asked_of_the_search() -> None:
    mould = small_spec(manufacture__process="moulded")
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
    reach = tool(ball, whole)
    assert tool_finding(reach, "inner", reach.faces["inner"], largest_mm).remedy == expected
    assert tool_finding(reach, "outer", reach.faces["outer"], None).remedy == "", "it holds"


def test_each_tool_is_judged_by_the_face_that_it_is_to_reach() -> None:
    spec = small_spec()
    hollow = face(90.0).model_copy(update={"cutter": cutter(0.1, 0.3)})
    findings = check_findings(spec, {"inner": hollow, "outer": face(90.0)}, 1.0, NO_BASE, (tool(0.8, 0.8),))
    inner, outside = (finding for finding in findings if finding.key == "tool")
    assert "radius_mm = 0.3 or less" in inner.remedy and not inner.holds
    assert outside.holds and outside.place == "outer"


@pytest.mark.parametrize(("beyond", "holds"), [(-0.99, True), (0.0, True), (0.99, True), (1.01, False)])
def test_every_limit_is_kept_to_the_tolerance_of_its_measure(beyond: float, holds: bool) -> None:
    """Draft and tilt are one angle, edges another one; walls and gaps are lengths of the same faces."""
    spec = small_spec(lens__outer__draft_deg=3.0, constraints__min_thickness_mm=1.5)
    assert draft_finding("outer", face(3.0 - 0.02 * beyond), spec).holds == holds
    tilted = face(-60.0 - 0.02 * beyond, free_deg=60.0)
    assert tilt_finding("outer", tilted, small_spec(manufacture__max_tilt_deg=60.0)).holds == holds
    off_mm = beyond * spec.constraints.tolerance_mm
    assert wall_finding(1.5 - off_mm, spec).holds == holds
    wide_mm = 2.0 * spec.manufacture.cutter_radius_mm
    assert [finding.holds for finding in plate_findings(spec, wide_mm - off_mm, None)] == [holds]


def test_one_tool_that_reaches_a_face_is_enough_for_it_and_none_for_another() -> None:
    inner = ("fail", "too short")
    outer = ("fail", "too thick")
    tools = [("inner", *inner), ("inner", "pass", ""), ("outer", *outer), ("outer", "fail", "blunt")]
    verdicts = [Fact("tool", "tool", 0.5, "mm", state=state, note=note, place=face) for face, state, note in tools]
    check = SimpleNamespace(faces={"inner": None, "outer": None}, verdicts=verdicts, cut_body="lens", spec=small_spec())
    assert list(cutting_reasons(check)) == [("fail", "too thick; blunt")]


def test_a_face_that_follows_another_is_mended_by_that() -> None:
    """The back of a reflector has no fields: its draft is that of the cup, and no ball of its own mends it."""
    beam = {"kind": "disc", "diameter_deg": 20.0, "half_angle_deg": 60.0}
    content = {"source": {"kind": "square", "side_mm": 1.0}, "lens": {"kind": "reflector"}, "target": beam}
    spec = parse_spec({**content, "constraints": {"max_radius_mm": 12.0}}, "cup")
    again = design_again("draft_deg", 2.0, spec, "back")
    assert str(again) == "lens.cup.draft_deg = 2 and design again"
    assert design_again("concave_radius_mm", 1.0, spec, "back") is None
    assert spec.replace(lens={"cup": {"draft_deg": 2.0}}).lens.faces["cup"].draft_deg == 2.0


def test_changes_of_a_field_are_those_of_the_sentence_and_a_spec_takes_them() -> None:
    """Of a ball that is too large: the search again, or a smaller ball; a file keeps the sentence alone."""
    spec = small_spec()
    finding = cutter_finding("outer", cutter(1.5, 0.7361), NO_BASE, spec)
    assert [str(change) for change in finding.changes] == [
        "lens.outer.concave_radius_mm = 1.5 and design again",
        "manufacture.cutter_radius_mm = 0.736",
    ]
    assert finding.remedy == ", or ".join(map(str, finding.changes))
    changed = spec.replace({change.field: float(change.value) for change in finding.changes})
    assert (changed.lens.faces["outer"].concave_radius_mm, changed.manufacture.cutter_radius_mm) == (1.5, 0.736)
    assert cutter_finding("outer", cutter(0.7, 0.7361), NO_BASE, spec).changes == ()
