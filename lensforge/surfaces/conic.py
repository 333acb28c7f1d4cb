"""Fixed surfaces: a sphere with its centre on the axis, or an even asphere, as a radius over the sphere of directions.

The sag is that of ISO 10110-12, ``z(r) = z_v + r^2 / (R (1 + sqrt(1 - (1+k) r^2/R^2))) + A_4 r^4 + A_6 r^6 + ...``,
with R < 0 where the centre of curvature lies on the source's side, as in a dome. The sag ends at the equator of its
conic; its implicit form ``F = ((1+k) s^2 + r^2)/R - 2 s`` with ``s = z - z_v - A_4 r^4 - ...`` does not, so a sphere
is whole, and a rim may stand upright or be undercut. ``F`` is above 0 on the origin's side.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial

from lensforge.errors import InputError
from lensforge.surfaces.surface import Surface

# The profile is known down to this height of the direction, 30 degrees below the horizon. Directions further down
# get the radius of one above that height: the same surface for z >= 0, and a smooth continuation (7 derivatives) below,
# which splines need.
_LEAST_HEIGHT = -0.5
_SOFTNESS = 7
_PROFILE = 301  # directions, 0.4 degrees apart
_MOST_NEWTON_STEPS = 30
_LEAST_COSINE = 0.05  # between the normal and the ray from the origin
_WIDEST_DETAIL_RAD = 0.5


@dataclass(frozen=True)
class Asphere(Surface):
    """An even asphere about the axis: vertex at ``z_v`` (mm), R (mm), conic constant k, and A_4, A_6, ... (mm^-3, ...).

    Raises :class:`InputError` where it is not star-shaped about the origin down to 30 degrees below z = 0.
    """

    vertex_mm: float
    radius_mm: float
    conic: float = 0.0
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.vertex_mm > 0.0 or self.radius_mm == 0.0:
            raise InputError(
                f"vertex at {self.vertex_mm:g} mm, radius {self.radius_mm:g} mm: the vertex must lie above 0, "
                "the radius must not be 0"
            )
        _ = self._profile

    @property
    def detail_rad(self) -> float:
        """Sigma of a Gaussian with the profile's swing and largest curvature, ``2 swing / sigma^2``; 0.5 at most."""
        _, radii = self._profile
        step = np.arccos(_LEAST_HEIGHT) / (_PROFILE - 1)
        curvature = float(np.abs(np.diff(radii, 2)).max()) / step**2
        swing = float(np.ptp(radii))
        return min(_WIDEST_DETAIL_RAD, float(np.sqrt(2.0 * swing / curvature))) if swing > 1e-9 else _WIDEST_DETAIL_RAD

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm) at unit ``directions``, to rounding."""
        return self._at(_on_profile(directions[:, 2])[0])

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad), by implicit differentiation."""
        height, slope = _on_profile(directions[:, 2])
        _, by_radius, by_height = self._implicit(self._at(height), height)
        rising = np.array([0.0, 0.0, 1.0]) - directions[:, 2:] * directions
        gradient: Float[np.ndarray, "n 3"] = (-by_height / by_radius * slope)[:, None] * rising
        return gradient

    def sag(self, r_mm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """``z(r)`` (mm) by the formula of the standard; NaN beyond the equator of its conic."""
        with np.errstate(invalid="ignore"):
            root = np.sqrt(1.0 - (1.0 + self.conic) * r_mm**2 / self.radius_mm**2)
        z_mm: Float[np.ndarray, " n"] = (
            self.vertex_mm + r_mm**2 / (self.radius_mm * (1.0 + root)) + polynomial.polyval(r_mm**2, self._series)
        )
        return z_mm

    @cached_property
    def _series(self) -> Float[np.ndarray, " k"]:
        """Coefficients of the powers of r^2."""
        return np.array([0.0, 0.0, *self.coefficients])

    def _implicit(
        self, rho: Float[np.ndarray, "*n"], height: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """``F`` at distance ``rho`` in directions of the given ``height`` (their z), and its two derivatives."""
        squared = rho**2 * (1.0 - height**2)
        s = rho * height - self.vertex_mm - polynomial.polyval(squared, self._series)
        value = ((1.0 + self.conic) * s**2 + squared) / self.radius_mm - 2.0 * s
        by_s = 2.0 * (1.0 + self.conic) * s / self.radius_mm - 2.0
        by_squared = 1.0 / self.radius_mm - by_s * polynomial.polyval(squared, polynomial.polyder(self._series))
        by_radius = by_squared * 2.0 * rho * (1.0 - height**2) + by_s * height
        by_height = by_s * rho - by_squared * 2.0 * rho**2 * height
        return value, by_radius, by_height

    def _at(self, height: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """``rho`` by Newton steps from the profile, whose error is about 1e-5: the second reaches rounding."""
        heights, radii = self._profile
        rho: Float[np.ndarray, " n"] = np.interp(height, heights[::-1], radii[::-1])
        for _ in range(3):
            value, by_radius, _ = self._implicit(rho, height)
            rho = rho - value / by_radius
        return rho

    @cached_property
    def _profile(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Heights of directions, from the axis down, and the radius there: roots followed from the vertex."""
        heights = np.cos(np.linspace(0.0, np.arccos(_LEAST_HEIGHT), _PROFILE))
        radii = np.empty(_PROFILE)
        rho = self.vertex_mm
        for k, height in enumerate(heights):
            radii[k] = rho = self._follow(rho, height)
        return heights, radii

    def _follow(self, rho: float, height: float) -> float:
        """The root at ``height`` that continues ``rho``, the root at the height before."""
        root, at = np.array([rho]), np.array([height])
        for _ in range(_MOST_NEWTON_STEPS):
            with np.errstate(over="ignore", invalid="ignore"):  # a polynomial that overflows: the cosine is then NaN
                value, by_radius, by_height = self._implicit(root, at)
                cosine = -by_radius / np.hypot(by_radius, np.sqrt(1.0 - at**2) * by_height / root)
            if not (cosine > _LEAST_COSINE and root > 0.0):
                break
            change = value / by_radius
            root = root - change
            if abs(change) < 1e-12 * root:
                return float(root[0])
        raise self._not_star_shaped(height)

    def _not_star_shaped(self, height: float) -> InputError:
        polar = np.degrees(np.arccos(height))
        return InputError(
            f"the surface with vertex at {self.vertex_mm:g} mm and radius {self.radius_mm:g} mm is not star-shaped: "
            f"a ray from the origin, {polar:.1f} degrees from the axis, does not meet it just once; "
            "it must close around the source to 120 degrees (a dome has a negative radius)"
        )


def sphere(radius_mm: float, centre_mm: float = 0.0) -> Asphere:
    """A sphere with its centre on the axis at z = ``centre_mm``; the origin must be inside."""
    return Asphere(centre_mm + radius_mm, -radius_mm)


def _on_profile(height: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The height whose radius a direction gets, and its derivative: itself above z = 0, a soft minimum below."""
    below = np.maximum(-height, 0.0)
    bend = 1.0 + (below / -_LEAST_HEIGHT) ** _SOFTNESS
    return np.where(height >= 0.0, height, -below * bend ** (-1.0 / _SOFTNESS)), bend ** (-1.0 / _SOFTNESS - 1.0)
