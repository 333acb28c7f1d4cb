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
    mean, uniformity, glare = (limit.metric for limit in limits)
    sport = field.lighting_class.split()[0]
    kept = (
        lighting_class
        for lighting_class, bounds in CLASSES.items()
        if lighting_class.startswith(sport)
        and mean.value >= bounds.mean_lx
        and uniformity.value >= bounds.uniformity
        and glare.value <= bounds.glare
    )
    return SportsJudgement(
        name=name,
        lighting_class=field.lighting_class,
        reached=next(kept, "none"),
        limits=limits,
        mean_lx=mean,
        uniformity=uniformity,
        least_lx=read.figure(PlaceLight(), ">=", "lx", light),
        glare=glare,
    )
