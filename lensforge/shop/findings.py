"""Findings of the check: one statement for the shop on each measurement, its reason, and the changes that mend it.

All follow from the measurements of the check and the spec alone, so that the findings in a file can be held against
what the file's own numbers say. Advice on a finding that does not hold names the fields of the spec to change, and to
which values.
"""

from math import ceil, degrees, floor

from lensforge.cad.part_limits import NORMAL_LIMIT_MRAD
from lensforge.results.criteria import Criterion, at_least, at_most
from lensforge.results.verdict import within
from lensforge.shop.check_result import (
    BallClearance,
    Check,
    CustomBaseClearance,
    Cutter,
    FaceName,
    FaceResult,
    Finding,
    InnerClearance,
    OuterClearance,
    ToolResult,
    Wall,
    Walls,
)
from lensforge.spec import BaseSection, Spec

GOOD_DRAFT_DEG = 2.0
_WHOLE = 1.0 - 1e-9  # share that counts as the whole face
_BALL = 1.0 + 1e-6  # relative: a ball that is larger than the largest by rounding still reaches the face
_TILT_TOLERANCE_DEG = degrees(1e-3 * NORMAL_LIMIT_MRAD)  # the export allows this error of a face's normals
_FACES: tuple[FaceName, FaceName] = ("inner", "outer")
_AnyClearance = OuterClearance | InnerClearance | CustomBaseClearance


def check_findings(
    spec: Spec,
    inner: FaceResult,
    outer: FaceResult,
    wall_mm: float,
    relief: BallClearance,
    tools: tuple[ToolResult, ...],
) -> tuple[Finding, ...]:
    """All findings on a lens of ``spec`` from the measurements of its check; ``wall_mm``: the thinnest wall."""
    allowed_deg = spec.manufacture.max_tilt_deg
    faces: tuple[tuple[FaceName, FaceResult], ...] = (("inner", inner), ("outer", outer))
    return (
        *(cutter_finding(name, face.cutter, relief) for name, face in faces),
        *clearance_findings(relief, spec.base),
        *(tilt_finding(name, face.largest_tilt_deg, allowed_deg) for name, face in faces),
        wall_finding(wall_mm, spec),
        *(draft_finding(name, face, spec) for name, face in faces),
        *(finding for tool in tools for finding in tool_findings(tool)),
    )


def wall_criteria(spec: Spec, walls: Walls) -> tuple[Criterion, ...]:
    """The thinnest wall, and the thickest where the spec limits it; both within the tolerance of the search."""
    limits, again = spec.constraints, "or give the last level more steps; the wall is"
    remedy = f"raise lens.outer_offset_mm {again} thinnest at ({_place(walls.thinnest)}) mm"
    least = at_least("thinnest wall", walls.thinnest.thickness_mm, least_wall_mm(spec), "mm", remedy)
    if limits.max_wall_mm is None:
        return (least,)
    remedy = f"raise lens.inner_offset_mm {again} thickest at ({_place(walls.thickest)}) mm"
    most = limits.max_wall_mm + limits.tolerance_mm
    return least, at_most("largest radial wall", walls.thickest.thickness_mm, most, "mm", remedy)


def least_wall_mm(spec: Spec) -> float:
    """The least wall that still counts as that of the spec."""
    return spec.constraints.min_thickness_mm - spec.constraints.tolerance_mm


def _place(wall: Wall) -> str:
    return ", ".join(f"{round(value, 6) + 0.0:.4g}" for value in wall.inner_point_mm)  # no "-0"


def cutter_finding(surface: FaceName, cutter: Cutter, relief: BallClearance) -> Finding:
    """Reach of the spec's ball cutter on a face."""
    ball, largest = f"a ball of {cutter.radius_mm:g} mm radius", cutter.largest_radius_mm
    limit = None if largest is None else largest * _BALL
    if within(cutter.radius_mm, "<=", limit):
        others = "any ball" if largest is None else f"any ball of up to {largest:.4g} mm radius"
        base = relief.beyond_shop(largest, cutter.radius_mm, surface)
        reason = f"{ball} reaches all of the {surface} face; so does {others}{base}"
    else:
        reason = (
            f"{ball} reaches {100.0 * cutter.reachable_fraction:.1f} % of the {surface} face; "
            f"the largest that reaches all of it has {largest:.4g} mm radius"
        )
    return Finding(
        name="cutter", surface=surface, value=cutter.radius_mm, sense="<=", limit=limit, unit="mm", reason=reason
    )


