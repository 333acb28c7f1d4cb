"""A surface that the search leaves alone: a sphere or an even asphere about the axis."""

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from lensforge.errors import InputError
from lensforge.spec.section import Millimetres, Section
from lensforge.surfaces.conic import Asphere, sphere

_Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]


def _meridian() -> Float[np.ndarray, "n 3"]:
    """Directions from the axis to the horizon; a fixed surface is the same all around."""
    polar = np.linspace(0.0, 0.5 * np.pi, 2001)
    return np.stack([np.sin(polar), np.zeros_like(polar), np.cos(polar)], axis=1)


class _Fixed(Section):
    @property
    def surface(self) -> Asphere:
        """The surface; raises :class:`InputError` where it is not star-shaped about the origin."""
        raise NotImplementedError

    @property
    def apex_mm(self) -> float:
        """Where it meets the axis."""
        return self.surface.vertex_mm

    @property
    def largest_mm(self) -> float:
        """Its largest distance from the origin, z = 0 and above."""
        return float(self.surface.radius(_meridian()).max())

    def room_mm(self, height_mm: float, radius_mm: float) -> float:
        """By how much it clears the paraboloid of that height and radius, Eq. (12); below 0 where it cuts into it."""
        u = _meridian()
        points = self.surface.radius(u)[:, None] * u
        return float((height_mm / radius_mm**2 * points[:, 0] ** 2 + points[:, 2] - height_mm).min())

    @model_validator(mode="after")
    def _is_star_shaped(self) -> "_Fixed":
        try:
            _ = self.surface
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class FixedSphere(_Fixed):
    """A sphere with its centre on the axis; the origin, where the source is, must lie inside."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Millimetres
    centre_z_mm: _Coordinate = 0.0

    @property
    def surface(self) -> Asphere:
        """As a surface."""
        return sphere(self.radius_mm, self.centre_z_mm)


class FixedAsphere(_Fixed):
    """An even asphere by the sag of ISO 10110-12: ``radius_mm`` at the vertex, below 0 for a dome over the source.

    ``coefficients``: A_4, A_6, A_8, ... in mm^-3, mm^-5, mm^-7, ...
    """

    kind: Literal["asphere"] = "asphere"
    vertex_z_mm: Millimetres
    radius_mm: _Coordinate
    conic_constant: Annotated[float, Field(ge=-1e3, le=1e3)] = 0.0
    coefficients: Annotated[tuple[_Coordinate, ...], Field(max_length=10)] = ()

    @property
    def surface(self) -> Asphere:
        """As a surface."""
        return Asphere(self.vertex_z_mm, self.radius_mm, self.conic_constant, self.coefficients)


FixedSurface = Annotated[FixedSphere | FixedAsphere, Field(discriminator="kind")]
