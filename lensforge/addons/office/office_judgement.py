"""Judgement of the light in an office by the candela of its lamps."""

from collections.abc import Iterator

from lensforge.addons.office.office_record import OfficeJudgement
from lensforge.addons.office.office_room import OfficeReadings
from lensforge.addons.office.office_section import CLASSES, OfficeSection
from lensforge.light.by_intensities import IntensityFigures
from lensforge.results import Metric
from lensforge.scene.intensity_limit import Candela, IntensityLimit
from lensforge.spec.quantities import LeastOverMean, PlaceLight


def judge_office(
    office: OfficeSection, candela: Candela, required: Iterator[IntensityLimit], name: str
) -> OfficeJudgement:
    """Judge the light of lamps of these intensities in ``office``; ``required``: both ratings, then other limits."""
    read = IntensityFigures(candela)
    readings = OfficeReadings(office)
    limits = tuple(read.judged(required, name))
    crosswise, endwise = (limit.metric for limit in limits[:2])
    largest = max(crosswise.value, endwise.value)
    return OfficeJudgement(
        name=name,
        lighting_class=office.lighting_class,
        reached=next((lighting_class for lighting_class, most in CLASSES.items() if largest <= most), "none"),
        limits=limits,
        crosswise=crosswise,
        endwise=endwise,
        background_cd_per_m2=read.figure(PlaceLight(), ">=", "cd/m²", readings.background()),
        **_on_plane(office, readings, read),
    )


def _on_plane(office: OfficeSection, readings: OfficeReadings, read: IntensityFigures) -> dict[str, Metric]:
    """Figures of the working plane; none without a pitch of the lamps."""
    if office.pitch_m is None:
        return {}
    light = readings.plane(office.pitch_m)
    mean = read.figure(PlaceLight(), ">=", "lx", light.mean())
    return {"mean_lx": mean, "uniformity": read.figure(LeastOverMean(), ">=", "", light)}
