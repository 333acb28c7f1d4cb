"""Classes of EN 13201-2:2015, and what each asks of the light of a road: tables 1, 2 and 4."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lensforge.results import Sense
from lensforge.scene.road_field import CandelaSum, RoadReadings

Quantity = Literal[
    "light", "relative", "min_over_mean", "min_over_max", "share", "beam_angle", "threshold_increment", "ratio"
]


@dataclass(frozen=True)
class LuminanceClass:
    """Least mean luminance (cd/m^2), uniformity U0 and Ul, largest threshold increment (%), least edge ratio R_EI."""

    mean: float
    uniformity: float
    along: float
    glare_percent: float
    edge_ratio: float


M_CLASSES = {
    "M1": LuminanceClass(2.0, 0.40, 0.70, 10.0, 0.35),
    "M2": LuminanceClass(1.5, 0.40, 0.70, 10.0, 0.35),
    "M3": LuminanceClass(1.0, 0.40, 0.60, 15.0, 0.30),
    "M4": LuminanceClass(0.75, 0.40, 0.60, 15.0, 0.30),
    "M5": LuminanceClass(0.50, 0.35, 0.40, 15.0, 0.30),
    "M6": LuminanceClass(0.30, 0.35, 0.40, 20.0, 0.30),
}
# Mean and least illuminance (lx); the mean of a P class may be at most 1.5 times what it asks for.
P_CLASSES = {
    "P1": (15.0, 3.0), "P2": (10.0, 2.0), "P3": (7.5, 1.5), "P4": (5.0, 1.0), "P5": (3.0, 0.6), "P6": (2.0, 0.4),
}  # fmt: skip
P_MOST = 1.5
# Mean illuminance (lx); the least must be 0.4 of the mean.
C_CLASSES = {"C0": 50.0, "C1": 30.0, "C2": 20.0, "C3": 15.0, "C4": 10.0, "C5": 7.5}
C_UNIFORMITY = 0.4


@dataclass(frozen=True, eq=False)
class Ask:
    """One figure that a class asks for: the ``quantity`` of ``light`` must be ``sense`` ``bound``, in ``unit``."""

    name: str
    quantity: Quantity
    sense: Sense
    bound: float
    unit: str
    light: CandelaSum


def asked_of(readings: RoadReadings) -> Iterator[Ask]:
    """All that the class of a road asks for, of every observer; the road's own figures come before those of the class.

    The maintenance factor is in the light, but for glare, which is that of new lamps.
    """
    if readings.road.by_luminance:
        yield from _of_luminance(readings)
        return
    name, light = readings.road.lighting_class, readings.illuminance.times(readings.road.maintenance_factor)
    mean = light.mean()
    if name in C_CLASSES:
        yield Ask("mean illuminance", "light", ">=", C_CLASSES[name], "lx", mean)
        yield Ask("uniformity U0", "min_over_mean", ">=", C_UNIFORMITY, "", light)
        return
    least_mean, least = P_CLASSES[name]
    yield Ask("mean illuminance", "light", ">=", least_mean, "lx", mean)
    yield Ask("largest mean illuminance", "light", "<=", P_MOST * least_mean, "lx", mean)
    yield Ask("least illuminance", "light", ">=", least, "lx", light)


def _of_luminance(readings: RoadReadings) -> Iterator[Ask]:
    road, wanted = readings.road, M_CLASSES[readings.road.lighting_class]
    least, uniformity = road.mean_cd_per_m2 or wanted.mean, road.uniformity or wanted.uniformity
    along, glare = road.uniformity_along or wanted.along, road.glare_percent or wanted.glare_percent
    for lane, (seen, veiling) in enumerate(zip(readings.luminance, readings.veiling, strict=True)):
        of = f"lane {lane + 1}: "
        kept, mean = seen.times(road.maintenance_factor), seen.mean()
        yield Ask(f"{of}mean luminance", "light", ">=", least, "cd/m²", kept.mean())
        yield Ask(f"{of}uniformity U0", "min_over_mean", ">=", uniformity, "", kept)
        yield Ask(f"{of}uniformity along Ul", "min_over_max", ">=", along, "", kept.places(readings.middle(lane)))
        glaring = CandelaSum.joined((veiling, mean))
        yield Ask(f"{of}threshold increment TI", "threshold_increment", "<=", glare, "%", glaring)
    for side, edge in zip(("right", "left"), readings.edges, strict=True):
        yield Ask(f"{side} edge ratio", "ratio", ">=", wanted.edge_ratio, "", edge)


_BY_POWER = ((5.0, 65.0, 0.8), (float("inf"), 95.0, 1.05))  # up to this mean luminance: factor and power


def glare_law(mean_cd_per_m2: float) -> tuple[float, float]:
    """Factor and power of the threshold increment (%), factor L_v / L^power, at a mean luminance: EN 13201-3, 8.5."""
    return next((factor, power) for most, factor, power in _BY_POWER if mean_cd_per_m2 <= most)
