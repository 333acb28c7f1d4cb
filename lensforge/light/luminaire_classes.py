"""Classes of a lamp that shines down on a road: its distribution type, and its BUG rating, by ANSI/IES.

The lateral angle is 0 towards the street, 90 and 270 degrees along it, 180 towards the house; gamma = 0 is straight
down: the frame of ANSI/IES TM-15 and of the distribution types.

The distribution type (ANSI/IES RP-8) is how far the light reaches, in mounting heights. Along the road: where the
largest intensity points. Across it: how far the line of half the largest intensity reaches towards the street, within
the range along the road that the first names. Type V is the same all around: here the reach of that line varies by less
than from 2/3 to 1 over all lateral angles, which lets a square count as symmetric.

The BUG rating is of backlight, uplight and glare, by the lumens of zones: ANSI/IES TM-15-11, luminaire classification
system; ratings: its addendum A. A rating is that of its worst zone. Zones are sums over rays: a table of intensity is a
step of its angles wide at an edge of the light.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal, get_args

import numpy as np
from jaxtyping import Float

from lensforge.light.angular_grid import AngularGrid
from lensforge.results import Count, Metric, NotNegative, Record
from lensforge.results.estimates import jackknife_metric, with_error
from lensforge.results.figure import Apart, Figure
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.mirror_group import group

Degrees = Float[np.ndarray, " k"]


@dataclass(frozen=True)
class LampLight:
    """Intensities (cd) of a whole lamp at the nodes of ``grid``, by independent ``samples`` of the rays.

    ``street_deg``: azimuth of the street, in the frame of the grid.
    """

    grid: AngularGrid
    samples: Float[np.ndarray, "p c g"]
    street_deg: float

    def times(self, count: int) -> "LampLight":
        """Light of ``count`` lamps."""
        return replace(self, samples=count * self.samples)

    def in_file(self) -> "LampLight":
        """Light of the table in the files, without values below 0; then with each sample left out in turn.

        For a single sample only the table.
        """
        total = self.samples.sum(axis=0)
        count = len(self.samples)
        left_out = [(total - sample) / (count - 1) for sample in self.samples] if count > 1 else []
        tables = [self.grid.table(candela).values[:-1] for candela in (total / count, *left_out) if candela.sum() > 0.0]
        return replace(self, samples=np.stack(tables))

    def intensities(self, lateral_deg: Degrees, gamma_deg: Degrees) -> Float[np.ndarray, "p k"]:
        """Intensity (cd) in each direction, by each sample."""
        matrix = self.grid.readings(lateral_deg + self.street_deg, gamma_deg)
        return (matrix @ self.samples.reshape(len(self.samples), -1).T).T


Lateral = Literal["I", "II", "III", "IV", "V"]
Longitudinal = Literal["very short", "short", "medium", "long", "very long"]
_ENDS_ALONG = (1.0, 2.25, 3.75, 6.0, np.inf)  # mounting heights at which the light of each ends, along the road
_ACROSS: tuple[tuple[Lateral, float], ...] = (("I", 1.0), ("II", 1.75), ("III", 2.75), ("IV", np.inf))
_HALF = 0.5
_ROUND = 2.0 / 3.0  # least over largest reach of the line: a square has 0.71, an ellipse of 2:1 half
_LATERAL_STEPS = 360
_GAMMA_STEP = 0.1  # a hundredth of a mounting height at 65 degrees
_LAST_DEG = 89.0


class DistributionType(Record):
    """Type of the distribution, such as III medium.

    Reaches in mounting heights: ``along_mh`` of the largest intensity, ``street_mh`` and ``house_mh`` of the line of
    half of it. ``roundness``: least over largest reach of that line.
    """

    lateral: Lateral
    longitudinal: Longitudinal
    along_mh: NotNegative
    street_mh: Annotated[
        Metric, Figure("Half-peak line reaches", "mounting heights towards the street", key="street_mh")
    ]
    house_mh: Metric
    roundness: Metric

    @property
    def name(self) -> str:
        """The type without that word."""
        return f"{self.lateral} {self.longitudinal}"

    def __str__(self) -> str:
        return f"type {self.name}"


@dataclass(frozen=True)
class _RoadGrid:
    """Directions below the horizon, and where they meet the road: along and across, in mounting heights."""

    lateral_deg: Degrees
    gamma_deg: Degrees
    along: Degrees
    across: Degrees

    @staticmethod
    def fine() -> "_RoadGrid":
        turns = np.arange(_LATERAL_STEPS) * (360.0 / _LATERAL_STEPS)
        gammas = np.arange(0.0, _LAST_DEG, _GAMMA_STEP)
        lateral, gamma = (angles.ravel() for angles in np.meshgrid(turns, gammas, indexing="ij"))
        far = np.tan(np.deg2rad(gamma))
        return _RoadGrid(lateral, gamma, far * np.sin(np.deg2rad(lateral)), far * np.cos(np.deg2rad(lateral)))

    def reach(self, light: Degrees, low: float, high: float, side: float) -> float:
        """Farthest point towards ``side`` (1 the street, -1 the house) with half the light, in a range along."""
        in_range = (light >= _HALF * light.max()) & (np.abs(self.along) >= low) & (np.abs(self.along) <= high)
        return max(float((side * self.across[in_range]).max()), 0.0) if in_range.any() else 0.0

    def roundness(self, light: Degrees) -> float:
        """Ratio of the least to the largest reach of the line of half the light, over all lateral angles."""
        bright = (light >= _HALF * light.max()).reshape(_LATERAL_STEPS, -1)
        far = np.tan(np.deg2rad(self.gamma_deg)).reshape(_LATERAL_STEPS, -1)
        reaches = np.where(bright, far, 0.0).max(axis=1)
        return float(reaches.min() / reaches.max()) if reaches.max() > 0.0 else 0.0


def distribution_type(lamp: LampLight) -> DistributionType:
    """Type of the light of ``lamp``."""
    road = _RoadGrid.fine()
    samples = lamp.intensities(road.lateral_deg, road.gamma_deg)
    roundness = jackknife_metric(samples, road.roundness)
    everywhere = roundness.value >= _ROUND  # the largest intensity is then as large along the road
    along = np.hypot(road.along, road.across if everywhere else 0.0)
    farthest = float(along[samples.mean(axis=0).argmax()])
    place = int(np.searchsorted(_ENDS_ALONG, farthest, side="right"))
    low, high = (0.0 if place == 0 else _ENDS_ALONG[place - 1]), _ENDS_ALONG[place]
    street = _with_step(jackknife_metric(samples, lambda light: road.reach(light, low, high, 1.0)))
    house = _with_step(jackknife_metric(samples, lambda light: road.reach(light, low, high, -1.0)))
    return DistributionType(
        lateral="V" if everywhere else next(name for name, end in _ACROSS if street.value <= end),
        longitudinal=get_args(Longitudinal)[place],
        along_mh=farthest,
        street_mh=street,
        house_mh=house,
        roundness=roundness,
    )


def _with_step(reach: Metric) -> Metric:
    """A reach with half a step of gamma on the road added to its error."""
    return with_error(reach, 0.5 * np.deg2rad(_GAMMA_STEP) * (1.0 + reach.value**2))


_SIDES = ("forward", "back")
_HEIGHTS = ("low", "mid", "high", "very_high")
_GAMMA_DEG = (30.0, 60.0, 80.0)  # between these heights
# Most lumens of a zone for the ratings 0 to 4; more is rated 5.
_BACKLIGHT = {
    "back_high": (110.0, 500.0, 1000.0, 2500.0, 5000.0),
    "back_mid": (220.0, 1000.0, 2500.0, 5000.0, 8500.0),
    "back_low": (110.0, 500.0, 1000.0, 2500.0, 5000.0),
}
_UPLIGHT = dict.fromkeys(("up_high", "up_low"), (0.0, 10.0, 50.0, 500.0, 1000.0))
_GLARE = {
    "forward_very_high": (10.0, 100.0, 225.0, 500.0, 750.0),
    "back_very_high": (10.0, 100.0, 225.0, 500.0, 750.0),
    "forward_high": (660.0, 1800.0, 5000.0, 7500.0, 12000.0),
}
_BACK_HIGH_GLARE = {False: (110.0, 500.0, 1000.0, 2500.0, 5000.0), True: (660.0, 1800.0, 5000.0, 7500.0, 12000.0)}


class ZoneLumens(Record):
    """Lumens by zone: forward and back at gamma to 30, 60, 80 and 90 degrees, and up to 100 and 180 degrees."""

    forward_low: Annotated[Metric, Figure("forward, 0° to 30°")]
    forward_mid: Annotated[Metric, Figure("forward, 30° to 60°")]
    forward_high: Annotated[Metric, Figure("forward, 60° to 80°")]
    forward_very_high: Annotated[Metric, Figure("forward, 80° to 90°")]
    back_low: Annotated[Metric, Figure("back, 0° to 30°")]
    back_mid: Annotated[Metric, Figure("back, 30° to 60°")]
    back_high: Annotated[Metric, Figure("back, 60° to 80°")]
    back_very_high: Annotated[Metric, Figure("back, 80° to 90°")]
    up_low: Metric
    up_high: Metric

    @staticmethod
    def of(samples: Float[np.ndarray, "p 2 4"]) -> "ZoneLumens":
        """The mean of independent ``samples`` of :func:`zone_flux` (lm); a lens emits none above 90 degrees."""
        lumens = {
            f"{side}_{height}": jackknife_metric(samples[:, row, column], float, "lm")
            for row, side in enumerate(_SIDES)
            for column, height in enumerate(_HEIGHTS)
        }
        none = Metric(value=0.0, unit="lm", standard_error=0.0)
        return ZoneLumens(**lumens, up_low=none, up_high=none)


def zone_flux(rays: RayBundle, street_deg: float, symmetry: str) -> Float[np.ndarray, "2 4"]:
    """Flux of upward ``rays``, forward and back (rows) and by height, averaged over their mirror images.

    ``street_deg``: azimuth of the street.
    """
    height = np.digitize(-rays.directions[:, 2], -np.cos(np.deg2rad(_GAMMA_DEG)))
    street = np.array([np.cos(np.deg2rad(street_deg)), np.sin(np.deg2rad(street_deg))])
    total = np.zeros(8)
    for image in group(symmetry):
        back = rays.directions[:, :2] @ image[:2, :2].T @ street <= 0.0
        total += np.bincount(height + len(_HEIGHTS) * back, rays.flux, minlength=8)
    return total.reshape(2, 4) / len(group(symmetry))


class BugRating(Record):
    """Ratings from 0 to 5, and the lumens of the ``zones``."""

    backlight: Count
    uplight: Count
    glare: Count
    zones: Annotated[ZoneLumens, Apart()]

    def __str__(self) -> str:
        return f"B{self.backlight} U{self.uplight} G{self.glare}"

    @staticmethod
    def of(zones: ZoneLumens, *, symmetric: bool) -> "BugRating":
        """Rate ``zones``; ``symmetric``: of distribution type V, whose back light has the bounds of forward light."""
        backlight, uplight, glare = (
            max(sum(getattr(zones, name).value > most for most in bounds) for name, bounds in table.items())
            for table in (_BACKLIGHT, _UPLIGHT, {**_GLARE, "back_high": _BACK_HIGH_GLARE[symmetric]})
        )
        return BugRating(backlight=backlight, uplight=uplight, glare=glare, zones=zones)
