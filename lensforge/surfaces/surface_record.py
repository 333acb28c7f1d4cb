"""Surfaces as records, in ``lens.json`` and in a spec that holds a given face."""

from dataclasses import fields
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field

from lensforge.errors import InputError
from lensforge.results import Number, Record
from lensforge.surfaces.asphere import Asphere, Biconic
from lensforge.surfaces.chart_spline import DEGREE, ChartSpline
from lensforge.surfaces.profile import LEAST_COEFFICIENTS, FormedFace, ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.srbf import MOST_FUNCTIONS, SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

Length = Annotated[Number, Field(ge=1e-6, le=1e9)]  # mm; the ranges of the spec, strict as in all records
Place = Annotated[Number, Field(ge=-1e9, le=1e9)]  # mm
_Conic = Annotated[Number, Field(ge=-1e3, le=1e3)]
_Series = Annotated[tuple[Place, ...], Field(max_length=10)]
MOST_KNOTS = 512


class SrbfFunctions(Record):
    """SRBFs of ``levels``, each with its weight."""

    levels: Annotated[tuple[Annotated[int, Field(strict=True, ge=1)], ...], Field(min_length=1)]
    sigma_c: Annotated[Number, Field(ge=1e-6, le=1e6)]
    symmetry: Literal["none", "mirror_x", "mirror_y", "diagonal", "rectangle", "square"]
    weights: Annotated[tuple[Place, ...], Field(max_length=MOST_FUNCTIONS)]


class SrbfRecord(Record):
    """A sum of spherical radial basis functions: those of ``levels``, each with its weight, on a sphere."""

    kind: Literal["srbf"] = "srbf"
    levels: Annotated[tuple[Annotated[int, Field(strict=True, ge=1)], ...], Field(min_length=1)]
    sigma_c: Annotated[Number, Field(ge=1e-6, le=1e6)]
    symmetry: Literal["none", "mirror_x", "mirror_y", "diagonal", "rectangle", "square"]
    offset_mm: Length
    weights_mm: Annotated[tuple[Place, ...], Field(max_length=MOST_FUNCTIONS)]

    def surface(self) -> SrbfSurface:
        """The surface. Raises :class:`InputError` where there are more or fewer weights than functions."""
        basis = SrbfBasis(self.levels, self.sigma_c, self.symmetry)
        return SrbfSurface(basis, np.array(self.weights_mm, dtype=np.float64), self.offset_mm)


class AsphereRecord(Record):
    """A fixed surface: a sphere or an even asphere."""

    kind: Literal["asphere"]
    vertex_mm: Length
    radius_mm: Place
    conic: _Conic
    coefficients: _Series

    def surface(self) -> Asphere:
        """The surface. Raises :class:`InputError` where it is not star-shaped about the origin."""
        return Asphere(self.vertex_mm, self.radius_mm, self.conic, self.coefficients)


class BiconicRecord(Record):
    """A fixed surface: a biconic."""

    kind: Literal["biconic"]
    vertex_mm: Length
    radius_x_mm: Place
    radius_y_mm: Place
    conic_x: _Conic
    conic_y: _Conic

    def surface(self) -> Biconic:
        """The surface. Raises :class:`InputError` where it is not star-shaped about the origin."""
        return Biconic(self.vertex_mm, self.radius_x_mm, self.radius_y_mm, self.conic_x, self.conic_y)


_Axis = tuple[Place, Place, Place]


class PlaneRecord(Record):
    """A given face: a plane."""

    kind: Literal["plane"]
    reach_mm: Length
    height_mm: Length
    axis: _Axis

    def surface(self) -> PlaneFace:
        """The surface. Raises :class:`InputError` where it is no plane above the origin."""
        return PlaneFace(self.reach_mm, self.height_mm, self.axis)


class ConeRecord(Record):
    """A given face: a cone about the axis."""

    kind: Literal["cone"]
    reach_mm: Length
    radius_mm: Length
    slope: Place

    def surface(self) -> ConeFace:
        """The surface. Raises :class:`InputError` where its tip is too near."""
        return ConeFace(self.reach_mm, self.radius_mm, self.slope)


class ConicRecord(Record):
    """A given face: a conic of revolution about a focus at the origin."""

    kind: Literal["conic"]
    reach_mm: Length
    parameter_mm: Length
    eccentricity: Annotated[Number, Field(ge=0.0, le=1e3)]
    axis: _Axis

    def surface(self) -> ConicFace:
        """The surface. Raises :class:`InputError` where it is nowhere within its reach."""
        return ConicFace(self.reach_mm, self.parameter_mm, self.eccentricity, self.axis)


_Cosine = Annotated[Number, Field(ge=-1.0, le=1.0)]
_Reciprocals = Annotated[tuple[Place, ...], Field(min_length=LEAST_COEFFICIENTS, max_length=MOST_KNOTS)]


