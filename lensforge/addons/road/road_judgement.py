"""Judgement of the light on a road by the candela of its lamps: what every driver sees, its class, and its cost.

Figures are those of EN 13201-3:2015, classes those of EN 13201-2:2015, power and energy those of EN 13201-5:2015; of a
class of RP-8 those of its luminance method. They are those of the table that the photometric file holds; of light by
independent samples of rays each has a standard error by the jackknife, of a file none.
"""

from collections.abc import Iterator

from lensforge.addons.road.road_classes import THRESHOLD_INCREMENT, VEILING_RATIO, requirements_of
from lensforge.addons.road.road_facts import HeldSpacing
from lensforge.addons.road.road_field import RoadReadings
from lensforge.addons.road.road_record import RoadJudgement, SeenRoad
from lensforge.addons.road.road_section import (
    C_CLASSES,
    C_UNIFORMITY,
    M_CLASSES,
    P_CLASSES,
    P_MOST,
    RP8_CLASSES,
    RoadSection,
)
from lensforge.addons.road.road_surface import RoadSurface
from lensforge.light.by_intensities import IntensityFigures
from lensforge.results import Fact, Metric
from lensforge.results.estimates import scaled
from lensforge.scene.intensity_limit import Candela, CandelaSum
from lensforge.spec.quantities import LeastOverMean, LeastOverMost, PlaceLight, RatioOfTwo

_NONE = "none"
_KWH_PER_WH = 1e-3
_LEAST_STEPS = 5  # of a tenth of the pole height, of spacings tried
_END_M = 1e-3


def judge_road(road: RoadSection, candela: Candela, name: str = "road") -> RoadJudgement:
    """Judge the light of lamps of these intensities on ``road``. Raises :class:`InputError` for its file."""
    readings = RoadReadings.of(road)
    surface = RoadSurface.of(road.surface, road.surface_file, road.surface_q0)
    figures = IntensityFigures(candela)
    maintained = readings.illuminance.times(road.maintenance_factor)
    mean_lx = figures.figure(PlaceLight(), ">=", "lx", maintained.mean())
    drivers = tuple(_drivers(readings, figures))
    least_lx = figures.figure(PlaceLight(), ">=", "lx", maintained)
    uniformity_lx = figures.figure(LeastOverMean(), ">=", "", maintained)
    right, left = (figures.figure(RatioOfTwo(), ">=", "", edge) for edge in readings.edges)
    lamps = 2 if road.arrangement in ("opposite", "staggered") else 1  # of two on a median one lights another road
    area = road.width_m * road.pole_spacing_m / lamps
    return RoadJudgement(
        name=name,
        lighting_class=road.lighting_class,
        reached=_reached(road, drivers, (right, left), (mean_lx, least_lx, uniformity_lx)),
        surface=surface.name,
        q0=surface.q0,
        s1=surface.s1,
        drivers=drivers,
        edges=(right, left),
        mean_lx=mean_lx,
        least_lx=least_lx,
        uniformity_lx=uniformity_lx,
        power_density=_power_density(road.lamp_w, mean_lx, area),
        yearly_energy=None
        if road.lamp_w is None
        else Metric(value=_KWH_PER_WH * road.lamp_w * road.hours / area, unit="kWh/m²", standard_error=0.0),
        limits=tuple(figures.judged(requirements_of(readings), name)),
        standard=road.standard,
    )


def _drivers(readings: RoadReadings, figures: IntensityFigures) -> Iterator[SeenRoad]:
    road = readings.road
    observers = zip(readings.luminance, readings.veiling, readings.seen_lux, strict=True)
    for number, (seen, veiling, lux) in enumerate(observers):
        maintained = seen.times(road.maintenance_factor)
        glaring = CandelaSum.joined((veiling, seen.mean()))
        along = maintained if road.by_rp8 else maintained.places(readings.middle(number))
        yield SeenRoad(
            lane=1 + number * (road.lanes - road.oncoming_lanes if road.by_rp8 else 1),
            mean_cd_per_m2=figures.figure(PlaceLight(), ">=", "cd/m²", maintained.mean()),
            uniformity=figures.figure(LeastOverMean(), ">=", "", maintained),
            uniformity_along=figures.figure(LeastOverMost(), ">=", "", along),
            glare_percent=None if road.by_rp8 else figures.figure(THRESHOLD_INCREMENT, "<=", "%", glaring),
            luminance_per_lux=figures.figure(RatioOfTwo(), ">=", "cd/m²/lx", CandelaSum.joined((seen.mean(), lux))),
            veiling_ratio=figures.figure(VEILING_RATIO, "<=", "", glaring) if road.by_rp8 else None,
        )


