"""A receiver as verification sees it: landings of exit rays, light by hard bins and its noise, the NMSE of images.

Written independently of the design's receivers: frames by rotation vectors, charts by angles.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import convolve1d
from scipy.spatial.transform import Rotation

from lensforge.errors import InputError
from lensforge.proof.obstacles import Obstacles

_AT_ONE_METRE = 1000.0  # mm: gaps between directions are given as they are there
_FLATTEST = 1e-3  # cosine of arrival: pixels seen edge on would allow any gap
_BEHIND = 1e-12  # of a plane's normal: a ray that rises less never reaches it

Triple = tuple[float, float, float]
_Rows = Float[np.ndarray, "n 3"]
_Places = Float[np.ndarray, "n 2"]
_Coordinates = Float[np.ndarray, "*n"]
_Vectors = Float[np.ndarray, "*n 3"]


class Reached(NamedTuple):
    """Places on a chart where rays land, NaN for none, the share of their flux that obstacles leave, and whether they
    meet a second one, where they end."""

    places: _Places
    onward: Float[np.ndarray, " n"]
    again: Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class Screen(ABC):
    """A receiver of ``columns`` x ``rows`` pixels; images are indexed [y, x]. ``kinds``: class of each kind, by name.

    ``facing``: the direction of its normal or of its chart's centre, away from the lens; x and y follow from the lens's
    by the shortest turn, and another by ``rotation_deg`` about it. ``width``, ``height``: of its chart, mm, or 2
    sin(gamma / 2) for the far field. ``window``: width, height, and radius in which flux counts as detected; None: any.
    ``filter_variance`` (pixels^2) is that of the paper's 3 x 3 Gaussian filter; 0: none. At the edge of the receiver
    the filter repeats the outermost pixels. ``numbers``: further numbers that the spec states for this kind.
    ``period_mm``: of an endless lattice of lamps, whose light is that of one lamp with all landings moved into one
    period. ``obstacles``: opaque bodies before it.
    """

    centre_mm: Triple
    facing: Triple
    rotation_deg: float
    width: float
    height: float
    columns: int
    rows: int
    window: tuple[float | None, float | None, float | None]
    filter_variance: float = 1.0
    numbers: Mapping[str, float] = field(default_factory=dict)
    period_mm: tuple[float, float] | None = None
    obstacles: Obstacles | None = None

    kinds: ClassVar[dict[str, "type[Screen]"]] = {}
    kind: ClassVar[str]  # that of the receiver's section
    is_far: ClassVar[bool] = False  # its places are directions
    mm_per_unit: ClassVar[float] = 1.0  # millimetres of a unit of the chart

    def __init_subclass__(cls, kind: str) -> None:
        cls.kind = kind
        Screen.kinds[kind] = cls

    @staticmethod
    def square(distance_mm: float, side_mm: float, pixels: int, filter_variance: float = 1.0) -> "Screen":
        """A square of ``side_mm`` in the plane z = ``distance_mm``, centred on the axis."""
        whole = (side_mm, side_mm, None)
        axis = ((0.0, 0.0, distance_mm), (0.0, 0.0, 1.0))
        return PlaneScreen(*axis, 0.0, side_mm, side_mm, pixels, pixels, whole, filter_variance)

    @abstractmethod
    def _landed(self, away: _Rows, along: _Rows) -> _Places:
        """Places on the chart of rays from ``away`` (mm) in directions ``along``, in local axes; NaN for none."""

    def _surface(self, x: _Coordinates, y: _Coordinates) -> tuple[_Vectors, _Vectors]:
        """Points (mm) at places of the chart, and the normals there, in local axes."""
        raise NotImplementedError(f"{type(self).__name__}: directions have no surface")

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors x, y, z of the screen as rows."""
        z = np.array(self.facing) / np.linalg.norm(self.facing)
        about = np.cross([0.0, 0.0, 1.0], z)
        sine = np.linalg.norm(about)
        half_turn = np.array([0.0, np.pi, 0.0])
        tilt = np.arctan2(sine, z[2]) * about / sine if sine > 0.0 else half_turn * float(z[2] < 0.0)
        turn = Rotation.from_rotvec(np.radians(self.rotation_deg) * z) * Rotation.from_rotvec(tilt)
        return turn.apply(np.eye(3))

    def reach_mm(self, light: Float[np.ndarray, "rows columns"]) -> float:
        """Displacement (mm) on the screen per radian at the lens: rms over its ``light``; 1 m for directions.

        A ray from the lens origin that travels L mm and arrives at an angle a from the normal is displaced by L / cos
        a.
        """
        if self.is_far:
            return self.mm_per_unit
        rows, columns = light.shape
        x, y = np.meshgrid(
            self.width * ((np.arange(columns) + 0.5) / columns - 0.5),
            self.height * ((np.arange(rows) + 0.5) / rows - 0.5),
        )
        points, normals = self._surface(x, y)
        points = points @ self.axes + self.centre_mm
        normals = normals @ self.axes
        paths = np.linalg.norm(points, axis=-1)
        cosines = np.abs(np.sum(points * normals, axis=-1)) / paths
        reach = paths / np.maximum(cosines, _FLATTEST)
        return float(np.sqrt(np.sum(light * reach**2) / np.sum(light)))

    def land(self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Places on the chart where rays from ``points`` (mm) land; NaN for those that never reach the surface."""
        axes = self.axes
        with np.errstate(divide="ignore", invalid="ignore"):
            places = self._landed((points - self.centre_mm) @ axes.T, directions @ axes.T)
        return places if self.period_mm is None else places - self.period_mm * np.round(places / self.period_mm)

    def reached(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], numbers: Float[np.ndarray, "n d"]
    ) -> "Reached":
        """:meth:`land` behind obstacles; ``numbers``: two in [0, 1) of each ray for each that may reflect it."""
        reached = Reached(self.land(points, directions), np.ones(len(points)), np.zeros(len(points), dtype=bool))
        if self.obstacles is None:
            return reached
        for way in self.obstacles.ways(points, directions, numbers, self._paths_mm):
            stopped = way.met.triangles >= 0
            landings = self.land(way.points, way.directions)
            reached.places[way.rows] = np.where(stopped[:, None], np.nan, landings)
            reached.onward[way.rows] = way.share * np.where(way.last, 1.0, way.met.onward)
            reached.again[way.rows] = stopped & way.last
        return reached

    def _paths_mm(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        """Paths of rays to where they land; infinite for those that never do."""
        paths_mm = np.full(len(points), np.inf)
        landings = self.land(points, directions)
        lands = ~np.isnan(landings[:, 0])
        if not self.is_far and lands.any():
            places, _ = self._surface(*landings[lands].T)
            away = places @ self.axes + self.centre_mm - points[lands]
            paths_mm[lands] = np.sum(away * directions[lands], axis=1)
        return paths_mm

    def on_pixels(self, landings: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """True for landings on any pixel; False for NaN."""
        return (np.abs(landings) <= [0.5 * self.width, 0.5 * self.height]).all(axis=1)

    def in_window(self, landings: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """True for landings in the window; False for NaN."""
        width, height, radius = (np.inf if side is None else side for side in self.window)
        inside = (np.abs(landings) <= [0.5 * width, 0.5 * height]).all(axis=1)
        return np.asarray(inside & (np.hypot(landings[:, 0], landings[:, 1]) <= radius))

    def irradiance(
        self, landings: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Irradiance (W/m^2) or intensity (W/sr) of rays with ``flux`` (W) at ``landings``; NaN lands nowhere."""
        image: Float[np.ndarray, "rows columns"] = (
            _smoothing(self.rows, self.filter_variance)
            @ self._sums(landings, flux)
            @ _smoothing(self.columns, self.filter_variance).T
            / self.pixel_measure
        )
        return image

    def noise(
        self, landings: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Variance of :meth:`irradiance` if the n rays were drawn independently.

        Each pixel is a sum of n terms, most of them zero: ``n Var = sum f^2 - (sum f)^2 / n``, f the flux. Quasi-
        random rays are less noisy: for them this is an upper bound.
        """
        variance = self._sums(landings, flux**2) - self._sums(landings, flux) ** 2 / len(flux)
        down, across = (_smoothing(count, self.filter_variance) ** 2 for count in (self.rows, self.columns))
        filtered: Float[np.ndarray, "rows columns"] = down @ np.maximum(variance, 0.0) @ across.T
        return filtered / self.pixel_measure**2

    def against(
        self, landings: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], reference: Float[np.ndarray, "h w"]
    ) -> tuple[Float[np.ndarray, "rows columns"], float, float]:
        """:meth:`irradiance`, its NMSE against a ``reference``, and the NMSE that :meth:`noise` alone makes."""
        image = self.irradiance(landings, flux)
        variance = self.noise(landings, flux)
        return image, nmse(image, reference), float(variance.sum()) / squared_norm(reference)

    @property
    def pixel_measure(self) -> float:
        """Area of a pixel in m^2, or its solid angle in sr."""
        area = self.width / self.columns * (self.height / self.rows)
        return area if self.is_far else area * 1e-6

    def _sums(
        self, landings: Float[np.ndarray, "n 2"], values: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "rows columns"]:
        inside = self.on_pixels(landings)
        counts = np.array([self.columns, self.rows])
        index = np.floor((landings[inside] / [self.width, self.height] + 0.5) * counts).astype(np.int64)
        index = np.minimum(index, counts - 1)  # the far edge belongs to the last pixel
        sums = np.zeros((self.rows, self.columns))
        np.add.at(sums, (index[:, 1], index[:, 0]), values[inside])
        return sums


class PlaneScreen(Screen, kind="plane"):
    """A rectangle in a plane."""

    def _landed(self, away: _Rows, along: _Rows) -> _Places:
        reaches = (along[:, 2] > _BEHIND) & (away[:, 2] < 0.0)
        return np.where(reaches[:, None], away[:, :2] - away[:, 2:] / along[:, 2:] * along[:, :2], np.nan)

    def _surface(self, x: _Coordinates, y: _Coordinates) -> tuple[_Vectors, _Vectors]:
        zero = np.zeros_like(x)
        return np.stack([x, y, zero], axis=-1), np.stack([zero, zero, np.ones_like(x)], axis=-1)


class FarFieldScreen(Screen, kind="far_field"):
    """All directions, on the equal-area chart; lengths on it are those at 1 m."""

    is_far: ClassVar[bool] = True
    mm_per_unit: ClassVar[float] = _AT_ONE_METRE

    def _landed(self, away: _Rows, along: _Rows) -> _Places:
        return _equal_area(along)


class SphereScreen(Screen, kind="sphere"):
    """A sphere about its centre, on the equal-area chart."""

    def _landed(self, away: _Rows, along: _Rows) -> _Places:
        radius_mm = self.numbers["radius_mm"]
        ends = away + _out_of(away, along, radius_mm)[:, None] * along
        return np.asarray(radius_mm * _equal_area(ends))

    def _surface(self, x: _Coordinates, y: _Coordinates) -> tuple[_Vectors, _Vectors]:
        radius_mm = self.numbers["radius_mm"]
        radius = np.maximum(np.hypot(x, y) / radius_mm, np.finfo(float).tiny)
        angle = 2.0 * np.arcsin(np.minimum(0.5 * radius, 1.0))
        across = np.sin(angle) / radius / radius_mm
        normals = np.stack([across * x, across * y, np.cos(angle)], axis=-1)
        return radius_mm * normals, normals


class CylinderScreen(Screen, kind="cylinder"):
    """A cylinder about its own y axis, unrolled."""

    def _landed(self, away: _Rows, along: _Rows) -> _Places:
        radius_mm = self.numbers["radius_mm"]
        flat = np.array([1.0, 0.0, 1.0])
        across = np.linalg.norm(along * flat, axis=1)
        steps = _out_of(away * flat, along * flat / across[:, None], radius_mm) / across
        ends = away + steps[:, None] * along
        return np.stack([radius_mm * np.arctan2(ends[:, 0], ends[:, 2]), ends[:, 1]], axis=1)

    def _surface(self, x: _Coordinates, y: _Coordinates) -> tuple[_Vectors, _Vectors]:
        radius_mm = self.numbers["radius_mm"]
        azimuth = x / radius_mm
        normals = np.stack([np.sin(azimuth), np.zeros_like(x), np.cos(azimuth)], axis=-1)
        return radius_mm * normals + y[..., None] * np.array([0.0, 1.0, 0.0]), normals


def _equal_area(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Lambert's azimuthal chart by the angle from the axis: a radius of 2 sin(angle / 2)."""
    across = np.hypot(vectors[:, 0], vectors[:, 1])
    radius = 2.0 * np.sin(0.5 * np.arctan2(across, vectors[:, 2]))
    chart: Float[np.ndarray, "n 2"] = vectors[:, :2] * (radius / np.where(across > 0.0, across, 1.0))[:, None]
    chart[(across == 0.0) & (vectors[:, 2] < 0.0)] = np.nan  # straight back: no place on the chart
    return chart


def _out_of(
    points: Float[np.ndarray, "n 3"], units: Float[np.ndarray, "n 3"], radius_mm: float
) -> Float[np.ndarray, " n"]:
    """Distances along lines from their closest approach to the origin to their exit from a sphere; NaN if outside."""
    before = np.sum(points * units, axis=1)
    closest = np.linalg.norm(points - before[:, None] * units, axis=1)
    out: Float[np.ndarray, " n"] = np.sqrt(radius_mm**2 - closest**2) - before
    return np.where(out > 0.0, out, np.nan)


def _smoothing(count: int, variance: float) -> Float[np.ndarray, "n n"]:
    """Matrix of the filter along one axis of ``count`` pixels."""
    unit = np.eye(count)
    if variance == 0.0:
        return unit
    taps = np.exp(-0.5 * np.array([1.0, 0.0, 1.0]) / variance)
    return convolve1d(unit, taps / taps.sum(), axis=0, mode="nearest")


def squared_norm(reference: Float[np.ndarray, "h w"]) -> float:
    """Sum of squares of a ``reference`` image. Raises :class:`InputError` if it is dark or not finite."""
    total = float(np.sum(reference**2))
    if not 0.0 < total < np.inf:
        raise InputError(f"design irradiance: its sum of squares is {total:g}, must be above 0; do rays reach it?")
    return total


def nmse(image: Float[np.ndarray, "h w"], reference: Float[np.ndarray, "h w"]) -> float:
    """Normalised mean squared error, ``sum (image - reference)^2 / sum reference^2``; no scale is fitted."""
    return float(np.sum((image - reference) ** 2)) / squared_norm(reference)
