"""Judgement of the light on a playing field by the candela of its lamps."""

from collections.abc import Iterator

from lensforge.addons.sports.sports_field import SportsReadings
from lensforge.addons.sports.sports_record import SportsJudgement
from lensforge.addons.sports.sports_section import CLASSES, SportsSection
from lensforge.light.by_intensities import IntensityFigures
from lensforge.scene.intensity_limit import Candela, IntensityLimit
from lensforge.spec.quantities import PlaceLight


def judge_field(
    field: SportsSection, candela: Candela, required: Iterator[IntensityLimit], name: str
) -> SportsJudgement:
    """Judge the light of lamps of these intensities on ``field``; ``required``: mean, uniformity and glare."""
    read = IntensityFigures(candela)
    light = SportsReadings(field).illuminance.times(field.maintenance_factor)
    limits = tuple(read.judged(required, name))
    mean, even, glare = (limit.metric for limit in limits)
    sport = field.lighting_class.split()[0]
    held = (
        each
        for each, asked in CLASSES.items()
        if each.startswith(sport)
        and mean.value >= asked.mean_lx
        and even.value >= asked.uniformity
        and glare.value <= asked.glare
    )
    return SportsJudgement(
        name=name,
        lighting_class=field.lighting_class,
        reached=next(held, "none"),
        limits=limits,
        mean_lx=mean,
        uniformity=even,
        least_lx=read.figure(PlaceLight(), ">=", "lx", light),
        glare=glare,
    )
