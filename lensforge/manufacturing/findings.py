"""Findings of the check: one statement for the shop on each measurement, with its reason and, if needed, a remedy."""

from math import ceil, degrees

from lensforge.geometry.form import FORM_LIMIT_NM, NORMAL_LIMIT_MRAD
from lensforge.manufacturing.result import (
    CustomBaseRelief,
    Cutter,
    FaceName,
    FaceResult,
    Finding,
    InnerRelief,
    OuterRelief,
    Relief,
    ToolResult,
)

GOOD_DRAFT_DEG = 2.0
_WHOLE = 1.0 - 1e-9  # share that counts as the whole face
# The export allows this error of a wall between two faces, and of the normals of one.
_WALL_TOLERANCE_MM, _TILT_TOLERANCE_DEG = 2e-6 * FORM_LIMIT_NM, degrees(1e-3 * NORMAL_LIMIT_MRAD)
_FACES: tuple[FaceName, FaceName] = ("inner", "outer")


def cutter_finding(surface: FaceName, cutter: Cutter) -> Finding:
    """Reach of the spec's ball cutter on a face."""
    ball, largest = f"a ball of {cutter.radius_mm:g} mm radius", cutter.largest_radius_mm
    holds = largest is None or largest >= cutter.radius_mm * (1.0 - 1e-6)
    if holds:
        others = "any ball" if largest is None else f"any ball of up to {largest:.4g} mm radius"
        reason = f"{ball} reaches all of the {surface} face; so does {others}"
    else:
        reason = (
            f"{ball} reaches {100.0 * cutter.reachable_fraction:.1f} % of the {surface} face; "
            f"the largest that reaches all of it has {largest:.4g} mm radius"
        )
    return Finding(name="cutter", surface=surface, holds=holds, reason=reason)


def relief_findings(relief: Relief) -> list[Finding]:
    """Clearance of the ball at the base: one statement for each face that has a base below it."""
    faces: tuple[tuple[FaceName, OuterRelief | InnerRelief | CustomBaseRelief | None], ...]
    faces = (("outer", relief.outer), ("inner", relief.inner))
    return [_relief_finding(surface, found) for surface, found in faces if found is not None]


def _relief_finding(surface: FaceName, relief: OuterRelief | InnerRelief | CustomBaseRelief) -> Finding:
    retreat, setback = _needed(relief)
    if retreat is None:
        reason = f"the ball reaches no part of the {surface} face, with or without the base"
        return Finding(name="relief", surface=surface, holds=False, reason=reason)
    if retreat <= 0.0 and setback <= 0.0:
        reason = f"the base clears the ball at the {surface} face"
        return Finding(name="relief", surface=surface, holds=True, reason=reason)
    reached = f"with this base the ball reaches {100.0 * relief.flush_fraction:.1f} % of the {surface} face"
    reason = f"{reached}; {_remedy(relief, retreat, setback)}"
    return Finding(name="relief", surface=surface, holds=False, reason=reason)


def _needed(relief: OuterRelief | InnerRelief | CustomBaseRelief) -> tuple[float | None, float]:
    """Retreat (mm) that the base needs, None where nothing is reached, and the setback (mm) of its step's wall."""
    match relief:
        case OuterRelief():
            return relief.smallest_step_mm, relief.step_clearance_mm or 0.0
        case InnerRelief():
            return relief.bore_clearance_mm, 0.0
        case CustomBaseRelief():
            return relief.retreat_mm, 0.0


def _remedy(relief: OuterRelief | InnerRelief | CustomBaseRelief, retreat_mm: float, setback_mm: float) -> str:
    match relief:
        case CustomBaseRelief():
            return f"the base in its file must be cut back by up to {retreat_mm:.4g} mm where the ball hits it"
        case InnerRelief():
            return f"a bore {retreat_mm:.4g} mm larger in radius than the cavity would clear the ball"
        case OuterRelief() if setback_mm <= 0.0:
            return f"base.relief_step_mm = {_up(retreat_mm)} would clear the ball"
        case OuterRelief():
            step = f"base.relief_step_mm = {_up(retreat_mm)} and " if retreat_mm > 0.0 else ""
            return f"the rim is undercut, and needs {step}base.relief_setback_mm = {_up(setback_mm)}"


def _up(length_mm: float) -> str:
    """A length for a spec, rounded up to 0.1 um so that it is enough."""
    return f"{ceil(1e4 * length_mm) / 1e4:g}"


def tilt_finding(surface: FaceName, slope_deg: float, allowed_deg: float) -> Finding:
    """Tilt of a tool that is held normal to the face everywhere, against the largest allowed."""
    holds = slope_deg <= allowed_deg + _TILT_TOLERANCE_DEG
    reason = (
        f"the {surface} face is up to {slope_deg:.2f} deg steep; a tool held normal to it "
        f"{'stays within' if holds else 'would exceed'} manufacture.max_tilt_deg = {allowed_deg:g}"
    )
    return Finding(name="tilt", surface=surface, holds=holds, reason=reason)


def wall_finding(wall_mm: float, required_mm: float) -> Finding:
    """Thinnest wall, radial or along the normal, against the radial thickness of the spec."""
    holds = wall_mm >= required_mm - _WALL_TOLERANCE_MM
    word = "at least" if holds else "less than"
    reason = (
        f"the thinnest wall is {wall_mm:.4g} mm, {word} constraints.min_thickness_mm = {required_mm:g}, "
        "which bounds the radial thickness only"
    )
    return Finding(name="wall", surface="body", holds=holds, reason=reason)


def draft_finding(surface: FaceName, face: FaceResult) -> Finding:
    """Draft for a two-part mould that opens along the axis."""
    least_deg, undercut = face.draft_deg.min, face.undercut_fraction
    if undercut > 0.0:
        reason = f"{100.0 * undercut:.2f} % of the {surface} face is undercut, down to a draft of {least_deg:.2f} deg"
    else:
        least_deg = max(least_deg, 0.0)  # form error of a vertical rim
        reason = f"the least draft of the {surface} face is {least_deg:.2f} deg; a mould needs {GOOD_DRAFT_DEG:g} deg"
    return Finding(name="draft", surface=surface, holds=least_deg >= GOOD_DRAFT_DEG, reason=reason)


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
    return Finding(name="tool", surface=surface, holds=whole >= _WHOLE, reason=reason)