def clearance_findings(relief: BallClearance, base: BaseSection) -> list[Finding]:
    """Clearance of the ball at ``base``: one statement for each face that has a base below it."""
    faces: tuple[tuple[FaceName, _AnyClearance | None], ...] = (("outer", relief.outer), ("inner", relief.inner))
    return [_clearance_finding(surface, found, base) for surface, found in faces if found is not None]


def _clearance_finding(surface: FaceName, relief: _AnyClearance, base: BaseSection) -> Finding:
    """The base must retreat by nothing; nothing is known of a face that the ball does not reach."""
    retreat, second = _needed(relief)
    needed = None if retreat is None else max(retreat, second)
    if retreat is None:
        reason = f"the ball reaches no part of the {surface} face, with or without the base"
    elif within(needed, "<=", 0.0):
        reason = f"the base clears the ball at the {surface} face"
    else:
        reached = f"with this base the ball reaches {100.0 * relief.flush_fraction:.1f} % of the {surface} face"
        reason = f"{reached}; {_remedy(relief, base, retreat)}"
    return Finding(name="relief", surface=surface, value=needed, sense="<=", limit=0.0, unit="mm", reason=reason)


def _needed(relief: _AnyClearance) -> tuple[float | None, float]:
    """Retreat (mm) that the base needs, None where nothing is reached, and another: step's wall, flange, or pocket."""
    match relief:
        case OuterClearance():
            return relief.smallest_step_mm, max(relief.step_clearance_mm or 0.0, relief.flange_clearance_mm or 0.0)
        case InnerClearance():
            return relief.bore_clearance_mm, relief.pocket_diameter_mm or 0.0
        case CustomBaseClearance():
            return relief.retreat_mm, 0.0


def _remedy(relief: _AnyClearance, base: BaseSection, retreat_mm: float) -> str:
    match relief:
        case CustomBaseClearance():
            return f"the base in its file must be cut back by up to {retreat_mm:.4g} mm where the ball hits it"
        case InnerClearance():
            fields = {"bore_setback_mm": retreat_mm, "pocket_diameter_mm": relief.pocket_diameter_mm or 0.0}
            needed = [f"base.{name} = {_rounded_up(value)}" for name, value in fields.items() if value > 0.0]
            return f"{' and '.join(needed)} would clear the ball"
        case OuterClearance():
            return _outer_remedy(relief, base)


def _outer_remedy(relief: OuterClearance, base: BaseSection) -> str:
    """Fields that clear the ball; the flange lies at the bottom, and some of the base must remain above it."""
    fields = {"relief_step_mm": relief.smallest_step_mm, "relief_setback_mm": relief.step_clearance_mm}
    needed = [f"base.{name} = {_rounded_up(value)}" for name, value in fields.items() if value]
    lower, flange = relief.flange_clearance_mm or 0.0, 0.0 if base.flange_diameter_mm is None else base.flange_height_mm
    height, least = base.height_mm + lower, (relief.smallest_step_mm or 0.0) + flange
    if relief.smallest_step_mm and least >= height:
        needed.append(f"base.height_mm above {_rounded_up(least)}")
    elif lower > 0.0:
        needed.append(f"base.height_mm = {_rounded_up(height)}")
    undercut = bool(relief.step_clearance_mm)
    words = ("the rim is undercut, and needs {}" if undercut else "{} would clear the ball").format(
        " and ".join(needed)
    )
    return f"{words}; in place of the height, a smaller base.flange_diameter_mm may clear it" if lower > 0.0 else words


def _rounded_up(length_mm: float) -> str:
    """A length for a spec, rounded up to 0.1 um so that it is enough."""
    return f"{ceil(1e4 * length_mm) / 1e4:g}"


