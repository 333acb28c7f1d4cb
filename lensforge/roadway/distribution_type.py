"""Distribution type of a lamp: how far its light reaches along the road and across it (ANSI/IES RP-8).

Both are read on the road, in mounting heights. Along it: where the largest intensity points. Across it: how far the
line of half the largest intensity reaches towards the street, within the range along the road that the first names.
Type V is the same all around: here the reach of that line varies by less than from 2/3 to 1 over all lateral angles,
which lets a square count as symmetric; its largest intensity points along the road as it does elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from lensforge.jackknife import jackknife_metric
from lensforge.records import Flag, Metric, NotNegative, Record
from lensforge.roadway.lamp_light import Degrees, LampLight

Lateral = Literal["I", "II", "III", "IV", "V"]
Longitudinal = Literal["very short", "short", "medium", "long", "very long"]
_ALONG: tuple[tuple[Longitudinal, float], ...] = (
    ("very short", 1.0), ("short", 2.25), ("medium", 3.75), ("long", 6.0), ("very long", np.inf),
)  # fmt: skip
_ACROSS: tuple[tuple[Lateral, float], ...] = (("I", 1.0), ("II", 1.75), ("III", 2.75), ("IV", np.inf))
_HALF = 0.5
_ROUND = 2.0 / 3.0  # least over largest reach of the line: a square has 0.71, an ellipse of 2:1 half
_LATERAL_STEPS, _GAMMA_STEP, _LAST_DEG = 360, 0.1, 89.0  # a hundredth of a mounting height at 65 degrees
_DOUBT = 2.0  # standard errors within which a type may be the next


class DistributionType(Record):
    """Type of the distribution, such as III medium.

    Reaches in mounting heights: ``along_mh`` of the largest intensity, ``street_mh`` and ``house_mh`` of the line of
    half of it. ``roundness``: least over largest reach of that line. ``certain``: two standard errors change neither
    type, and no direction that may be the brightest has another one along the road.
    """

    lateral: Lateral
    longitudinal: Longitudinal
    certain: Flag
    along_mh: NotNegative
    street_mh: Metric
    house_mh: Metric
    roundness: Metric

    def __str__(self) -> str:
        return f"type {self.lateral} {self.longitudinal}" + ("" if self.certain else " (uncertain)")


@dataclass(frozen=True)
class _RoadGrid:
    """Directions below the horizon, and where they meet the road: along and across, in mounting heights."""

    lateral_deg: Degrees
    gamma_deg: Degrees
    along: Degrees
    across: Degrees

    @staticmethod
    def fine() -> "_RoadGrid":
        turns, gammas = np.arange(_LATERAL_STEPS) * (360.0 / _LATERAL_STEPS), np.arange(0.0, _LAST_DEG, _GAMMA_STEP)
        lateral, gamma = (each.ravel() for each in np.meshgrid(turns, gammas, indexing="ij"))
        far = np.tan(np.deg2rad(gamma))
        return _RoadGrid(lateral, gamma, far * np.sin(np.deg2rad(lateral)), far * np.cos(np.deg2rad(lateral)))

    def reach(self, light: Degrees, low: float, high: float, side: float) -> float:
        """Farthest place towards ``side`` (1 the street, -1 the house) of half the light, within a range along."""
        there = (light >= _HALF * light.max()) & (np.abs(self.along) >= low) & (np.abs(self.along) <= high)
        return max(float((side * self.across[there]).max()), 0.0) if there.any() else 0.0

    def roundness(self, light: Degrees) -> float:
        """Least over largest reach of the line of half the light, over all lateral angles."""
        bright = (light >= _HALF * light.max()).reshape(_LATERAL_STEPS, -1)
        far = np.tan(np.deg2rad(self.gamma_deg)).reshape(_LATERAL_STEPS, -1)
        reaches = np.where(bright, far, 0.0).max(axis=1)
        return float(reaches.min() / reaches.max()) if reaches.max() > 0.0 else 0.0


def distribution_type(lamp: LampLight) -> DistributionType:
    """Type of the light of ``lamp``."""
    road = _RoadGrid.fine()
    samples = lamp.intensities(road.lateral_deg, road.gamma_deg)
    finer = None if lamp.finer is None else lamp.finer.intensities(road.lateral_deg, road.gamma_deg)[0]

    def figure(read: Callable[[Degrees], float]) -> Metric:
        found = jackknife_metric(samples, read)
        return found if finer is None else _with_error(found, read(finer) - found.value)

    roundness = figure(road.roundness)
    everywhere = roundness.value >= _ROUND  # the largest intensity is then as large along the road
    along = np.hypot(road.along, road.across if everywhere else 0.0)
    peaks = [int(samples.mean(axis=0).argmax()), *_brightest(samples), *([] if finer is None else [finer.argmax()])]
    place, *others = np.searchsorted([end for _, end in _ALONG], along[peaks], side="right").tolist()
    low, high = (0.0 if place == 0 else _ALONG[place - 1][1]), _ALONG[place][1]
    street = _with_step(figure(lambda light: road.reach(light, low, high, 1.0)))
    house = _with_step(figure(lambda light: road.reach(light, low, high, -1.0)))
    types = {_lateral(street, roundness, errors) for errors in (-_DOUBT, 0.0, _DOUBT)}
    return DistributionType(
        lateral=_lateral(street, roundness),
        longitudinal=_ALONG[place][0],
        certain=len(types) == 1 and set(others) <= {place},
        along_mh=float(along[peaks[0]]),
        street_mh=street,
        house_mh=house,
        roundness=roundness,
    )


def _brightest(samples: Float[np.ndarray, "p k"]) -> Int[np.ndarray, " c"]:
    """Directions that two standard errors do not tell from the brightest; none by a single sample."""
    below = samples[:, [samples.mean(axis=0).argmax()]] - samples
    if len(samples) < 2:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(below.mean(axis=0) <= _DOUBT * below.std(axis=0, ddof=1) / np.sqrt(len(samples)))


def _with_error(figure: Metric, more: float) -> Metric:
    """A figure with one more part of its error, added as a square."""
    if figure.standard_error is None:
        return figure
    return figure.model_copy(update={"standard_error": float(np.hypot(figure.standard_error, more))})


def _with_step(reach: Metric) -> Metric:
    """A reach whose error includes half a step of gamma on the road."""
    return _with_error(reach, 0.5 * np.deg2rad(_GAMMA_STEP) * (1.0 + reach.value**2))


def _lateral(street: Metric, roundness: Metric, errors: float = 0.0) -> Lateral:
    """Type across the road, both figures moved by so many standard ``errors``."""
    reach, even = (each.value + errors * (each.standard_error or 0.0) for each in (street, roundness))
    if even >= _ROUND:
        return "V"
    return next(name for name, end in _ACROSS if reach <= end)
