"""Classes of a road: each required figure, for each observer, as a sum over the candela of the lamps."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from lensforge.addons.road.road_field import AROUND, Points, RoadReadings, reduced_luminance, rows_of_lamps
from lensforge.addons.road.road_section import (
    C_CLASSES,
    C_UNIFORMITY,
    M_CLASSES,
    P_CLASSES,
    P_MOST,
    RP8_CLASSES,
    WET_UNIFORMITY,
)
from lensforge.scene.intensity_limit import CandelaSum, IntensityLimit, LumensBound
from lensforge.spec.quantities import (
    GlareLaw,
    LeastOverMean,
    LeastOverMost,
    MeanOverLeast,
    MostOverLeast,
    PlaceLight,
    RatioOfTwo,
)

# Of EN 13201-3, 8.5, in per cent; and of RP-8.
THRESHOLD_INCREMENT = GlareLaw("threshold increment", ((5.0, 65.0, 0.8), (inf, 95.0, 1.05)))
VEILING_RATIO = GlareLaw("veiling/mean luminance", ((inf, 1.0, 1.0),))
_LEVEL = 1e-6  # sine above the horizon of light beyond every table
_MOST_HEIGHTS = 100.0  # tan gamma where tables end


@dataclass(frozen=True, eq=False)
class FieldMean(LumensBound):
    """Mean light over the area of a field: luminance (cd/m^2) for the observer ``seen``, or illuminance (lx)."""

    law: ClassVar[str] = "lumens and area of the road"
    remedies: ClassVar[str] = "more lumens, poles nearer to each other, or a lower class"

    readings: RoadReadings
    seen: int | None = None

    def per_lumen(self, units: Float[np.ndarray, "n 3"], street_deg: float) -> Float[np.ndarray, " n"]:
        """Mean light by one lumen of each lamp along each of ``units``, in the frame of a lens.

        A direction meets the road at one place, and with equal poles the field: there light of E lx has q E cd/m^2.
        """
        road = self.readings.road
        rows = self.readings.rows[self.seen or 0]
        high = road.pole_height_m
        turn = np.radians(street_deg)
        tilt = np.radians(road.tilt_deg)
        street, aside = (units[:, :2] @ np.array([(np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))])).T
        down = np.maximum(np.cos(tilt) * units[:, 2] - np.sin(tilt) * street, _LEVEL)
        along = high * aside / down
        across = high * (np.sin(tilt) * units[:, 2] + np.cos(tilt) * street) / down
        half = 0.5 * (rows[1] - rows[0])
        lumens = np.zeros(len(units))
        low, top = (0.0, road.width_m) if self.seen is None else (rows[0] - half, rows[-1] + half)
        for start, beside, facing in rows_of_lamps(road):
            y = beside + facing * across
            on = (y >= low) & (y <= top) & (np.abs(along) <= _MOST_HEIGHTS * high)
            lumens[on] += self._q(
                (start + facing * along[on]) % road.pole_spacing_m, y[on], -facing * along[on], beside
            )
        return road.maintenance_factor / (road.pole_spacing_m * (top - low)) * lumens

    def _q(self, x: Points, y: Points, along: Points, beside: float) -> Points:
        """Light of places by one lux of a lamp at a distance ``along``, the places at ``beside`` across the road."""
        road = self.readings.road
        across = beside - y
        tan_gamma = np.hypot(along, across) / road.pole_height_m
        if self.seen is None:
            return 1.0 * (tan_gamma <= AROUND)
        view, *_ = self.readings.seen[self.seen]
        r = reduced_luminance(view, self.readings.surface, x, y, along, across, road.by_rp8)
        return np.asarray(r * (1.0 + tan_gamma**2) ** 1.5)


def requirements_of(readings: RoadReadings) -> Iterator[IntensityLimit]:
    """All requirements of a road's class, for every observer; the road's own figures override those of the class.

    The maintenance factor is in the light, except for glare, which is that of new lamps.
    """
    if readings.road.by_rp8:
        yield from _of_ratios(readings)
    elif readings.road.by_luminance:
        yield from _of_luminance(readings)
    else:
        yield from _of_illuminance(readings)
    wanted = readings.road.least_edge_ratio
    if wanted is not None:
        for side, edge in zip(("right", "left"), readings.edges, strict=True):
            yield IntensityLimit(f"{side} edge ratio", RatioOfTwo(), ">=", wanted, "", edge)


def _of_illuminance(readings: RoadReadings) -> Iterator[IntensityLimit]:
    name = readings.road.lighting_class
    light = readings.illuminance.times(readings.road.maintenance_factor)
    mean = light.mean()
    field = FieldMean(readings)
    if name in C_CLASSES:
        yield IntensityLimit("mean illuminance", PlaceLight(), ">=", C_CLASSES[name], "lx", mean, field)
        yield IntensityLimit("uniformity U0", LeastOverMean(), ">=", C_UNIFORMITY, "", light)
        return
    least_mean, least = P_CLASSES[name]
    yield IntensityLimit("mean illuminance", PlaceLight(), ">=", least_mean, "lx", mean, field)
    yield IntensityLimit("maximum mean illuminance", PlaceLight(), "<=", P_MOST * least_mean, "lx", mean)
    yield IntensityLimit("minimum illuminance", PlaceLight(), ">=", least, "lx", light, field)


def _of_luminance(readings: RoadReadings) -> Iterator[IntensityLimit]:
    road = readings.road
    wanted = M_CLASSES[readings.road.lighting_class]
    least = road.mean_cd_per_m2 or wanted.mean
    uniformity = road.uniformity or wanted.uniformity
    along = road.uniformity_along or wanted.along
    glare = road.glare_percent or wanted.glare_percent
    for lane, seen in enumerate(readings.luminance):
        of = f"lane {lane + 1}: "
        maintained = seen.times(road.maintenance_factor)
        mean = seen.mean()
        most = FieldMean(readings, lane)
        yield IntensityLimit(f"{of}mean luminance", PlaceLight(), ">=", least, "cd/m²", maintained.mean(), most)
        yield IntensityLimit(f"{of}uniformity U0", LeastOverMean(), ">=", uniformity, "", maintained)
        if readings.wet:
            even = road.wet_uniformity or WET_UNIFORMITY
            yield IntensityLimit(f"{of}uniformity U0, wet", LeastOverMean(), ">=", even, "", readings.wet[lane])
        yield IntensityLimit(
            f"{of}uniformity Ul", LeastOverMost(), ">=", along, "", maintained.places(readings.middle(lane))
        )
        yield from _per_lux(of, readings, lane)
        glaring = CandelaSum.joined((readings.veiling[lane], mean))
        yield IntensityLimit(f"{of}glare TI", THRESHOLD_INCREMENT, "<=", glare, "%", glaring)


def _of_ratios(readings: RoadReadings) -> Iterator[IntensityLimit]:
    road = readings.road
    wanted = RP8_CLASSES[readings.road.lighting_class]
    least = road.mean_cd_per_m2 or wanted.mean
    uneven = wanted.mean_over_least if road.uniformity is None else 1.0 / road.uniformity
    for number, (of, seen) in enumerate(zip(("", "oncoming: "), readings.luminance, strict=False)):
        mean = seen.mean()
        maintained = mean.times(road.maintenance_factor)
        yield IntensityLimit(
            f"{of}mean luminance", PlaceLight(), ">=", least, "cd/m²", maintained, FieldMean(readings, number)
        )
        yield IntensityLimit(f"{of}uniformity Lavg/Lmin", MeanOverLeast(), "<=", uneven, "", seen)
        yield IntensityLimit(f"{of}uniformity Lmax/Lmin", MostOverLeast(), "<=", wanted.largest_over_least, "", seen)
        yield from _per_lux(of, readings, number)
        glaring = CandelaSum.joined((readings.veiling[number], mean))
        yield IntensityLimit(f"{of}veiling ratio Lv/Lavg", VEILING_RATIO, "<=", wanted.veiling, "", glaring)


def _per_lux(of: str, readings: RoadReadings, number: int) -> Iterator[IntensityLimit]:
    wanted = readings.road.luminance_per_lux
    if wanted is not None:
        both = CandelaSum.joined((readings.luminance[number].mean(), readings.seen_lux[number]))
        yield IntensityLimit(f"{of}per lux Q", RatioOfTwo(), ">=", wanted, "cd/m²/lx", both)
