"""The light on the screen: what lands on the receivers, the limits that it keeps, and the far field."""

from collections.abc import Iterator

from lensforge.cli.rounded import count, figure, in_percent, measured, share, times
from lensforge.cli.screen import Block, Row
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry, PlaneFigures
from lensforge.light.receiver_light import LARGEST_NMSE, ReceiverLight, Region
from lensforge.proof.stray_result import StrayLight
from lensforge.results.chart import light_unit

_REGIONS: dict[Region, str] = {"uniform": "where it should be uniform", "bright": "where the target is bright"}
_MOST_RECEIVERS, _MOST_LIMITS = 4, 3


def light_rows(light: Light) -> Iterator[Row]:
    """Lines on the light: of the only receiver in full, of several a line each, and the limits."""
    if len(light.receivers) == 1:
        yield from _on_one_receiver(light)
    else:
        yield from _on_several(light)
    yield from _limit_rows(light)
    pixels = f"{count(light.pixels)} pixels across"
    unused = "" if light.fitted is None else " that the search has not used"
    yield "Simulated with", f"{count(light.rays)} rays{unused}, {pixels}, {light.filter.partition(',')[0]} filter"
    if light.fitted is not None:
        fitted = light.fitted
        words = f"NMSE {measured(fitted.nmse)}, efficiency {in_percent(fitted.efficiency)}"
        yield "  fitted rays", f"{words} by the {count(fitted.rays)} rays of the search"


def _on_one_receiver(light: Light) -> Iterator[Row]:
    lit = light.first
    bound = "" if light.limits else f", at most {LARGEST_NMSE:g}"
    yield "Error (NMSE)", f"{measured(lit.nmse)} (0 is perfect{bound}){_by_raster(lit)}"
    most = lit.possible
    window = f"within {lit.where}" if lit.kind == "far_field" else lit.where
    yield "Efficiency", f"{in_percent(lit.efficiency)} {window} (possible: {share(most.efficiency)})"
    yield "In the target", f"{in_percent(lit.share_in_target)} (possible: {share(most.share_in_target)})"
    yield from _evenness(lit, light.lumens_per_watt)


def _by_raster(lit: ReceiverLight) -> str:
    """Words for the NMSE with half as many pixels, where the change is above its noise."""
    change, error = lit.nmse_of_raster, lit.nmse.standard_error
    if change is None or abs(change) <= (error or 0.0):
        return ""
    return f"; with half as many pixels {figure(lit.nmse.value - change, '', 2)}"


def _evenness(lit: ReceiverLight, lumens_per_watt: float | None) -> Iterator[Row]:
    """Uniformity in the region of uniform light; mean and inner evenness there or where the target is bright; peak."""
    if lit.uniformity is not None:
        rsd = "" if lit.rsd is None else f"; RSD {measured(lit.rsd)}"
        yield "Uniformity", f"{measured(lit.uniformity)} {lit.evenness_words}{rsd}"
    if lit.in_region is not None:
        unit = light_unit(lumens_per_watt, far_field=lit.chart.far_field)
        mean = times(lit.in_region.mean, unit.per_watt, unit.symbol)
        yield f"Mean {unit.quantity}", f"{mean} {_REGIONS[lit.in_region.region]}"
        inner, left = measured(lit.in_region.inner), share(lit.in_region.inner_share)
        yield "Evenness", f"{inner} least over mean in the inner {left} of that region"
        yield "Peak to target", f"{measured(lit.in_region.peak)} (largest light over the target's largest)"


def _on_several(light: Light) -> Iterator[Row]:
    for lit in light.receivers[:_MOST_RECEIVERS]:
        yield (
            lit.name,
            f"NMSE {measured(lit.nmse)}; efficiency {in_percent(lit.efficiency)}, in the target "
            f"{in_percent(lit.share_in_target)}",
        )
    left = len(light.receivers) - _MOST_RECEIVERS
    if left > 0:
        yield "", f"and {left} more receivers, in evaluate.json"


def _limit_rows(light: Light) -> Iterator[Row]:
    """The number of limits that are held, and the first of the others."""
    if not light.limits:
        return
    others = [limit for limit in light.limits if limit.state != "held"]
    yield "Limits", f"{len(light.limits) - len(others)} of {len(light.limits)} held"
    for limit in others[:_MOST_LIMITS]:
        yield f"  {limit.state}", str(limit)
    if len(others) > _MOST_LIMITS:
        yield "", f"and {len(others) - _MOST_LIMITS} more, in evaluate.json"


def photometry_rows(found: Photometry) -> Iterator[Row]:
    """Lines on the far field: lumens, candela, beam angles, and what a lamp for a road is rated."""
    taken = " (the spec states no flux)" if found.per_1000_lm else ""
    yield "Luminous flux", f"{measured(found.exit_lm)} of {figure(found.source_lm, 'lm', 6)}{taken}"
    yield "Intensity", f"{measured(found.peak_cd)} at the peak, {measured(found.axis_cd)} on the axis"
    if found.beam_c0.beam_angle_deg is not None or found.beam_c90.beam_angle_deg is not None:
        yield "Beam angle", f"{_beam(found.beam_c0)}, {_beam(found.beam_c90)}"
    if found.road is not None:
        yield "Road", f"{found.road.distribution}; BUG {found.road.bug}"


def _beam(plane: PlaneFigures) -> str:
    angle = "no light" if plane.beam_angle_deg is None else measured(plane.beam_angle_deg)
    return f"{angle} in C{plane.c_deg:.0f}"


def stray_block(stray: StrayLight) -> Block:
    """Reflections, the base and absorption, as shares of the emitted flux."""
    rows = [
        ("In the window", f"{share(stray.flux.detected_stray)} of the flux, by reflections; the base is {stray.base}"),
        ("Followed", f"{count(stray.rays)} rays"),
    ]
    return Block("Stray light", rows)
