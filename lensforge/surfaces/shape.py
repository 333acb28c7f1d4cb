"""Shape of a surface over the hemisphere as figures: its extent, draft and curvature."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.surfaces.implicit import ImplicitSurface
from lensforge.surfaces.surface import Surface

_ROUND, _ANY = (2001, 1), (361, 72)  # directions from the axis to the horizon, and meridians
_STEP = 1e-4  # rad, of the differences of normals: their error is its square, and rounding a part in 1e11


@dataclass(frozen=True)
class SurfaceShape:
    """A surface at ``polar_rad`` from the axis to the horizon, on meridians all around; one where all are the same."""

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
        least: Float[np.ndarray, " n"] = np.interp(polar_rad, self.polar_rad, self.radii_mm.min(axis=1))
        return least

    def largest_mm(self, polar_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Largest distance from the origin all around at each angle from the axis."""
        largest: Float[np.ndarray, " n"] = np.interp(polar_rad, self.polar_rad, self.radii_mm.max(axis=1))
        return largest

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
        first, second = _tangents(self._directions)
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

    def _moved(self, along: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Derivatives (per rad) of the points and of the normals."""
        ends = [np.cos(_STEP) * self._directions + sign * np.sin(_STEP) * along for sign in (1.0, -1.0)]
        points = [self.surface.radius(each)[:, None] * each for each in ends]
        normals = [self.surface.normal(each) for each in ends]
        return (points[0] - points[1]) / (2.0 * _STEP), (normals[0] - normals[1]) / (2.0 * _STEP)

    @property
    def _counts(self) -> tuple[int, int]:
        surface = self.surface
        return _ROUND if isinstance(surface, ImplicitSurface) and surface.meridians == 1 else _ANY

    @cached_property
    def _directions(self) -> Float[np.ndarray, "n 3"]:
        azimuth = 2.0 * np.pi * np.arange(self._counts[1]) / self._counts[1]
        sine, cosine = np.sin(self.polar_rad), np.cos(self.polar_rad)
        across = [np.outer(sine, np.cos(azimuth)), np.outer(sine, np.sin(azimuth))]
        return np.stack([*across, np.outer(cosine, np.ones_like(azimuth))], axis=-1).reshape(-1, 3)


def _tangents(directions: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Two unit tangents of the sphere across each other; none of the directions lies along y to one side of x."""
    first = np.cross(directions, np.array([0.0, 1.0, 0.0]))
    short = np.linalg.norm(first, axis=1) < 0.1
    first[short] = np.cross(directions[short], np.array([1.0, 0.0, 0.0]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)