def tilt_finding(surface: FaceName, slope_deg: float, allowed_deg: float) -> Finding:
    """Tilt of a tool that is held normal to the face everywhere, against the largest allowed."""
    limit = allowed_deg + _TILT_TOLERANCE_DEG
    reason = (
        f"the {surface} face is up to {slope_deg:.2f} deg steep; a tool held normal to it "
        f"{'stays within' if within(slope_deg, '<=', limit) else 'would exceed'} "
        f"manufacture.max_tilt_deg = {allowed_deg:g}"
    )
    return Finding(name="tilt", surface=surface, value=slope_deg, sense="<=", limit=limit, unit="deg", reason=reason)


def wall_finding(wall_mm: float, spec: Spec) -> Finding:
    """Thinnest wall against that of the spec."""
    limit = least_wall_mm(spec)
    word = "at least" if within(wall_mm, ">=", limit) else "less than"
    required_mm = spec.constraints.min_thickness_mm
    reason = f"the thinnest wall is {wall_mm:.4g} mm, {word} constraints.min_thickness_mm = {required_mm:g}"
    return Finding(name="wall", surface="body", value=wall_mm, sense=">=", limit=limit, unit="mm", reason=reason)


def draft_finding(surface: FaceName, face: FaceResult, spec: Spec) -> Finding:
    """Draft: what the spec asks of a part that is cut; else that for a mould of two parts that opens along the axis."""
    least_deg, undercut = face.draft_deg.min, face.undercut_fraction
    asked_deg = asked_draft_deg(surface, spec)
    needed = f"a mould needs {GOOD_DRAFT_DEG:g} deg" if asked_deg is None else f"the spec asks for {asked_deg:g} deg"
    limit_deg = GOOD_DRAFT_DEG if asked_deg is None else asked_deg - _TILT_TOLERANCE_DEG
    if undercut > 0.0:
        reason = f"{100.0 * undercut:.2f} % of the {surface} face is undercut, down to a draft of {least_deg:.2f} deg"
    else:
        least_deg = max(least_deg, 0.0)  # form error of a vertical rim
        reason = f"the least draft of the {surface} face is {least_deg:.2f} deg; {needed}"
    return Finding(
        name="draft", surface=surface, value=least_deg, sense=">=", limit=limit_deg, unit="deg", reason=reason
    )


def asked_draft_deg(surface: FaceName, spec: Spec) -> float | None:
    """Draft (deg) that the spec asks of a face of a part that is cut itself, not moulded."""
    asked_deg: float | None = getattr(spec.constraints, f"{surface}_draft_deg")
    return asked_deg if spec.manufacture.make == "part" else None


def tool_findings(tool: ToolResult) -> list[Finding]:
    """Reach of a tool on each face, and the part of it that limits the reach."""
    return [_tool_finding(tool, surface) for surface in _FACES]


def _tool_finding(tool: ToolResult, surface: FaceName) -> Finding:
    reach = tool.inner if surface == "inner" else tool.outer
    ball, whole = reach.ball_reachable_fraction, reach.reachable_fraction
    reason = f"{tool.name} reaches {100.0 * whole:.1f} % of the {surface} face"
    if whole < ball - 1e-9:
        reason += f"; its ball alone reaches {100.0 * ball:.1f} %: shank or holder collides, a longer tool may help"
    if ball < _WHOLE and reach.largest_radius_mm is not None:
        reason += f"; the largest ball that reaches all of it has {reach.largest_radius_mm:.4g} mm radius"
    return Finding(
        name="tool", surface=surface, value=whole, sense=">=", limit=_WHOLE, unit="of the face", reason=reason
    )


_LEAST_WALL_MM = 1e-3  # a thinner one is none
_MOST_TILT_DEG, _MOST_DRAFT_DEG = 120.0, 25.0  # of manufacture.max_tilt_deg and constraints.*_draft_deg


