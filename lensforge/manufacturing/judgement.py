"""What the shop can and cannot do with this lens: a statement with its reason for each thing that was measured."""

from math import ceil
from typing import Literal

from lensforge.manufacturing.cut import Cutter, FaceResult, InnerRelief, OuterRelief, OwnBaseRelief, Relief, ToolResult
from lensforge.manufacturing.verdicts import ShopVerdict

GOOD_DRAFT_DEG = 2.0
_WHOLE = 1.0 - 1e-9  # the share of a face that counts as all of it

Side = Literal["inner", "outer"]
SIDES: tuple[Side, Side] = ("inner", "outer")


def cutter_verdict(surface: Side, cutter: Cutter) -> ShopVerdict:
    """Whether the spec's ball cuts the whole face."""
    ball, largest = f"a ball of {cutter.radius_mm:g} mm radius", cutter.largest_radius_mm
    holds = largest is None or largest >= cutter.radius_mm * (1.0 - 1e-6)
    if holds:
        room = "any ball does" if largest is None else f"balls up to {largest:.4g} mm do"
        reason = f"{ball} reaches all of the {surface} face; {room}"
    else:
        reason = (
            f"{ball} reaches {100.0 * cutter.reachable_fraction:.1f} % of the {surface} face; "
            f"the largest that reaches all of it is {largest:.4g} mm"
        )
    return ShopVerdict(name="cutter", surface=surface, holds=holds, reason=reason)


def relief_verdicts(relief: Relief) -> list[ShopVerdict]:
    """Whether the base leaves the ball its room: one statement for each face that has a base beside it."""
    faces: tuple[tuple[Side, OuterRelief | InnerRelief | OwnBaseRelief | None], ...]
    faces = (("outer", relief.outer), ("inner", relief.inner))
    return [relief_verdict(surface, found) for surface, found in faces if found is not None]


def relief_verdict(surface: Side, relief: OuterRelief | InnerRelief | OwnBaseRelief) -> ShopVerdict:
    """Whether the base, as the spec or its file has it, and a bore as wide as the cavity, leave the ball its room."""
    retreat, setback = _asked_for(relief)
    if retreat is None:
        reason = f"the cutter reaches nothing of the {surface} face, base or not"
        return ShopVerdict(name="relief", surface=surface, holds=False, reason=reason)
    if retreat <= 0.0 and setback <= 0.0:
        reason = f"the base is out of the ball's way at the {surface} face"
        return ShopVerdict(name="relief", surface=surface, holds=True, reason=reason)
    clear = f"with this base the ball reaches {100.0 * relief.flush_fraction:.1f} % of the {surface} face"
    reason = f"{clear}; {_remedy(relief, retreat, setback)}"
    return ShopVerdict(name="relief", surface=surface, holds=False, reason=reason)


def _asked_for(relief: OuterRelief | InnerRelief | OwnBaseRelief) -> tuple[float | None, float]:
    """How far (mm) the base must retreat, None where nothing is reached, and the wall of its step stand back."""
    match relief:
        case OuterRelief():
            return relief.smallest_step_mm, relief.step_clearance_mm or 0.0
        case InnerRelief():
            return relief.bore_clearance_mm, 0.0
        case OwnBaseRelief():
            return relief.retreat_mm, 0.0


def _remedy(relief: OuterRelief | InnerRelief | OwnBaseRelief, retreat_mm: float, setback_mm: float) -> str:
    match relief:
        case OwnBaseRelief():
            return f"its file must draw back by up to {retreat_mm:.4g} mm where it is in the ball's way"
        case InnerRelief():
            return f"a bore {retreat_mm:.4g} mm wider all around than the cavity keeps the base out of its way"
        case OuterRelief() if setback_mm <= 0.0:
            return f"base.relief_step_mm = {_up(retreat_mm)} keeps the base out of its way"
        case OuterRelief():
            step = f"base.relief_step_mm = {_up(retreat_mm)} and " if retreat_mm > 0.0 else ""
            return f"the rim is undercut: it takes {step}base.relief_setback_mm = {_up(setback_mm)}"


def _up(length_mm: float) -> str:
    """A length to write into a spec: rounded up to 0.1 um, so that it is enough."""
    return f"{ceil(1e4 * length_mm) / 1e4:g}"


def tilt_verdict(surface: Side, slope_deg: float, allowed_deg: float) -> ShopVerdict:
    """Whether a five-axis head can hold the tool along the normal everywhere."""
    holds = slope_deg <= allowed_deg + 1e-6
    reason = (
        f"the {surface} face is up to {slope_deg:.2f} deg steep; a tool held normal to it "
        f"{'stays within' if holds else 'would pass'} manufacture.max_tilt_deg = {allowed_deg:g}"
    )
    return ShopVerdict(name="tilt", surface=surface, holds=holds, reason=reason)


def wall_verdict(wall_mm: float, wanted_mm: float) -> ShopVerdict:
    """Whether the thinnest wall, along the normal too, is as thick as the radial thickness that the spec asks for."""
    holds = wall_mm >= wanted_mm
    word = "at least" if holds else "less than"
    reason = (
        f"the thinnest wall is {wall_mm:.4g} mm, {word} constraints.min_thickness_mm = {wanted_mm:g}, "
        "which bounds the radial thickness only"
    )
    return ShopVerdict(name="wall", surface="body", holds=holds, reason=reason)


def draft_verdict(surface: Side, face: FaceResult) -> ShopVerdict:
    """Whether a two-part mould opens along the axis."""
    least_deg, undercut = face.draft_deg.min, face.undercut_fraction
    if undercut > 0.0:
        reason = f"{100.0 * undercut:.2f} % of the {surface} face is undercut, down to a draft of {least_deg:.2f} deg"
    else:
        reason = f"the least draft of the {surface} face is {least_deg:.2f} deg; moulds want {GOOD_DRAFT_DEG:g} deg"
    return ShopVerdict(name="draft", surface=surface, holds=least_deg >= GOOD_DRAFT_DEG, reason=reason)


def tool_verdicts(tool: ToolResult) -> list[ShopVerdict]:
    """Whether a tool cuts all of each face, and what stops it."""
    return [_tool_verdict(tool, surface) for surface in SIDES]


def _tool_verdict(tool: ToolResult, surface: Side) -> ShopVerdict:
    reach = tool.inner if surface == "inner" else tool.outer
    ball, whole = reach.ball_reachable_fraction, reach.reachable_fraction
    reason = f"{tool.name} reaches {100.0 * whole:.1f} % of the {surface} face"
    if whole < ball - 1e-9:
        reason += f"; its ball alone {100.0 * ball:.1f} %: shank or holder is in the way, a longer one may do"
    if ball < _WHOLE and reach.largest_radius_mm is not None:
        reason += f"; the largest ball that reaches all of it is {reach.largest_radius_mm:.4g} mm"
    return ShopVerdict(name="tool", surface=surface, holds=whole >= _WHOLE, reason=reason)
