"""Section of the report on photometry: lumens, candela, beam angles, uniformities, and what a lamp on a road gives."""

from collections.abc import Iterator
from dataclasses import dataclass

from lensforge.light.photometry_result import Photometry
from lensforge.light.receiver_light import REGIONS
from lensforge.light.road_lighting import RoadFigures
from lensforge.report.numerals import number, number_with_error, percent
from lensforge.report.photometry_figures import ground_diagram, isocandela_diagram, polar_diagram
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.shown_receivers import ShownReceiver, shown_receivers
from lensforge.results import Metric
from lensforge.runs.results import Results
from lensforge.spec.light_limits import PhotometrySection

Fact = tuple[str, str]
_ZONES = {
    "forward_low": "forward, 0° to 30°", "forward_mid": "forward, 30° to 60°", "forward_high": "forward, 60° to 80°",
    "forward_very_high": "forward, 80° to 90°", "back_low": "back, 0° to 30°", "back_mid": "back, 30° to 60°",
    "back_high": "back, 60° to 80°", "back_very_high": "back, 80° to 90°",
}  # fmt: skip


@dataclass(frozen=True)
class ShownPhotometry:
    """Facts by their title, pictures, and a sentence on the conditions; the ``long`` tables may be folded away."""

    sentence: str
    tables: dict[str, list[Fact]]
    pictures: list[PagePicture]
    long: tuple[str, ...] = ()

    @property
    def folded(self) -> str:
        """Title of what is folded away: the pictures but the first, and the long tables."""
        return ", ".join([*(each.title for each in self.pictures[1:]), *self.long])


def photometry_section(results: Results) -> ShownPhotometry | None:
    """The section; None where neither light nor far field is known."""
    found, tables = results.find(Photometry), {}
    for shown in shown_receivers(results):
        if facts := list(_region_facts(shown)):
            tables[f"On {shown.light.name}" if shown.several else "On the receiver"] = facts
    further = tuple(tables)[1:]
    if found is None:
        return ShownPhotometry("", tables, [], further) if tables else None
    section = results.spec.photometry
    far = {"Far field": list(_far_field_facts(found))}
    if found.road is not None:
        far |= {"Lamp": list(_lamp_facts(found.road, section)), "Zones": _zone_facts(found.road)}
    long = ("Zones",) if "Zones" in far else ()
    return ShownPhotometry(_sentence(found), far | tables, _pictures(found, section), (*long, *further))


def _sentence(found: Photometry) -> str:
    basis = "per 1000 lm of the source, whose own are not known" if found.per_1000_lm else ""
    noise = "" if found.node_error is None else f"; the table's noise is {percent(found.node_error.rms)} rms"
    return f"By {number(found.rays)} rays{noise}. Candela and lumens {basis or 'are absolute'}."


def _far_field_facts(found: Photometry) -> Iterator[Fact]:
    direction = found.peak_direction
    yield "light that leaves the lens", _words(found.exit_lm)
    place = f"C\u00a0{number(direction.c_deg, 4)}, gamma\u00a0{number(direction.gamma_deg, 3)}°"
    yield "peak intensity", _words(found.peak_cd)
    yield "direction of the peak", place
    yield "intensity on the axis", _words(found.axis_cd)
    for name, beam in (("C 0 – C 180", found.beam_c0), ("C 90 – C 270", found.beam_c90)):
        yield f"beam angle (50 %), {name}", _words(beam.beam_angle_deg)
        yield f"field angle (10 %), {name}", _words(beam.field_angle_deg)


def _region_facts(shown: ShownReceiver) -> Iterator[Fact]:
    """Mean light and uniformities of one receiver, in the unit in which it is shown."""
    found, unit = shown.light.in_region, shown.unit
    if found is None:
        return
    error = found.mean.standard_error
    mean = Metric(
        value=found.mean.value * unit.per_watt,
        unit=unit.symbol,
        standard_error=None if error is None else error * unit.per_watt,
    )
    yield "region", REGIONS[found.region].removeprefix("in ")
    yield f"mean {unit.quantity}", _words(mean)
    yield "U0, least over mean", number_with_error(found.u0, 3)
    yield "U1, least over largest", number_with_error(found.u1, 3)


def _lamp_facts(road: RoadFigures, section: PhotometrySection) -> Iterator[Fact]:
    shape = road.distribution
    yield "lenses", number(section.lenses)
    yield "light of the lamp", _words(road.lumens)
    yield "IES distribution", str(shape).removeprefix("type ")
    yield "half of the peak reaches", f"{number_with_error(shape.street_mh, 3)} heights to the street"
    yield "BUG rating", str(road.bug)
    glare = road.glare
    yield "glare class (EN 13201)", glare.glare_class
    yield "most cd/klm from 70° and from 80°", f"{_plain(glare.above_70)}; {_plain(glare.above_80)}"
    if road.road is None:
        return
    lit = road.road
    yield "mean illuminance", _words(lit.mean_lx)
    yield "least illuminance", _words(lit.least_lx)
    yield "U0 on the road", number_with_error(lit.uniformity, 3)
    yield "classes (EN 13201)", f"P: {lit.p_class}; C: {lit.c_class}"


def _zone_facts(road: RoadFigures) -> list[Fact]:
    zones = road.bug.zones
    return [(words, _words(getattr(zones, name))) for name, words in _ZONES.items()]


def _pictures(found: Photometry, section: PhotometrySection) -> list[PagePicture]:
    drawn = [
        picture("polar", polar_diagram(found), "Polar diagram", "Intensity (cd); gamma = 0 is the axis of the lens."),
        picture("isocandela", isocandela_diagram(found), "Isocandela", "C around, gamma outwards, as in the files."),
    ]
    if found.road is not None:
        ground = ground_diagram(found, section.street_side_deg, section.lenses, section.pole_height_m)
        drawn.append(
            picture("ground", ground, "On the ground", "One lamp at the centre; above the line is the street.")
        )
    return drawn


def _words(metric: Metric | None) -> str:
    """Value with its error and unit."""
    if metric is None:
        return "–"
    gap = "" if metric.unit == "°" else " "
    return f"{_plain(metric)}{gap}{metric.unit}"


def _plain(metric: Metric) -> str:
    return number_with_error(metric.model_copy(update={"unit": ""}), 4)
