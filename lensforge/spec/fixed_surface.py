"""The ``[lens.fixed_inner]`` or ``[lens.fixed_outer]`` of a spec: a surface that the search does not change."""

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from lensforge.errors import InputError
from lensforge.spec.fixed_base import FixedFace
from lensforge.spec.given_surface import FixedCadFace, FixedLensFace, FixedPoints, GivenSurface
from lensforge.spec.section import Coordinate, Millimetres
from lensforge.surfaces.conic import Asphere, Biconic, Toroid
from lensforge.surfaces.polynomial import XYPolynomial, zernike_terms
from lensforge.surfaces.surface import Surface

_Conic = Annotated[float, Field(ge=-1e3, le=1e3)]
_Series = Annotated[tuple[Coordinate, ...], Field(max_length=10)]
_Power = Annotated[int, Field(ge=0, le=30)]
_MOST_ZERNIKE = 231  # Noll's number: all of radial order 20


@lru_cache(maxsize=16)  # a spec asks for its surfaces many times; a profile takes 0.1 s
def _made(kind: Callable[..., Surface], *fields: object) -> Surface:
    return kind(*fields)


class _ByFormula(FixedFace):
    """A surface that a formula gives; it must be star-shaped about the origin."""

    @model_validator(mode="after")
    def _is_star_shaped(self) -> "_ByFormula":
        try:
            _ = self.surface
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class FixedSphere(_ByFormula):
    """Sphere with its centre on the axis; the origin, where the source is, must lie inside."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Millimetres
    """Radius."""
    centre_z_mm: Coordinate = 0.0
    """Height of the centre above z = 0; the origin must lie inside the sphere."""

    @property
    def surface(self) -> Surface:
        """Surface about the axis."""
        return _made(Asphere, self.centre_z_mm + self.radius_mm, -self.radius_mm)


class FixedAsphere(_ByFormula):
    """Even asphere by the sag of ISO 10110-12."""

    kind: Literal["asphere"] = "asphere"
    vertex_z_mm: Millimetres
    """Height of the vertex above z = 0."""
    radius_mm: Coordinate
    """Radius of curvature at the vertex, below 0 for a dome over the source."""
    conic_constant: _Conic = 0.0
    """Conic constant: 0 a sphere, -1 a paraboloid."""
    coefficients: _Series = ()
    """Coefficients A_4, A_6, A_8, ... in mm^-3, mm^-5, mm^-7, ..."""

    @property
    def surface(self) -> Surface:
        """Surface about the axis."""
        return _made(Asphere, self.vertex_z_mm, self.radius_mm, self.conic_constant, self.coefficients)


class FixedBiconic(_ByFormula):
    """Biconic (ISO 10110-12): radii and conic constants in the x-z and in the y-z plane; below 0 for a dome."""

    kind: Literal["biconic"] = "biconic"
    vertex_z_mm: Millimetres
    """Height of the vertex above z = 0."""
    radius_x_mm: Coordinate
    """Radius of curvature in the x-z plane."""
    radius_y_mm: Coordinate
    """Radius of curvature in the y-z plane."""
    conic_x: _Conic = 0.0
    """Conic constant in the x-z plane."""
    conic_y: _Conic = 0.0
    """Conic constant in the y-z plane."""

    @property
    def surface(self) -> Surface:
        """Surface with its vertex on the axis."""
        radii, conics = (self.radius_x_mm, self.radius_y_mm), (self.conic_x, self.conic_y)
        return _made(Biconic, self.vertex_z_mm, *radii, *conics)


class FixedToroid(_ByFormula):
    """Toroid (ISO 10110-12): an even asphere in y, turned about a line along y; both radii are below 0 for a dome."""

    kind: Literal["toroid"] = "toroid"
    vertex_z_mm: Millimetres
    """Height of the vertex above z = 0."""
    radius_mm: Coordinate
    """Radius of curvature of the profile in the y-z plane, at the vertex."""
    rotation_radius_mm: Coordinate
    """Distance of the line about which the profile turns from the vertex."""
    conic_constant: _Conic = 0.0
    """Conic constant of the profile."""
    coefficients: _Series = ()
    """Coefficients A_4, A_6, ... of the profile in mm^-3, mm^-5, ..."""

    @property
    def surface(self) -> Surface:
        """Surface with its vertex on the axis."""
        profile = self.radius_mm, self.rotation_radius_mm, self.conic_constant
        return _made(Toroid, self.vertex_z_mm, *profile, self.coefficients)


class FixedXYPolynomial(_ByFormula):
    """Conic with a polynomial added to its sag (ISO 10110-19)."""

    kind: Literal["xy_polynomial"] = "xy_polynomial"
    vertex_z_mm: Millimetres
    """Height of the vertex above z = 0."""
    radius_mm: Coordinate
    """Radius of curvature of the conic at its vertex, below 0 for a dome."""
    conic_constant: _Conic = 0.0
    """Conic constant."""
    normalisation_mm: Millimetres = 1.0
    """Length N by which x and y are divided; with 1, c is in mm^(1-i-j)."""
    terms: Annotated[tuple[tuple[_Power, _Power, Coordinate], ...], Field(max_length=500)] = ()
    """Terms [i, j, c] of c (mm) (x/N)^i (y/N)^j."""

    @property
    def surface(self) -> Surface:
        """Surface with the vertex of its conic on the axis."""
        conic = self.radius_mm, self.conic_constant
        return _made(XYPolynomial, self.vertex_z_mm, *conic, self.terms, self.normalisation_mm)


class FixedZernike(_ByFormula):
    """Conic with Zernike polynomials added to its sag.

    Normalised as Noll's (J. Opt. Soc. Am. 66, 207, 1976): each has an rms of 1 over the disc of
    ``normalisation_radius_mm``, beyond which the polynomials go on.
    """

    kind: Literal["zernike"] = "zernike"
    vertex_z_mm: Millimetres
    """Height of the vertex above z = 0."""
    radius_mm: Coordinate
    """Radius of curvature of the conic at its vertex, below 0 for a dome."""
    conic_constant: _Conic = 0.0
    """Conic constant."""
    normalisation_radius_mm: Millimetres
    """Radius of the disc of the polynomials."""
    coefficients_mm: dict[Annotated[int, Field(ge=1, le=_MOST_ZERNIKE)], Coordinate] = Field(default_factory=dict)
    """Coefficients by Noll's number (1 is piston, 4 defocus)."""

    @property
    def surface(self) -> Surface:
        """Surface with the vertex of its conic on the axis."""
        terms = zernike_terms(self.coefficients_mm)
        conic = self.radius_mm, self.conic_constant
        return _made(XYPolynomial, self.vertex_z_mm, *conic, terms, self.normalisation_radius_mm)


def _resolved(face: FixedFace) -> FixedFace:
    """The face itself in place of the file that holds it: a spec needs that file no more."""
    try:
        return face.resolved()
    except InputError as error:
        raise ValueError(str(error)) from None


FixedSurface = Annotated[
    FixedSphere
    | FixedAsphere
    | FixedBiconic
    | FixedToroid
    | FixedXYPolynomial
    | FixedZernike
    | FixedLensFace
    | FixedCadFace
    | FixedPoints
    | GivenSurface,
    Field(discriminator="kind"),
    AfterValidator(_resolved),
]
