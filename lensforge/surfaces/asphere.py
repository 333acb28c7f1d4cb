"""Surfaces by an equation ``F(x, y, z) = 0`` as a radius over the sphere of directions, and figures of their shape.

``F`` is above 0 on the origin's side. Where a sag ends at the equator of its conic, such an equation goes on: a sphere
is whole, and a rim may stand upright or be undercut. The figures are extent, draft and curvature over the hemisphere.

The sag of an even asphere follows ISO 10110-12, ``z(r) = z_v + r^2 / (R (1 + sqrt(1 - (1+k) r^2/R^2))) + A_4 r^4 +
A_6 r^6 + ...``, with R < 0 where the centre of curvature lies on the source's side, as in a dome. Its equation is
``F = ((1+k) s^2 + r^2)/R - 2 s`` with ``s = z - z_v - A_4 r^4 - ...``.
"""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial
from pydantic import Field

from lensforge.errors import InputError
from lensforge.results import Number
from lensforge.surfaces.surface import Length, Place, Surface, recorded

# The surface is known down to this height of the direction, 30 degrees below the horizon. Directions further down
# get the radius of one above that height: the same surface for z >= 0, and a smooth continuation (7 derivatives) below,
# which splines need.
_LEAST_HEIGHT = -0.5
_SOFTNESS = 7
_PROFILE = 301  # directions along a meridian, 0.4 degrees apart
_MOST_NEWTON_STEPS = 30  # from one direction to the next
_NEWTON_STEPS = 4  # from the profile, where the error is 1e-3
_LEAST_COSINE = 0.05  # between the normal and the ray from the origin
_WIDEST_DETAIL_RAD = 0.5

_Values = Float[np.ndarray, " n"]
_Vectors = Float[np.ndarray, "n 3"]