def _power_density(lamp_w: float | None, mean_lx: Metric, area_m2: float) -> Metric | None:
    if lamp_w is None or not mean_lx.value > 0.0:
        return None
    return scaled(mean_lx, lamp_w / (mean_lx.value**2 * area_m2), "W/lx/m²")  # the relative error is that of the lux


def _reached(
    road: RoadSection, drivers: tuple[SeenRoad, ...], edges: tuple[Metric, Metric], lux: tuple[Metric, Metric, Metric]
) -> str:
    """The best class of the kind that ``road`` requires; ``lux``: mean, least and uniformity of the illuminance."""
    if road.by_rp8:
        return classes_held(drivers)
    if road.by_luminance:
        return best_class(drivers, edges)
    mean, least, uniformity = (metric.value for metric in lux)
    return p_class(mean, least) if road.lighting_class in P_CLASSES else c_class(mean, uniformity)


def p_class(mean_lx: float, least_lx: float) -> str:
    """Best class P for this mean and least illuminance; "none" if the mean exceeds 1.5 times all classes it meets."""
    met = (name for name, (mean, least) in P_CLASSES.items() if mean <= mean_lx <= P_MOST * mean and least_lx >= least)
    return next(met, _NONE)


def c_class(mean_lx: float, uniformity: float) -> str:
    """Best class C of this mean illuminance and its uniformity."""
    met = (name for name, mean in C_CLASSES.items() if mean_lx >= mean and uniformity >= C_UNIFORMITY)
    return next(met, _NONE)


def _least_seen(drivers: tuple[SeenRoad, ...]) -> tuple[float, float, float]:
    names = "mean_cd_per_m2", "uniformity", "uniformity_along"
    mean, uniformity, along = (min(getattr(driver, name).value for driver in drivers) for name in names)
    return mean, uniformity, along


def best_class(drivers: tuple[SeenRoad, ...], edges: tuple[Metric, Metric]) -> str:
    """Best class M that all ``drivers`` and both ``edges`` meet."""
    edge = min(edge.value for edge in edges)
    mean, uniformity, along = _least_seen(drivers)
    glare = max(driver.glare_percent.value for driver in drivers if driver.glare_percent is not None)
    for name, required in M_CLASSES.items():
        bright = mean >= required.mean
        even = uniformity >= required.uniformity and along >= required.along
        if bright and even and glare <= required.glare_percent and edge >= required.edge_ratio:
            return name
    return _NONE


def classes_held(drivers: tuple[SeenRoad, ...]) -> str:
    """All classes of RP-8 that all ``drivers`` meet."""
    mean, uniformity, least_over_largest = _least_seen(drivers)
    veiling = max(driver.veiling_ratio.value for driver in drivers if driver.veiling_ratio is not None)
    held = (
        name
        for name, required in RP8_CLASSES.items()
        if mean >= required.mean
        and uniformity * required.mean_over_least >= 1.0
        and least_over_largest * required.largest_over_least >= 1.0
        and veiling <= required.veiling
    )
    return ", ".join(held) or _NONE


def held_spacing(road: RoadSection, candela: Candela, most_steps: int = 120) -> HeldSpacing | None:
    """The largest spacing at which lamps of these intensities keep the class of ``road``, other things being equal.

    By steps of a tenth of the pole height, from ``most_steps`` of them down to a half of it, and to 1 mm at both ends;
    None if no step holds it.
    """
    figures = IntensityFigures(candela)

    def missed(spacing_m: float) -> Fact | None:
        readings = RoadReadings.of(road.changed(pole_spacing_m=spacing_m))
        return next((limit for limit in figures.judged(requirements_of(readings), "") if not limit.holds), None)

    def end(inside: float, outside: float) -> tuple[float, Fact | None]:
        why = missed(outside)
        while abs(outside - inside) > _END_M:
            middle = 0.5 * (inside + outside)
            reason = missed(middle)
            inside, outside, why = (middle, outside, why) if reason is None else (inside, middle, reason)
        return inside, why

    falling = [road.pole_height_m * step / 10.0 for step in range(most_steps, _LEAST_STEPS - 1, -1)]
    first = next((k for k, step in enumerate(falling) if missed(step) is None), None)
    if first is None:
        return None
    largest, beyond = (falling[0], None) if first == 0 else end(falling[first], falling[first - 1])
    nearer = next((k for k in range(first, len(falling)) if missed(falling[k]) is not None), None)
    least = falling[-1] if nearer is None else end(falling[nearer - 1], falling[nearer])[0]
    return HeldSpacing(least, largest, beyond)
