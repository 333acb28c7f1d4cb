"""Advice on a finding that does not hold: the fields of the spec to change, and to which values."""

from math import ceil, floor

from lensforge.manufacturing.findings import GOOD_DRAFT_DEG, asked_draft_deg
from lensforge.manufacturing.result import Check, FaceName, Finding, ToolResult
from lensforge.spec import Spec

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
