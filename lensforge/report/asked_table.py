"""The first table of the report: each thing that was asked for beside what came out; light, then size, then shop."""

from collections.abc import Iterator

from lensforge.cad.part import Part
from lensforge.report.asked_light_rows import AskedRow, AskedState, light_rows
from lensforge.report.headline import criteria_state
from lensforge.report.numerals import NOTHING, number
from lensforge.runs.results import Results
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check, FaceResult


def asked_rows(results: Results) -> list[AskedRow]:
    """Rows of the light, of the lens's size and of its manufacture, as far as the stages have run."""
    return [*light_rows(results), *_size_rows(results), *_wall_rows(results), *_shop_rows(results)]


def _state(results: Results, *names: str) -> AskedState:
    """State of the criteria called ``names``, of all stages."""
    return criteria_state((criterion for _, criterion in results.criteria()), *names)


def _mm(value: float) -> str:
    return f"{number(value, 4)} mm"


def _size_rows(results: Results) -> Iterator[AskedRow]:
    design, part, limits = results.find(Design), results.find(Part), results.spec.constraints
    if design is not None:
        yield AskedRow(
            name="Lens, farthest point from the LED",
            asked=f"≤ {_mm(limits.max_radius_mm)}",
            got=_mm(design.max_radius_mm),
            state=_state(results, "radius margin"),
            note="not half its width: the distance in space, without the base",
        )
        yield AskedRow(
            name="Height above the LED",
            asked=NOTHING if limits.max_height_mm is None else f"≤ {_mm(limits.max_height_mm)}",
            got=_mm(design.height_mm),
            state=_state(results, "height margin"),
        )
        yield AskedRow(
            name="Free space over the LED",
            asked="clear",
            got=f"{_mm(design.constraints.cavity_clearance_mm)} to spare",
            state=_state(results, "cavity clearance"),
            note=f"a dome {limits.cavity_height_mm:g} mm high, {2.0 * limits.cavity_radius_mm:g} mm wide",
        )
    if part is not None and part.keep_out is not None:
        yield AskedRow(
            name="Distance from the keep-out solid",
            asked=f"≥ {_mm(limits.keep_out_margin_mm)}",
            got=_mm(part.keep_out.distance_mm),
            state=_state(results, "keep_out_distance"),
            note="of lens and base",
        )


def _wall_rows(results: Results) -> Iterator[AskedRow]:
    check, limits = results.find(Check), results.spec.constraints
    if check is None:
        return
    yield AskedRow(
        name="Thinnest wall",
        asked=f"≥ {_mm(limits.min_thickness_mm)}",
        got=_mm(check.min_wall_mm),
        state=_state(results, "thinnest wall"),
        note="along the normal",
    )
    if limits.max_wall_mm is not None:
        yield AskedRow(
            name="Thickest wall",
            asked=f"≤ {_mm(limits.max_wall_mm)}",
            got=_mm(check.wall.thickest.thickness_mm),
            state=_state(results, "largest radial wall"),
            note="seen from the LED",
        )


def _shop_rows(results: Results) -> Iterator[AskedRow]:
    """The ball mill that reaches all of both faces, and the draft where the spec has a least one."""
    check, limits = results.find(Check), results.spec.constraints
    if check is None:
        return
    tightest = min((check.inner, check.outer), key=largest_mill)
    largest, shop = tightest.cutter.largest_radius_mm, tightest.cutter.radius_mm
    reached = [finding.holds for finding in check.verdicts if finding.name == "cutter"]
    yield AskedRow(
        name="Ball mill that reaches every hollow",
        asked=f"radius {_mm(shop)}",
        got="any" if largest is None else f"radius ≤ {number(largest, 3)} mm",
        state=("pass" if all(reached) else "fail") if reached else "",
        note=f"asked: that of the shop{check.relief.beyond_shop(largest, shop)}",
    )
    for side, face, least in (
        ("inner", check.inner, limits.inner_draft_deg),
        ("outer", check.outer, limits.outer_draft_deg),
    ):
        if least is not None:
            state = _state(results, f"{side} draft margin")
            yield AskedRow(f"Draft of the {side} face", f"≥ {least:g}°", f"{number(face.draft_deg.min, 3)}°", state)


def largest_mill(face: FaceResult) -> float:
    """Largest radius (mm) of a ball mill that reaches all of ``face``; infinite where any does."""
    largest = face.cutter.largest_radius_mm
    return float("inf") if largest is None else largest