def advice(finding: Finding, spec: Spec, check: Check) -> str:
    """Changes of the spec of which each makes ``finding`` hold; empty where it holds, or its reason names them."""
    if finding.holds or finding.name == "relief":
        return ""
    if finding.name == "wall":
        return _for_wall(finding, spec)
    surface: FaceName = "inner" if finding.surface == "inner" else "outer"
    if finding.name == "cutter":
        return _for_cutter(surface, finding, spec)
    if finding.name == "tilt":
        return _for_tilt(surface, finding, spec)
    if finding.name == "draft":
        asked_deg = asked_draft_deg(surface, spec)
        return _or(
            [_design_again(f"{surface}_draft_deg", GOOD_DRAFT_DEG if asked_deg is None else asked_deg, spec, surface)]
        )
    return _for_tool(surface, finding, check)


def _for_wall(finding: Finding, spec: Spec) -> str:
    """A search from faces that are farther apart, which keeps the wall, or a spec that takes the wall there is."""
    starts = (("outer", "larger"), ("inner", "smaller"))
    free = [each for each in starts if getattr(spec.lens, f"fixed_{each[0]}") is None]
    changes = [f"a {how} lens.{surface}_offset_mm and design again" for surface, how in free[:1]]
    if finding.value is not None and finding.value >= _LEAST_WALL_MM:
        changes.append(f"constraints.min_thickness_mm = {_down(finding.value)} where that is enough")
    return _or(changes)


def _for_cutter(surface: FaceName, finding: Finding, spec: Spec) -> str:
    """A search without tighter concave regions, or the largest ball that reaches all of the face."""
    ball, changes = spec.manufacture.cutter_radius_mm, []
    if spec.manufacture.make == "part":
        changes.append(_design_again(f"{surface}_concave_radius_mm", ball, spec, surface))
    if finding.limit is not None:
        changes.append(f"manufacture.cutter_radius_mm = {_down(finding.limit)}")
    return _or(changes)


def _for_tilt(surface: FaceName, finding: Finding, spec: Spec) -> str:
    """A search for a face that is less steep, or a machine that tilts the tool farther."""
    draft_deg = 90.0 - spec.manufacture.max_tilt_deg
    changes = (
        [_design_again(f"{surface}_draft_deg", draft_deg, spec, surface)] if 0.0 <= draft_deg <= _MOST_DRAFT_DEG else []
    )
    steepest = 0.0 if finding.value is None else finding.value
    if steepest < _MOST_TILT_DEG:
        changes.append(f"manufacture.max_tilt_deg = {_up(steepest, 1)}")
    return _or(changes)


def _for_tool(surface: FaceName, finding: Finding, check: Check) -> str:
    """A smaller ball, or a longer tool, in the list of the spec."""
    tool = next((each for each in check.tools if finding.reason.startswith(f"{each.name} ")), None)
    if tool is None:
        return ""
    return _or([*_smaller_ball(tool, surface), *_longer(tool, surface)])


def _smaller_ball(tool: ToolResult, surface: FaceName) -> list[str]:
    largest = (tool.inner if surface == "inner" else tool.outer).largest_radius_mm
    if largest is None or largest >= tool.radius_mm:
        return []
    return [f"a tool in manufacture.tools with radius_mm = {_down(largest)} or less"]


def _longer(tool: ToolResult, surface: FaceName) -> list[str]:
    reach = tool.inner if surface == "inner" else tool.outer
    collides = reach.reachable_fraction < reach.ball_reachable_fraction
    return [f"a tool with length_mm above {tool.length_mm:g}"] if collides else []


def _design_again(field: str, value: float, spec: Spec, surface: FaceName) -> str:
    """The limit of the search; empty for a face that the spec gives, or where the search has kept that limit."""
    stated = getattr(spec.constraints, field)
    if getattr(spec.lens, f"fixed_{surface}") is not None or (stated is not None and stated >= value):
        return ""
    return f"constraints.{field} = {value:g} and design again"


def _or(changes: list[str]) -> str:
    return ", or ".join(change for change in changes if change)


def _up(value: float, decimals: int) -> str:
    return f"{ceil(round(value * 10**decimals, 6)) / 10**decimals:g}"


def _down(length_mm: float) -> str:
    """A length that is rounded down to 1 um, so that the ball still fits."""
    return f"{floor(1e3 * length_mm) / 1e3:g}"