class ProfileRecord(Record):
    """A face of revolution: its reciprocal radius (1/mm) as a spline of the cosine to the axis."""

    kind: Literal["profile"]
    reach_mm: Length
    low: _Cosine
    high: _Cosine
    coefficients: _Reciprocals

    def surface(self) -> ProfileFace:
        """The surface. Raises :class:`InputError` where ``low`` is not below ``high``, and where it is out of reach."""
        return ProfileFace(self.reach_mm, self.low, self.high, self.coefficients)


class FormedRecord(Record):
    """A profile, and the functions that are added to its reciprocal radius, each with its weight (1/mm)."""

    kind: Literal["formed"]
    profile: ProfileRecord
    functions: SrbfFunctions

    def surface(self) -> FormedFace:
        """The surface. Raises :class:`InputError` where there are more or fewer weights than functions."""
        own, sums = self.profile, self.functions
        basis, weights = SrbfBasis(sums.levels, sums.sigma_c, sums.symmetry), np.array(sums.weights, dtype=np.float64)
        return FormedFace(own.reach_mm, own.low, own.high, own.coefficients, basis, weights)


class ChartSplineRecord(Record):
    """A given face: its radius as a quintic spline over the stereographic chart, control values by rows of X."""

    kind: Literal["chart_spline"]
    knots: Annotated[tuple[Annotated[Number, Field(ge=-2.0, le=2.0)], ...], Field(max_length=MOST_KNOTS, repr=False)]
    control_mm: Annotated[tuple[Place, ...], Field(max_length=MOST_KNOTS**2, repr=False)]
    detail_rad: Annotated[Number, Field(ge=1e-3, le=1.0)]

    def surface(self) -> ChartSpline:
        """The surface. Raises :class:`InputError` where knots and control values are not those of one spline."""
        side, knots = len(self.knots) - DEGREE - 1, np.array(self.knots, dtype=np.float64)
        if side <= DEGREE or len(self.control_mm) != side**2 or not (np.diff(knots) >= 0.0).all():
            raise InputError(
                f"{len(self.knots)} knots and {len(self.control_mm)} control values: the knots must not fall, and the "
                f"values must be as many as the square of the knots less {DEGREE + 1}"
            )
        return ChartSpline(knots, np.array(self.control_mm, dtype=np.float64).reshape(side, side), self.detail_rad)


SurfaceRecord: TypeAlias = Annotated[
    SrbfRecord
    | AsphereRecord
    | BiconicRecord
    | ChartSplineRecord
    | PlaneRecord
    | ConeRecord
    | ConicRecord
    | ProfileRecord
    | FormedRecord,
    Field(discriminator="kind"),
]


def surface_record(surface: Surface) -> SurfaceRecord:
    """``surface`` as a record of ``lens.json``."""
    match surface:
        case SrbfSurface(basis=basis):
            return SrbfRecord(
                kind="srbf",
                levels=basis.levels,
                sigma_c=basis.sigma_c,
                symmetry=basis.symmetry,
                offset_mm=surface.offset_mm,
                weights_mm=tuple(surface.weights_mm.tolist()),
            )
        case Asphere():
            return AsphereRecord(kind="asphere", **_fields(surface))
        case Biconic():
            return BiconicRecord(kind="biconic", **_fields(surface))
        case PlaneFace():
            return PlaneRecord(kind="plane", **_fields(surface))
        case ConeFace():
            return ConeRecord(kind="cone", **_fields(surface))
        case ConicFace():
            return ConicRecord(kind="conic", **_fields(surface))
        case FormedFace(srbf=basis):
            weights = tuple(surface.weights_per_mm.tolist())
            own = {field.name: getattr(surface, field.name) for field in fields(ProfileFace)}
            functions = SrbfFunctions(
                levels=basis.levels, sigma_c=basis.sigma_c, symmetry=basis.symmetry, weights=weights
            )
            return FormedRecord(kind="formed", profile=ProfileRecord(kind="profile", **own), functions=functions)
        case ProfileFace():
            return ProfileRecord(kind="profile", **_fields(surface))
        case ChartSpline():
            knots, control = tuple(surface.knots.tolist()), tuple(surface.control.ravel().tolist())
            return ChartSplineRecord(kind="chart_spline", knots=knots, control_mm=control, detail_rad=surface.detail)
    raise TypeError(f"{type(surface).__name__} cannot be written to a lens file")


def _fields(surface: Asphere | Biconic | ReciprocalSurface) -> dict[str, Any]:
    """Fields of a surface by its equation; those of its record have the same names."""
    return {field.name: getattr(surface, field.name) for field in fields(surface)}