@dataclass(frozen=True)
class ImplicitSurface(Surface):
    """A surface given by an implicit equation, its vertex on the axis at ``vertex_mm``.

    Raises :class:`InputError` if it is not star-shaped about the origin down to 30 degrees below z = 0.
    """

    meridians: ClassVar[int] = 96  # on which it is followed down from the vertex; 1 where all are the same

    vertex_mm: Length

    def __post_init__(self) -> None:
        _ = self._profile

    @property
    def apex_mm(self) -> float:
        """Approximate height at which the surface meets the axis: the root from which the profile is followed."""
        return self.vertex_mm

    @abstractmethod
    def equation(self, points_mm: _Vectors) -> tuple[_Values, _Vectors]:
        """``F`` and its gradient at points; the surface chooses the unit of ``F``."""

    @property
    def detail_rad(self) -> float:
        """Sigma of a Gaussian with the profile's range and largest curvature, ``2 range / sigma^2``; 0.5 at most."""
        _, radii = self._profile
        step = np.arccos(_LEAST_HEIGHT) / (_PROFILE - 1)
        curvature = float(np.abs(np.diff(radii, 2, axis=0)).max()) / step**2
        swing = float(np.ptp(radii))
        return min(_WIDEST_DETAIL_RAD, float(np.sqrt(2.0 * swing / curvature))) if swing > 1e-9 else _WIDEST_DETAIL_RAD

    def radius(self, directions: _Vectors) -> _Values:
        """``rho`` (mm) at unit ``directions``, to rounding."""
        return self._at(_raised(directions)[0])

    def gradient(self, directions: _Vectors) -> _Vectors:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad), by implicit differentiation."""
        raised, along_meridian, around = _raised(directions)
        rho = self._at(raised)
        _, slope = self.equation(rho[:, None] * raised)
        by_radius = np.sum(slope * raised, axis=1)
        tangential = -(rho / by_radius)[:, None] * (slope - by_radius[:, None] * raised)
        down, across = _tangents(directions)
        own_down, _ = _tangents(raised)
        by_polar = np.sum(tangential * own_down, axis=1) * along_meridian
        return by_polar[:, None] * down + (np.sum(tangential * across, axis=1) * around)[:, None] * across

    def _at(self, directions: _Vectors) -> _Values:
        rho = self._on_profile(directions)
        for _ in range(_NEWTON_STEPS):
            value, slope = self.equation(rho[:, None] * directions)
            rho = rho - value / np.sum(slope * directions, axis=1)
        return rho

    def _on_profile(self, directions: _Vectors) -> _Values:
        """``rho`` between the points of the profile, linear in both angles."""
        polar, radii = self._profile
        place = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2]) / (polar[1] - polar[0])
        row = np.clip(place.astype(int), 0, len(polar) - 2)
        low = radii[row]
        high = radii[row + 1]
        along = low + (place - row)[:, None] * (high - low)  # a column for each meridian
        turn = np.arctan2(directions[:, 1], directions[:, 0]) / (2.0 * np.pi) % 1.0 * self.meridians
        first = turn.astype(int) % self.meridians
        rows = np.arange(len(directions))
        nearest = along[rows, first]
        next_one = along[rows, (first + 1) % self.meridians]
        return nearest + (turn - np.floor(turn)) * (next_one - nearest)

    @cached_property
    def _profile(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k m"]]:
        """Polar angles, from the axis down, and the radius there on each meridian, root by root from the vertex."""
        return _kept_profile(self)

    def _new_profile(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k m"]]:
        polar = np.linspace(0.0, np.arccos(_LEAST_HEIGHT), _PROFILE)
        azimuth = 2.0 * np.pi * np.arange(self.meridians) / self.meridians
        outwards = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
        radii = np.empty((_PROFILE, self.meridians))
        rho = np.full(self.meridians, self.apex_mm)
        with np.errstate(over="ignore", invalid="ignore"):  # a polynomial that overflows: the cosine is then NaN
            for k, angle in enumerate(polar):
                directions = np.sin(angle) * outwards + np.cos(angle) * np.array([0.0, 0.0, 1.0])
                radii[k] = rho = self._followed(rho, directions)
        return polar, radii

    def _followed(self, rho: _Values, directions: _Vectors) -> _Values:
        """Roots in ``directions`` that continue ``rho``, the roots in the neighbouring directions."""
        for _ in range(_MOST_NEWTON_STEPS):
            value, slope = self.equation(rho[:, None] * directions)
            by_radius = np.sum(slope * directions, axis=1)
            cosine = -by_radius / np.linalg.norm(slope, axis=1)
            wrong = ~((cosine > _LEAST_COSINE) & (rho > 0.0))
            if wrong.any():
                raise self._not_star_shaped(directions[wrong][0])
            change = value / by_radius
            rho = rho - change
            if (np.abs(change) < 1e-12 * rho).all():
                return rho
        raise self._not_star_shaped(directions[np.abs(change).argmax()])

    def _not_star_shaped(self, direction: Float[np.ndarray, "3"]) -> InputError:
        polar = np.degrees(np.arccos(direction[2]))
        where = f"{polar:.1f} degrees from the axis"
        if self.meridians > 1:
            where += f" at azimuth {np.degrees(np.arctan2(direction[1], direction[0])) % 360.0:.0f} degrees"
        return InputError(
            f"the surface with vertex at {self.vertex_mm:g} mm is not star-shaped: a ray from the origin, {where}, "
            "does not meet it just once; it must close around the source to 120 degrees (a dome has a negative radius)"
        )


@lru_cache(maxsize=64)  # the faces of a spec are made again whenever it is read
def _kept_profile(surface: ImplicitSurface) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k m"]]:
    return surface._new_profile()


def require_vertex(vertex_mm: float, *radii_mm: float) -> None:
    """Raise :class:`InputError` if the vertex is not above 0, or a radius is 0."""
    if not vertex_mm > 0.0 or 0.0 in radii_mm:
        given = ", ".join(f"{radius:g}" for radius in radii_mm)
        raise InputError(
            f"vertex at {vertex_mm:g} mm, radius {given} mm: the vertex must lie above 0, the radius must not be 0"
        )


def _raised(directions: _Vectors) -> tuple[_Vectors, _Values, _Values]:
    """Directions at which the surface is evaluated: below z = 0 raised by a soft minimum of the height.

    And the factors by which a step along the meridian (angle by angle) and around the axis is scaled there.
    """
    below = directions[:, 2] < 0.0
    moved = directions.copy()
    along = np.ones(len(directions))
    around = np.ones(len(directions))
    if below.any():
        height = -directions[below, 2]
        bend = 1.0 + (height / -_LEAST_HEIGHT) ** _SOFTNESS
        raised = -height * bend ** (-1.0 / _SOFTNESS)
        off_axis = np.maximum(np.hypot(directions[below, 0], directions[below, 1]), np.finfo(float).tiny)
        cosine = np.sqrt(1.0 - raised**2)
        along[below] = bend ** (-1.0 / _SOFTNESS - 1.0) * off_axis / cosine
        around[below] = cosine / off_axis
        moved[below] = np.column_stack([directions[below, :2] * around[below, None], raised])
    return moved, along, around


def _tangents(directions: _Vectors) -> tuple[_Vectors, _Vectors]:
    """Unit tangents of the sphere down its meridians and around the axis; on the axis those of azimuth 0."""
    x, y, z = directions.T
    off_axis = np.hypot(x, y)
    on_axis = off_axis == 0.0
    cosine = np.where(on_axis, 1.0, x / np.where(on_axis, 1.0, off_axis))
    sine = y / np.where(on_axis, 1.0, off_axis)
    return np.stack([z * cosine, z * sine, -off_axis], axis=1), np.stack([-sine, cosine, np.zeros_like(sine)], axis=1)


Conic = Annotated[Number, Field(ge=-1e3, le=1e3)]


@recorded("asphere", "A fixed surface: a sphere or an even asphere.")
@dataclass(frozen=True)
class Asphere(ImplicitSurface):
    """An even asphere about the axis: vertex at ``z_v`` (mm), R (mm), conic constant k, and A_4, A_6, ... (mm^-3, ...).

    Raises :class:`InputError` if it is not star-shaped about the origin down to 30 degrees below z = 0.
    """

    meridians: ClassVar[int] = 1

    radius_mm: Place
    conic: Conic = 0.0
    coefficients: Annotated[tuple[Place, ...], Field(max_length=10)] = ()

    def __post_init__(self) -> None:
        require_vertex(self.vertex_mm, self.radius_mm)
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square"

    @cached_property
    def _series(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " l"]]:
        """Coefficients of the powers of r^2, and of their derivative."""
        series = np.array([0.0, 0.0, *self.coefficients])
        return series, polynomial.polyder(series)

    def equation(self, points_mm: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """``F`` (mm) and its gradient."""
        x, y, z = points_mm.T
        squared = x * x + y * y
        s = z - self.vertex_mm
        if self.coefficients:
            s = s - polynomial.polyval(squared, self._series[0])
        by_s = 2.0 * (1.0 + self.conic) * s / self.radius_mm - 2.0
        by_squared: float | Float[np.ndarray, " n"] = 1.0 / self.radius_mm
        if self.coefficients:
            by_squared = by_squared - by_s * polynomial.polyval(squared, self._series[1])
        value = ((1.0 + self.conic) * s**2 + squared) / self.radius_mm - 2.0 * s
        return value, np.stack([2.0 * x * by_squared, 2.0 * y * by_squared, by_s], axis=1)


@recorded("biconic", "A fixed surface: a biconic.")
@dataclass(frozen=True)
class Biconic(ImplicitSurface):
    """Vertex at ``z_v`` (mm), radii (mm) and conic constants in the x-z and in the y-z plane (ISO 10110-12).

    ``z = z_v + B / (1 + sqrt(1 - A))``, ``B = x^2/R_x + y^2/R_y``, ``A = (1+k_x) x^2/R_x^2 + (1+k_y) y^2/R_y^2``, as
    the equation ``F = B + (A/B) s^2 - 2 s``. Raises :class:`InputError` for radii of opposite signs, and if it is not
    star-shaped.
    """

    radius_x_mm: Place
    radius_y_mm: Place
    conic_x: Conic = 0.0
    conic_y: Conic = 0.0

    def __post_init__(self) -> None:
        require_vertex(self.vertex_mm, self.radius_x_mm, self.radius_y_mm)
        if self.radius_x_mm * self.radius_y_mm < 0.0:
            raise InputError(
                f"radii {self.radius_x_mm:g} and {self.radius_y_mm:g} mm: must have one sign; give a saddle "
                "as a STEP file or as points"
            )
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "rectangle"

    def equation(self, points_mm: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """``F`` (mm) and its gradient."""
        s = points_mm[:, 2] - self.vertex_mm
        squares = points_mm[:, :2] ** 2
        radii = np.array([self.radius_x_mm, self.radius_y_mm])
        conics = (1.0 + np.array([self.conic_x, self.conic_y])) / radii**2
        parabolic = squares @ (1.0 / radii)
        conic = squares @ conics
        off_axis = np.where(parabolic == 0.0, 1.0, parabolic)
        share = conic / off_axis  # A/B; on the axis, where s is 0, it has no effect
        by_squares = 1.0 / radii + (s**2 / off_axis)[:, None] * (conics - share[:, None] / radii)
        slope = np.column_stack([2.0 * points_mm[:, :2] * by_squares, 2.0 * share * s - 2.0])
        return parabolic + share * s**2 - 2.0 * s, slope


def sphere(radius_mm: float, centre_mm: float = 0.0) -> Asphere:
    """A sphere with its centre on the axis at z = ``centre_mm``; the origin must be inside."""
    return Asphere(centre_mm + radius_mm, -radius_mm)


# Directions from the axis to the horizon, and meridians.
_ROUND = (2001, 1)
_ANY = (361, 72)
_STEP = 1e-4  # rad, of the differences of normals: their error is its square, and rounding a part in 1e11


@dataclass(frozen=True)
class SurfaceShape:
    """A surface at ``polar_rad`` from the axis to the horizon, on meridians all around; on one for revolution."""

    surface: Surface

    @cached_property
    def polar_rad(self) -> Float[np.ndarray, " k"]:
        """Angles from the axis."""
        return np.linspace(0.0, 0.5 * np.pi, self._counts[0])

    @cached_property
    def radii_mm(self) -> Float[np.ndarray, "k m"]:
        """Distances from the origin, a column for each meridian."""
        return self.surface.radius(self._directions).reshape(self._counts)

    def least_mm(self, polar_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Least distance from the origin all around at each angle from the axis."""
        return np.interp(polar_rad, self.polar_rad, self.radii_mm.min(axis=1))

    def largest_mm(self, polar_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Largest distance from the origin all around at each angle from the axis."""
        return np.interp(polar_rad, self.polar_rad, self.radii_mm.max(axis=1))

    def clearance_mm(self, height_mm: float, radius_mm: float) -> float:
        """Least height above the paraboloid of that height and radius, Eq. (12); below 0 where it cuts in."""
        points = self.radii_mm.reshape(-1, 1) * self._directions
        squared = points[:, 0] ** 2 + points[:, 1] ** 2
        return float((height_mm / radius_mm**2 * squared + points[:, 2] - height_mm).min())

    @cached_property
    def least_draft_deg(self) -> float:
        """Least draft (deg) along the axis: 90 degrees less the angle from the axis to the normal."""
        return float(np.rad2deg(np.arcsin(self.surface.normal(self._directions)[:, 2].min())))

    @cached_property
    def curvatures_per_mm(self) -> tuple[float, float]:
        """Least and largest principal curvature (1/mm); positive where it bulges."""
        first, second = _tangent_axes(self._directions)
        moved = [self._moved(along) for along in (first, second)]
        metric, form = (
            [[np.sum(a[0] * b[part], axis=1) for b in moved] for a in moved]
            for part in (0, 1)  # derivatives of points with those of points, and with those of normals
        )
        area = metric[0][0] * metric[1][1] - metric[0][1] ** 2
        across = 0.5 * (form[0][1] + form[1][0])
        gauss = (form[0][0] * form[1][1] - across**2) / area
        mean = (form[0][0] * metric[1][1] - 2.0 * across * metric[0][1] + form[1][1] * metric[0][0]) / (2.0 * area)
        apart = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
        return float((mean - apart).min()), float((mean + apart).max())

    @cached_property
    def meridian_curvatures_per_mm(self) -> tuple[float, float]:
        """Least and largest curvature (1/mm) along the meridians alone; positive where they bulge."""
        x, y, z = self._directions.T
        across = np.hypot(x, y)
        known = across > 0.0
        far = np.maximum(across, np.finfo(float).tiny)
        down = np.stack([np.where(known, z * x / far, 1.0), np.where(known, z * y / far, 0.0), -across], axis=1)
        points, normals = self._moved(down)
        bent = np.sum(points * normals, axis=1) / np.sum(points**2, axis=1)
        return float(bent.min()), float(bent.max())

    def _moved(self, along: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Derivatives (per rad) of the points and of the normals."""
        ends = [np.cos(_STEP) * self._directions + sign * np.sin(_STEP) * along for sign in (1.0, -1.0)]
        points = [self.surface.radius(direction)[:, None] * direction for direction in ends]
        normals = [self.surface.normal(direction) for direction in ends]
        return (points[0] - points[1]) / (2.0 * _STEP), (normals[0] - normals[1]) / (2.0 * _STEP)

    @property
    def _counts(self) -> tuple[int, int]:
        surface = self.surface
        return _ROUND if isinstance(surface, ImplicitSurface) and surface.meridians == 1 else _ANY

    @cached_property
    def _directions(self) -> Float[np.ndarray, "n 3"]:
        azimuth = 2.0 * np.pi * np.arange(self._counts[1]) / self._counts[1]
        sine = np.sin(self.polar_rad)
        cosine = np.cos(self.polar_rad)
        across = [np.outer(sine, np.cos(azimuth)), np.outer(sine, np.sin(azimuth))]
        return np.stack([*across, np.outer(cosine, np.ones_like(azimuth))], axis=-1).reshape(-1, 3)


def _tangent_axes(directions: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Two perpendicular unit tangents of the sphere in each direction."""
    first = np.cross(directions, np.array([0.0, 1.0, 0.0]))
    short = np.linalg.norm(first, axis=1) < 0.1
    first[short] = np.cross(directions[short], np.array([1.0, 0.0, 0.0]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)
