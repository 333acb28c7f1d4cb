"""Field of a road and its observers, as sums over the intensities of its lamps: EN 13201-3, CIE 140, and RP-8.

Luminance, illuminance and the light that veils a driver's view are linear in the intensity of the lamps: each is a
matrix of weights on the intensities in some directions. These directions are the same for all lamps, which are equal.

Frame (m): x along the road as lane 1 is driven, y across it from its right edge to the left, z up. The field begins at
a lamp of the first row, at x = 0, and ends at the next; of staggered rows the first is at the driving side. A lamp's
street is across the road from the edge where it stands.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
from jaxtyping import Float

from lensforge.addons.road.road_section import RoadSection
from lensforge.addons.road.road_surface import RoadSurface
from lensforge.scene.intensity_limit import CandelaSum

Points = Float[np.ndarray, " k"]
_Places = Float[np.ndarray, "*_"]

# The field: points along, and of the illuminance across (EN 13201-3, 7.1.4 and 7.2.8).
_LEAST_ALONG = 10
_ACROSS_M = 1.5
_LEAST_ACROSS = 3
# Lamps that count, in heights: for luminance towards the eye, away from it and aside; for illuminance around a point.
_TOWARDS = 5.0
_AWAY = 12.0
_ASIDE = 5.0
AROUND = 5.0
# The eye of EN 13201-3: metres before the field and above the road. For glare it looks down, under the roof of a car.
BEFORE_M = 60.0
_EYE_M = 1.5
_VIEW_DOWN_DEG = 1.0
_FIRST = 2.75
_SEEN_M = 500.0
_LEAST_DEG = 0.1


def _veil(theta: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
    """Veiling luminance per lux at an eye of 23 years, by the angle (deg) from the line of sight: EN 13201-3, 8.5."""
    age = 23.0
    square = theta**2
    close = 10.0 / (square * theta) + 5.0 * (1.0 + (age / 62.5) ** 4) / square
    return np.where(theta < 1.5, close, 9.86 * (1.0 + (age / 66.4) ** 4) / square)


def _veil_of_2000(theta: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
    """Veiling luminance per lux by RP-8-00, by the angle (deg) from the line of sight."""
    return 10.0 / (theta**2 + 1.5 * theta)


def _veil_of_2014(theta: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
    """Veiling luminance per lux by RP-8-14 and later: a power of the angle (deg), steeper within 2 degrees."""
    return 10.0 / theta ** np.where(theta < 2.0, 2.3 - 0.7 * np.log10(theta), 2.0)


@dataclass(frozen=True)
class _Standard:
    """Points and eye of a standard: the largest step along (m), points across a lane, height of the eye (m).

    Lamps glare from ``_LEAST_DEG`` to ``most_deg`` from the line of sight, up to ``roof_deg`` above the horizon.
    """

    step_m: float
    across_of_lane: int
    eye_m: float
    roof_deg: float
    most_deg: float
    veil: Callable[[Float[np.ndarray, "*k"]], Float[np.ndarray, "*k"]]


_STANDARDS = {
    "EN 13201": _Standard(3.0, 3, _EYE_M, 20.0, 60.0, _veil),
    "RP-8-00": _Standard(5.0, 2, 1.45, 90.0, 90.0, _veil_of_2000),
    "RP-8-14": _Standard(5.0, 2, 1.45, 90.0, 90.0, _veil_of_2014),
}
_BEFORE_POINT_M = 83.07  # the eye of RP-8 before each point, from where it looks down on it by 1 degree


def rows_of_lamps(road: RoadSection) -> tuple[tuple[float, float, float], ...]:
    """Position of each row: the x of a lamp, its y, and +1 if its street is towards +y, else -1."""
    width = road.width_m
    over = road.overhang_m
    edges = right, left = (0.0, over, 1.0), (0.0, width - over, -1.0)
    (_, near_y, near), (_, far_y, far) = edges if road.driving_side == "right" else edges[::-1]
    return {
        "right": (right,),
        "left": (left,),
        "opposite": (right, left),
        "staggered": ((0.0, near_y, near), (0.5 * road.pole_spacing_m, far_y, far)),
        "median": ((0.0, far_y, far), (0.0, far_y - far * (road.median_m + 2.0 * over), near)),
    }[road.arrangement]


@dataclass(frozen=True, eq=False)
class _Lamps:
    """Lamps between two places along a road: ``x``, ``y``, and +1 if their street is towards +y, else -1."""

    road: RoadSection
    x: Points
    y: Points
    facing: Points

    @staticmethod
    def between(road: RoadSection, low_m: float, high_m: float) -> "_Lamps":
        """All lamps from ``low_m`` to ``high_m``."""
        spacing = road.pole_spacing_m
        lamps = [
            (x, np.full_like(x, y), np.full_like(x, facing))
            for start, y, facing in rows_of_lamps(road)
            for x in [start + spacing * np.arange(ceil((low_m - start) / spacing), (high_m - start) // spacing + 1)]
        ]
        return _Lamps(road, *(np.concatenate(columns) for columns in zip(*lamps, strict=True)))

    @property
    def foot_y(self) -> Points:
        """Place of each pole across the road: at its edge, below a lamp beside it, in the middle of a median."""
        road = self.road
        if road.arrangement == "median":
            aside = 0.5 * road.median_m
            return np.full_like(self.y, road.width_m + aside if road.driving_side == "right" else -aside)
        return self.y - self.facing * max(road.overhang_m, 0.0)

    def light(self, x: Points, y: Points, height_m: float, weights: Float[np.ndarray, "k l"]) -> CandelaSum:
        """Sum over the lamps of ``weights`` times the intensity towards each point at ``height_m``."""
        from scipy import sparse

        along = x[:, None] - self.x
        across = (y[:, None] - self.y) * self.facing
        along = along * self.facing
        down = self.road.pole_height_m - height_m
        tilt = np.radians(self.road.tilt_deg)
        street = np.cos(tilt) * across - np.sin(tilt) * down
        axial = np.sin(tilt) * across + np.cos(tilt) * down
        place, lamp = np.nonzero(weights)
        azimuth = np.degrees(np.arctan2(along, street))[place, lamp]
        gamma = np.degrees(np.arctan2(np.hypot(along, street), axial))[place, lamp]
        shape = (len(x), len(place))
        matrix = sparse.csr_array((weights[place, lamp], (place, np.arange(len(place)))), shape=shape)
        return CandelaSum(azimuth, gamma, matrix)


@dataclass(frozen=True, eq=False)
class RoadReadings:
    """All light of a road by new lamps, without the maintenance factor.

    Observers are one in each lane, from the driving side, and see three rows of points to a lane. By RP-8 there is one
    for each direction of travel, with two rows to a lane, and a separate eye for each point. ``rows``: y of the rows of
    each observer; ``seen``: the observers, and x and y of the points, row by row along the road.
    """

    road: RoadSection
    rows: tuple[np.ndarray, ...]
    surface: RoadSurface
    wet_surface: RoadSurface | None
    seen: tuple[tuple["DriverView", np.ndarray, np.ndarray], ...]

    @staticmethod
    def of(road: RoadSection) -> "RoadReadings":
        """Readings of ``road``, computed on demand. Raises :class:`InputError` for a file without a table."""
        wet = RoadSurface.of(road.wet_surface or "", road.wet_surface_file) if road.has_wet_surface else None
        (views, rows) = _views(road)
        along = steps_along(road)
        grids = ((coordinates.ravel() for coordinates in np.meshgrid(along, y)) for y in rows)
        seen = tuple((view, *points) for view, points in zip(views, grids, strict=True))
        return RoadReadings(road, rows, RoadSurface.of(road.surface, road.surface_file, road.surface_q0), wet, seen)

    @cached_property
    def luminance(self) -> tuple[CandelaSum, ...]:
        """Luminance (cd/m^2) of the points, for each observer."""
        return tuple(_luminance(view, self.surface, x, y, eye_per_point=self.road.by_rp8) for view, x, y in self.seen)

    @cached_property
    def wet(self) -> tuple[CandelaSum, ...]:
        """Luminance (cd/m^2) of the points of the wet surface, for each observer; empty without requirements on it."""
        surface = self.wet_surface
        return () if surface is None else tuple(_luminance(view, surface, x, y) for view, x, y in self.seen)

    @cached_property
    def veiling(self) -> tuple[CandelaSum, ...]:
        """Veiling luminance (cd/m^2) for each observer: on the way through the field, by RP-8 from each eye."""
        by_rp8 = self.road.by_rp8
        return tuple(_veiling_of_points(*view) if by_rp8 else _veiling_on_the_way(view[0]) for view in self.seen)

    @cached_property
    def seen_lux(self) -> tuple[CandelaSum, ...]:
        """Mean illuminance (lx) of each observer's points."""
        if not self.road.by_rp8:
            return (self.illuminance.mean(),) * len(self.rows)
        half = 0.5 * (self.rows[0][1] - self.rows[0][0])
        return tuple(_illuminance(self.road, y[0] - half, y[-1] + half).mean() for y in self.rows)

    @cached_property
    def illuminance(self) -> CandelaSum:
        """Illuminance (lx) at the points of its own field."""
        return _illuminance(self.road, 0.0, self.road.width_m)

    @cached_property
    def edges(self) -> tuple[CandelaSum, CandelaSum]:
        """Mean illuminance (lx) outside and inside the right edge, then the left."""
        width = self.road.width_m
        lane = self.road.lane_m
        strips = ((-lane, 0.0), (0.0, lane), (width, width + lane), (width - lane, width))
        out_right, in_right, out_left, in_left = (_illuminance(self.road, *ends).mean() for ends in strips)
        return CandelaSum.joined((out_right, in_right)), CandelaSum.joined((out_left, in_left))

    @property
    def along(self) -> int:
        """Number of points along the road."""
        return len(steps_along(self.road))

    def middle(self, lane: int) -> slice:
        """Points of the luminance on the middle line of a lane."""
        across = _STANDARDS[self.road.standard].across_of_lane
        first = (self.road.from_right(lane) * across + across // 2) * self.along
        return slice(first, first + self.along)


@dataclass(frozen=True)
class DriverView:
    """View of the driver in ``lane``, of which 0 is at the driving side: a pinhole camera that looks along the road.

    The eye is in the middle of the lane, 60 m before the field and 1.5 m above the road. Places in the picture are
    tangents, to the right and up from the horizon straight ahead: what is d ahead on the road lies 1.5 m/d below it.
    """

    road: RoadSection
    lane: int

    @property
    def oncoming(self) -> bool:
        """True for a driver in the opposite direction."""
        return self.lane >= self.road.lanes - self.road.oncoming_lanes

    @property
    def heading(self) -> float:
        """+1 along x; -1 for a driver in the opposite direction, for whom the field begins at its other end."""
        return -1.0 if self.oncoming else 1.0

    @property
    def y(self) -> float:
        """Place across the road."""
        return (self.road.from_right(self.lane) + 0.5) * self.road.lane_m

    def place(self, ahead: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """The x of places ``ahead`` of the beginning of the field, in this driver's direction."""
        return self.road.pole_spacing_m - ahead if self.oncoming else ahead

    def ahead(self, x: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """Distance of places along the road from the eye."""
        return BEFORE_M + (self.road.pole_spacing_m - x if self.oncoming else x)

    def seen(
        self, x: Float[np.ndarray, "*k"], y: Float[np.ndarray, "*k"], z: Float[np.ndarray, "*k"]
    ) -> Float[np.ndarray, "*k 2"]:
        """Places in the picture of points in the frame of the road, which lie ahead of the eye."""
        away = self.ahead(x)
        return np.stack([self.heading * (self.y - y) / away, (z - _EYE_M) / away], axis=-1)

    def luminance(self, x: Points, y: Points) -> CandelaSum:
        """Luminance of points of the road by new lamps; nearer than the field by the same table."""
        road = self.road
        return _luminance(self, RoadSurface.of(road.surface, road.surface_file, road.surface_q0), x, y)

    def lamps(self, near_m: float, far_m: float) -> tuple[Points, Points, Points]:
        """x and y of the lamps within two distances from the eye, and y of the feet of their poles."""
        ends = self.place(np.array([near_m, far_m]) - BEFORE_M)
        lamps = _Lamps.between(self.road, float(ends.min()), float(ends.max()))
        return lamps.x, lamps.y, lamps.foot_y


def steps_along(road: RoadSection) -> Points:
    """Positions of the points along the road."""
    count = max(_LEAST_ALONG, ceil(road.pole_spacing_m / _STANDARDS[road.standard].step_m - 1e-9))
    return (np.arange(count) + 0.5) * (road.pole_spacing_m / count)


def _views(road: RoadSection) -> tuple[list[DriverView], tuple[Points, ...]]:
    """Each observer, and y of the rows that it sees: all, or by RP-8 those in lanes of its direction."""
    count = _STANDARDS[road.standard].across_of_lane * road.lanes
    y = (np.arange(count) + 0.5) * (road.width_m / count)
    if not road.by_rp8:
        views = [DriverView(road, lane) for lane in range(road.lanes)]
        return views, (y,) * len(views)
    first_oncoming = road.lanes - road.oncoming_lanes
    groups = [group for group in (range(first_oncoming), range(first_oncoming, road.lanes)) if group]
    rows = y.reshape(road.lanes, -1)
    of_groups = tuple(rows[sorted(map(road.from_right, group))].ravel() for group in groups)
    return [DriverView(road, group[0]) for group in groups], of_groups


def lux_across(low_m: float, high_m: float) -> Points:
    """Positions of the points of illuminance between two places across the road."""
    count = max(_LEAST_ACROSS, ceil((high_m - low_m) / _ACROSS_M - 1e-9))
    return low_m + (np.arange(count) + 0.5) * ((high_m - low_m) / count)


def _luminance(
    view: DriverView, surface: RoadSurface, x: Points, y: Points, *, eye_per_point: bool = False
) -> CandelaSum:
    """Luminance of points of the road for an eye in the middle of a lane, 60 m before the field.

    ``eye_per_point``: for an eye on a line along the road through each point, at the distance of the table; lamps then
    count as far as the table goes.
    """
    high = view.road.pole_height_m
    last_tan = float(surface.tan_gamma[-1])
    ahead = (last_tan, last_tan) if eye_per_point else (_TOWARDS, _AWAY)
    before, after = ahead[::-1] if view.oncoming else ahead
    lamps = _Lamps.between(view.road, float(x.min()) - before * high, float(x.max()) + after * high)
    places = x[:, None], y[:, None], lamps.x - x[:, None], lamps.y - y[:, None]
    return lamps.light(x, y, 0.0, reduced_luminance(view, surface, *places, eye_per_point) / high**2)


def reduced_luminance(
    view: DriverView, surface: RoadSurface, x: _Places, y: _Places, along: _Places, across: _Places, eye_per_point: bool
) -> _Places:
    """Coefficient r of points for lamps at distances ``along`` and ``across``; 0 for a lamp beyond the limits."""
    high = view.road.pole_height_m
    heading = view.heading
    last_tan = float(surface.tan_gamma[-1])
    towards, away, beside = (last_tan, last_tan, last_tan) if eye_per_point else (_TOWARDS, _AWAY, _ASIDE)
    beyond = heading * along
    aside = heading * across
    sight = np.zeros_like(y) if eye_per_point else np.arctan2(heading * (y - view.y), view.ahead(x))
    beta = np.degrees(np.arccos(np.clip(np.cos(np.arctan2(aside, beyond) - sight), -1.0, 1.0)))
    tan_gamma = np.hypot(beyond, aside) / high
    beta = np.where(tan_gamma > 0.0, beta, 0.0)
    near = (beyond >= -towards * high) & (beyond <= away * high) & (np.abs(aside) <= beside * high)
    return near * surface.reading(beta, tan_gamma)


def _illuminance(road: RoadSection, low_m: float, high_m: float) -> CandelaSum:
    x, y = (coordinates.ravel() for coordinates in np.meshgrid(steps_along(road), lux_across(low_m, high_m)))
    height = road.pole_height_m
    reach = AROUND * road.pole_height_m
    lamps = _Lamps.between(road, -reach, road.pole_spacing_m + reach)
    away = np.hypot(lamps.x - x[:, None], lamps.y - y[:, None])
    return lamps.light(x, y, 0.0, (away <= reach) * height / (away**2 + height**2) ** 1.5)


def _veiling_on_the_way(view: DriverView) -> CandelaSum:
    """Veiling luminance for an eye moving over one field from where the first lamp appears under the roof."""
    along = steps_along(view.road)
    x = view.place(along - along[0] - _FIRST * max(view.road.pole_height_m - _EYE_M, 0.0))
    return _veiling(view, x, np.full_like(x, view.y))


def _veiling_of_points(view: DriverView, x: Points, y: Points) -> CandelaSum:
    return _veiling(view, x - view.heading * _BEFORE_POINT_M, y)


def _veiling(view: DriverView, x: Points, y: Points) -> CandelaSum:
    road = view.road
    standard = _STANDARDS[view.road.standard]
    back, far = (_SEEN_M, 0.0) if view.oncoming else (0.0, _SEEN_M)
    lamps = _Lamps.between(road, float(x.min()) - back, float(x.max()) + far)
    ahead = view.heading * (lamps.x - x[:, None])
    aside = lamps.y - y[:, None]
    up = road.pole_height_m - standard.eye_m
    level = np.hypot(ahead, aside)
    away = np.hypot(level, up)
    down = np.radians(_VIEW_DOWN_DEG)
    cosine = (np.cos(down) * ahead - np.sin(down) * up) / away
    theta = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    seen = (ahead > 0.0) & (ahead <= _SEEN_M) & (up <= np.tan(np.radians(standard.roof_deg)) * ahead)
    seen &= (theta >= _LEAST_DEG) & (theta <= standard.most_deg)
    veil = standard.veil(np.maximum(theta, _LEAST_DEG))
    return lamps.light(x, y, standard.eye_m, seen * veil * np.maximum(cosine, 0.0) / away**2)
