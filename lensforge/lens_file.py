"""``lens.json``: how a lens is written, and how it is read again, also what version 0.1.0 wrote."""

from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from lensforge.records import Count, Number, Positive, Record, Text
from lensforge.surfaces.conic import Asphere
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

SCHEMA = "lensforge-lens-2"
EARLIER_FORMAT = "lensforge-lens-1"  # stated as "format"; the surfaces are written in the same way


class Units(Record):
    """Of every number in the file."""

    length: Literal["mm"]
    angle: Literal["rad"]


class SrbfRecord(Record):
    """A sum of spherical radial basis functions: those of ``levels``, each with its weight, on a sphere."""

    kind: Literal["srbf"] = "srbf"
    levels: Annotated[tuple[Annotated[int, Field(strict=True, ge=1, le=100_000)], ...], Field(min_length=1)]
    sigma_c: Positive
    symmetry: Literal["none", "mirror_x", "mirror_y", "rectangle", "square"]
    offset_mm: Positive
    weights_mm: tuple[Number, ...]

    def surface(self) -> SrbfSurface:
        """The surface; raises :class:`InputError` where the count of weights is not that of the functions."""
        basis = SrbfBasis(self.levels, self.sigma_c, self.symmetry)
        return SrbfSurface(basis, np.array(self.weights_mm, dtype=np.float64), self.offset_mm)


class AsphereRecord(Record):
    """A sphere or an even asphere that the search left alone."""

    kind: Literal["asphere"]
    vertex_mm: Number
    radius_mm: Number
    conic: Number
    coefficients: tuple[Number, ...]

    def surface(self) -> Asphere:
        """The surface; raises :class:`InputError` where it is not star-shaped about the origin."""
        return Asphere(self.vertex_mm, self.radius_mm, self.conic, self.coefficients)


SurfaceRecord: TypeAlias = Annotated[SrbfRecord | AsphereRecord, Field(discriminator="kind")]


class LensRecord(Record):
    """All of ``lens.json`` but the name of its schema; ``spec`` is validated where specs are."""

    version: Text
    seed: Count
    accuracy: Literal["draft", "standard", "reference"]
    units: Units
    inner: SurfaceRecord
    outer: SurfaceRecord
    spec: dict[str, object]


def record_of(surface: Surface) -> SrbfRecord | AsphereRecord:
    """How ``surface`` is written."""
    match surface:
        case SrbfSurface():
            basis = surface.basis
            return SrbfRecord.model_validate(
                {
                    "levels": basis.levels,
                    "sigma_c": basis.sigma_c,
                    "symmetry": basis.symmetry,
                    "offset_mm": surface.offset_mm,
                    "weights_mm": surface.weights.tolist(),
                }
            )
        case Asphere():
            return AsphereRecord(
                kind="asphere",
                vertex_mm=surface.vertex_mm,
                radius_mm=surface.radius_mm,
                conic=surface.conic,
                coefficients=surface.coefficients,
            )
    raise TypeError(f"{type(surface).__name__} has no place in a lens file")
