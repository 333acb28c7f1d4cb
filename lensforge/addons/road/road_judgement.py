"""Judgement of the light on a road by the candela of its lamps: what every driver sees, its class, and its cost.

Figures are those of EN 13201-3:2015, classes those of EN 13201-2:2015, power and energy those of EN 13201-5:2015; of a
class of RP-8 those of its luminance method. They are those of the table that the photometric file holds; of light by
independent samples of rays each has a standard error by the jackknife, of a file none.
"""

from collections.abc import Iterator

from lensforge.addons.road.road_classes import THRESHOLD_INCREMENT, VEILING_RATIO, asked_of
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
    read = IntensityFigures(candela)
    kept = readings.illuminance.times(road.maintenance_factor)
    mean_lx = read.figure(PlaceLight(), ">=", "lx", kept.mean())
    drivers = tuple(_drivers(readings, read))
    least_lx = read.figure(PlaceLight(), ">=", "lx", kept)
    uniformity_lx = read.figure(LeastOverMean(), ">=", "", kept)
    right, left = (read.figure(RatioOfTwo(), ">=", "", edge) for edge in readings.edges)
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
        limits=tuple(read.judged(asked_of(readings), name)),
        standard=road.standard,
    )


def _drivers(readings: RoadReadings, read: IntensityFigures) -> Iterator[SeenRoad]:
    road = readings.road
    observers = zip(readings.luminance, readings.veiling, readings.seen_lux, strict=True)
    for number, (seen, veiling, lux) in enumerate(observers):
        kept = seen.times(road.maintenance_factor)
        glaring = CandelaSum.joined((veiling, seen.mean()))
        along = kept if road.by_rp8 else kept.places(readings.middle(number))
        yield SeenRoad(
            lane=1 + number * (road.lanes - road.oncoming_lanes if road.by_rp8 else 1),
            mean_cd_per_m2=read.figure(PlaceLight(), ">=", "cd/m²", kept.mean()),
            uniformity=read.figure(LeastOverMean(), ">=", "", kept),
            uniformity_along=read.figure(LeastOverMost(), ">=", "", along),
            glare_percent=None if road.by_rp8 else read.figure(THRESHOLD_INCREMENT, "<=", "%", glaring),
            luminance_per_lux=read.figure(RatioOfTwo(), ">=", "cd/m²/lx", CandelaSum.joined((seen.mean(), lux))),
            veiling_ratio=read.figure(VEILING_RATIO, "<=", "", glaring) if road.by_rp8 else None,
        )


def _power_density(lamp_w: float | None, mean_lx: Metric, area_m2: float) -> Metric | None:
    if lamp_w is None or not mean_lx.value > 0.0:
        return None
    return scaled(mean_lx, lamp_w / (mean_lx.value**2 * area_m2), "W/lx/m²")  # the relative error is that of the lux


def _reached(
    road: RoadSection, drivers: tuple[SeenRoad, ...], edges: tuple[Metric, Metric], lux: tuple[Metric, Metric, Metric]
) -> str:
    """The best class of the kind that ``road`` asks for; ``lux``: mean, least and uniformity of the illuminance."""
    if road.by_rp8:
        return classes_held(drivers)
    if road.by_luminance:
        return best_class(drivers, edges)
    mean, least, uniformity = (each.value for each in lux)
    return p_class(mean, least) if road.lighting_class in P_CLASSES else c_class(mean, uniformity)


def p_class(mean_lx: float, least_lx: float) -> str:
    """Best class P of this mean and least illuminance; "none" where the mean exceeds 1.5 times all that are met."""
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
    """Best class M whose numbers all ``drivers`` and both ``edges`` have."""
    edge = min(edge.value for edge in edges)
    mean, uniformity, along = _least_seen(drivers)
    glare = max(driver.glare_percent.value for driver in drivers if driver.glare_percent is not None)
    for name, asked in M_CLASSES.items():
        bright = mean >= asked.mean
        even = uniformity >= asked.uniformity and along >= asked.along
        if bright and even and glare <= asked.glare_percent and edge >= asked.edge_ratio:
            return name
    return _NONE


def classes_held(drivers: tuple[SeenRoad, ...]) -> str:
    """All classes of RP-8 whose numbers all ``drivers`` have."""
    mean, uniformity, least_over_largest = _least_seen(drivers)
    veiling = max(driver.veiling_ratio.value for driver in drivers if driver.veiling_ratio is not None)
    held = (
        name
        for name, asked in RP8_CLASSES.items()
        if mean >= asked.mean
        and uniformity * asked.mean_over_least >= 1.0
        and least_over_largest * asked.largest_over_least >= 1.0
        and veiling <= asked.veiling
    )
    return ", ".join(held) or _NONE


def held_spacing(road: RoadSection, candela: Candela, most_steps: int = 120) -> HeldSpacing | None:
    """The largest spacing at which lamps of these intensities hold the class of ``road``, all else as it is.

    By steps of a tenth of the pole height, from ``most_steps`` of them down to a half of it, and to 1 mm at both ends;
    None if no step holds it.
    """
    read = IntensityFigures(candela)

    def missed(spacing_m: float) -> Fact | None:
        readings = RoadReadings.of(road.changed(pole_spacing_m=spacing_m))
        return next((limit for limit in read.judged(asked_of(readings), "") if not limit.holds), None)

    def end(inside: float, outside: float) -> tuple[float, Fact | None]:
        why = missed(outside)
        while abs(outside - inside) > _END_M:
            middle = 0.5 * (inside + outside)
            found = missed(middle)
            inside, outside, why = (middle, outside, why) if found is None else (inside, middle, found)
        return inside, why

    falling = [road.pole_height_m * step / 10.0 for step in range(most_steps, _LEAST_STEPS - 1, -1)]
    first = next((k for k, step in enumerate(falling) if missed(step) is None), None)
    if first is None:
        return None
    largest, beyond = (falling[0], None) if first == 0 else end(falling[first], falling[first - 1])
    nearer = next((k for k in range(first, len(falling)) if missed(falling[k]) is not None), None)
    least = falling[-1] if nearer is None else end(falling[nearer - 1], falling[nearer])[0]
    return HeldSpacing(least, largest, beyond)
