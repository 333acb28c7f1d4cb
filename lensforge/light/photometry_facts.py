"""Facts of the photometry: lumens, candela, beam angles, and what a lamp on a road gives."""

from collections.abc import Iterator

from lensforge.light.photometry_result import Photometry
from lensforge.light.road_lighting import RoadFigures
from lensforge.results import Fact, Group
from lensforge.results.numerals import percent, quantity
from lensforge.spec import Spec

_ZONES = {
    "forward_low": "forward, 0° to 30°",
    "forward_mid": "forward, 30° to 60°",
    "forward_high": "forward, 60° to 80°",
    "forward_very_high": "forward, 80° to 90°",
    "back_low": "back, 0° to 30°",
    "back_mid": "back, 30° to 60°",
    "back_high": "back, 60° to 80°",
    "back_very_high": "back, 80° to 90°",
}


def photometry_facts(found: Photometry, spec: Spec) -> list[Group]:
    """Groups of the far field and, of a lamp for an area or a road, of the lamp and its zones."""
    groups = [Group("far_field", "Far field", tuple(_far_field(found)))]
    if found.road is None:
        return groups
    lamp = Group("lamp", "Lamp", tuple(_lamp(found.road, spec.photometry.lenses)))
    zones = (Fact.measured(name, words, getattr(found.road.bug.zones, name)) for name, words in _ZONES.items())
    return [*groups, lamp, Group("zones", "Zones", tuple(zones))]


def _far_field(found: Photometry) -> Iterator[Fact]:
    direction = found.peak_direction
    source = f"of {quantity(found.source_lm, 'lm')} of the source"
    taken = ", which states no flux: all figures are for these" if found.per_1000_lm else ""
    yield Fact.measured("exit_lm", "Luminous flux", found.exit_lm, f"{source}{taken}")
    at = f"at C {quantity(direction.c_deg, '°', digits=4)}, gamma {quantity(direction.gamma_deg, '°', digits=3)}"
    yield Fact.measured("peak_cd", "Peak intensity", found.peak_cd, at)
    yield Fact.measured("axis_cd", "Intensity on the axis", found.axis_cd)
    for beam in (found.beam_c0, found.beam_c90):
        plane = f"C {beam.c_deg:.0f}"
        note = "between the outermost halves of the largest intensity"
        yield Fact.measured(f"beam_{plane}", f"Beam angle, {plane}", beam.beam_angle_deg, note)
        yield Fact.measured(f"field_{plane}", f"Field angle, {plane}", beam.field_angle_deg, "of its tenths")
    noise = "" if found.node_error is None else f"the table’s noise is {percent(found.node_error.rms)} rms"
    yield Fact("photometry_rays", "Rays", found.rays, note=noise)


def _lamp(road: RoadFigures, lenses: int) -> Iterator[Fact]:
    shape, glare = road.distribution, road.glare
    yield Fact("lenses", "Lenses", lenses)
    yield Fact.measured("lamp_lm", "Light of the lamp", road.lumens)
    yield Fact("distribution", "IES distribution", str(shape).removeprefix("type "))
    yield Fact.measured("street_mh", "Half of the peak reaches", shape.street_mh, "mounting heights to the street")
    yield Fact("bug", "BUG rating", str(road.bug))
    yield Fact("glare_class", "Glare class", glare.glare_class, note="EN 13201")
    yield Fact.measured("above_70", "Most from 70° on", glare.above_70, "cd/klm")
    yield Fact.measured("above_80", "Most from 80° on", glare.above_80, "cd/klm")
    if (lit := road.road) is not None:
        yield Fact.measured("mean_lx", "Mean on the road", lit.mean_lx)
        yield Fact.measured("least_lx", "Least on the road", lit.least_lx)
        yield Fact.measured("road_u0", "U0 on the road", lit.uniformity)
        yield Fact("classes", "Classes (EN 13201)", f"P: {lit.p_class}; C: {lit.c_class}")
