"""The ``[lens.fixed_inner]`` or ``[lens.fixed_outer]`` of a spec: a surface that the search does not change."""

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from lensforge.errors import InputError
from lensforge.spec.section import Coordinate, Millimetres, Section
from lensforge.surfaces.conic import Asphere

_MERIDIAN = np.linspace(0.0, 0.5 * np.pi, 2001)  # angles (rad) from the axis to the horizon


def _directions(polar_rad: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    return np.stack([np.sin(polar_rad), np.zeros_like(polar_rad), np.cos(polar_rad)], axis=1)


class _Fixed(Section):
    @property
    def surface(self) -> Asphere:
        """Surface about the axis. Raises :class:`InputError` where it is not star-shaped about the origin."""
        raise NotImplementedError

    @property
    def apex_mm(self) -> float:
        """Height of its vertex on the axis."""
        return self.surface.vertex_mm

    def on_meridian_mm(self, polar_rad: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Distance (mm) from the origin at angles from the axis; the surface is the same all around."""
        return self.surface.radius(_directions(polar_rad))

    @property
    def largest_mm(self) -> float:
        """Largest distance from the origin, z = 0 and above."""
        return float(self.on_meridian_mm(_MERIDIAN).max())

    def clearance_mm(self, height_mm: float, radius_mm: float) -> float:
        """Least height above the paraboloid of that height and radius, Eq. (12); below 0 where it cuts in."""
        points = self.on_meridian_mm(_MERIDIAN)[:, None] * _directions(_MERIDIAN)
        return float((height_mm / radius_mm**2 * points[:, 0] ** 2 + points[:, 2] - height_mm).min())

    def least_draft_deg(self, polar_rad: Float[np.ndarray, " k"]) -> float:
        """Least draft (deg) along the axis: 90 degrees less the angle from the axis to the normal."""
        radius, slope = self.on_meridian_mm(polar_rad), self._slope_mm(polar_rad)
        rise = radius * np.cos(polar_rad) + slope * np.sin(polar_rad)
        return float(np.rad2deg(np.arcsin(rise / np.hypot(radius, slope))).min())

    def curvatures_per_mm(self, polar_rad: Float[np.ndarray, " k"]) -> tuple[float, float]:
        """Least and largest principal curvature (1/mm), along and across the meridian; positive where it bulges."""
        radius, slope = self.on_meridian_mm(polar_rad), self._slope_mm(polar_rad)
        length = np.hypot(radius, slope)
        along = (radius**2 + 2.0 * slope**2 - radius * np.gradient(slope, polar_rad, edge_order=2)) / length**3
        off_axis = np.maximum(np.sin(polar_rad), 1e-9)
        across = (radius * np.sin(polar_rad) - slope * np.cos(polar_rad)) / (radius * off_axis * length)
        both = np.concatenate([along, across[1:]])  # on the axis the two are equal
        return float(both.min()), float(both.max())

    def _slope_mm(self, polar_rad: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Derivative of the radius by the polar angle (mm/rad)."""
        down = np.stack([np.cos(polar_rad), np.zeros_like(polar_rad), -np.sin(polar_rad)], axis=1)
        slope: Float[np.ndarray, " k"] = np.sum(self.surface.gradient(_directions(polar_rad)) * down, axis=1)
        return slope

    @model_validator(mode="after")
    def _is_star_shaped(self) -> "_Fixed":
        try:
            _ = self.surface
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class FixedSphere(_Fixed):
    """Sphere with its centre on the axis; the origin, where the source is, must lie inside."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Millimetres
    centre_z_mm: Coordinate = 0.0

    @property
    def surface(self) -> Asphere:
        """Surface about the axis."""
        return _asphere(self.centre_z_mm + self.radius_mm, -self.radius_mm, 0.0, ())


class FixedAsphere(_Fixed):
    """Even asphere by the sag of ISO 10110-12: ``radius_mm`` at the vertex, below 0 for a dome over the source.

    ``coefficients``: A_4, A_6, A_8, ... in mm^-3, mm^-5, mm^-7, ...
    """

    kind: Literal["asphere"] = "asphere"
    vertex_z_mm: Millimetres
    radius_mm: Coordinate
    conic_constant: Annotated[float, Field(ge=-1e3, le=1e3)] = 0.0
    coefficients: Annotated[tuple[Coordinate, ...], Field(max_length=10)] = ()

    @property
    def surface(self) -> Asphere:
        """Surface about the axis."""
        return _asphere(self.vertex_z_mm, self.radius_mm, self.conic_constant, self.coefficients)


_asphere = lru_cache(maxsize=16)(Asphere)  # a spec asks for its surfaces many times; their profile takes 0.1 s


FixedSurface = Annotated[FixedSphere | FixedAsphere, Field(discriminator="kind")]
