"""What the shop can and cannot do with this lens: statements with a reason, which judge the tool, not the design."""

from math import ceil
from typing import Literal

from lensforge.records import Flag, Record, Text

GOOD_DRAFT_DEG = 2.0


class ShopVerdict(Record):
    """One statement: about what, of which face, whether it holds, and why."""

    name: Literal["cutter", "relief", "tilt", "wall", "draft", "tool"]
    surface: Literal["inner", "outer", "body"]
    holds: Flag
    reason: Text


def cutter_verdict(
    surface: Literal["inner", "outer"], radius_mm: float, reachable_fraction: float, largest_mm: float
) -> ShopVerdict:
    """Whether a ball of ``radius_mm`` cuts the whole face."""
    ball = f"a ball of {radius_mm:g} mm radius"
    if largest_mm >= radius_mm * (1.0 - 1e-6):
        room = "any ball does" if largest_mm == float("inf") else f"balls up to {largest_mm:.4g} mm do"
        return ShopVerdict(name="cutter", surface=surface, holds=True, reason=f"{ball} reaches all of the {surface} face; {room}")
    reason = (
        f"{ball} reaches {100.0 * reachable_fraction:.1f} % of the {surface} face; "
        f"the largest that reaches all of it is {largest_mm:.4g} mm"
    )
    return ShopVerdict(name="cutter", surface=surface, holds=False, reason=reason)


def relief_verdict(
    surface: Literal["inner", "outer"], retreat_mm: float | None, clear_fraction: float, setback_mm: float | None = None
) -> ShopVerdict:
    """Whether the base, as the spec has it, and a bore as wide as the cavity, leave the ball its room.

    ``setback_mm``: how far the wall of a step must stand back from the outer rim, where that is undercut.
    """
    if retreat_mm is None:
        return ShopVerdict(name="relief", surface=surface, holds=False, reason=f"the cutter reaches nothing of the {surface} face, base or not")
    setback = setback_mm or 0.0
    if retreat_mm <= 0.0 and setback <= 0.0:
        return ShopVerdict(name="relief", surface=surface, holds=True, reason=f"the base is out of the ball's way at the {surface} face")
    clear = f"with this base the ball reaches {100.0 * clear_fraction:.1f} % of the {surface} face"
    if surface == "inner":
        remedy = f"a bore {retreat_mm:.4g} mm wider all around than the cavity keeps the base out of its way"
    elif setback <= 0.0:
        remedy = f"base.relief_step_mm = {_up(retreat_mm)} keeps the base out of its way"
    else:
        step = f"base.relief_step_mm = {_up(retreat_mm)} and " if retreat_mm > 0.0 else ""
        remedy = f"the rim is undercut: it takes {step}base.relief_setback_mm = {_up(setback)}"
    return ShopVerdict(name="relief", surface=surface, holds=False, reason=f"{clear}; {remedy}")


def _up(length_mm: float) -> str:
    """A length to write into a spec: rounded up to 0.1 um, so that it is enough."""
    return f"{ceil(1e4 * length_mm) / 1e4:g}"


def own_base_verdict(surface: Literal["inner", "outer"], retreat_mm: float | None, clear_fraction: float) -> ShopVerdict:
    """Whether a base from a STEP file leaves the ball its room."""
    if retreat_mm is None:
        return ShopVerdict(name="relief", surface=surface, holds=False, reason=f"the cutter reaches nothing of the {surface} face, base or not")
    if retreat_mm <= 0.0:
        return ShopVerdict(name="relief", surface=surface, holds=True, reason=f"the base is out of the ball's way at the {surface} face")
    reason = (
        f"with this base the ball reaches {100.0 * clear_fraction:.1f} % of the {surface} face; "
        f"its file must draw back by up to {retreat_mm:.4g} mm where it is in the ball's way"
    )
    return ShopVerdict(name="relief", surface=surface, holds=False, reason=reason)


def tilt_verdict(surface: Literal["inner", "outer"], slope_deg: float, allowed_deg: float) -> ShopVerdict:
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


def draft_verdict(surface: Literal["inner", "outer"], least_deg: float, undercut: float) -> ShopVerdict:
    """Whether a two-part mould opens along the axis."""
    holds = least_deg >= GOOD_DRAFT_DEG
    if undercut > 0.0:
        reason = f"{100.0 * undercut:.2f} % of the {surface} face is undercut, down to a draft of {least_deg:.2f} deg"
    else:
        reason = f"the least draft of the {surface} face is {least_deg:.2f} deg; moulds want {GOOD_DRAFT_DEG:g} deg"
    return ShopVerdict(name="draft", surface=surface, holds=holds, reason=reason)
