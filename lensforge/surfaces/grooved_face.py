"""A face of two zones of revolution, a lens and a ring around it, which meet in a rounded groove.

Seen from the origin the farther zone is the face: both together are a union, where faces of a body are an intersection.
Around the groove 1/rho is blended by a polynomial with three continuous derivatives, over a band as wide as a groove of
a stated radius asks for; beyond the band each zone is exact.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.arrays import Array, module_of
from lensforge.results import Number
from lensforge.surfaces.profile import ProfileFace, ProfileRecord
from lensforge.surfaces.reciprocal import ReciprocalSurface
from lensforge.surfaces.surface import Length, SurfaceRecord, surface_record

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]

_BEND = 15.0 / 16.0  # second derivative of the blend in the middle of its band
_DETAIL = 1.6  # sigma over half of the band: tables of six nodes a sigma have four in it
_ACROSS = 401  # places in a band at which its curvature is asked
_SOUGHT = 2000  # cosines between which the groove is looked for


def blended(lens: Float[Array, " n"], ring: Float[Array, " n"], band: Float[Array, ""] | float) -> Float[Array, " n"]:
    """The lesser of two reciprocal radii (1/mm), blended where they differ by less than ``band``; differentiable.

    In NumPy or in torch.
    """
    x = module_of(lens).clip((lens - ring) / band, -1.0, 1.0)
    square = x**2
    rounded = (5.0 + square * (15.0 - square * (5.0 - square))) / 32.0 - 0.5 * abs(x)
    return module_of(lens).minimum(lens, ring) - band * rounded


def _lens_share(x: _Values) -> _Values:
    """Share of the slope of the lens at ``x`` in the band, from -1 to 1: the derivative of :func:`blended`."""
    return 0.5 - x * (15.0 - x**2 * (10.0 - 3.0 * x**2)) / 16.0


@dataclass(frozen=True)
class GroovedFace(ReciprocalSurface):
    """A ``lens`` about the axis and a ``ring`` around it; ``band_per_mm`` (1/mm): of 1/rho, in which they are blended.

    Raises :class:`InputError` for a band that is not above 0.
    """

    lens: ProfileFace
    ring: ProfileFace
    band_per_mm: float

    def __post_init__(self) -> None:
        if not 0.0 < self.band_per_mm < np.inf:
            raise InputError(f"grooved: band_per_mm = {self.band_per_mm:g}: must be above 0")
        super().__post_init__()

    @staticmethod
    def of(reach_mm: float, lens: ProfileFace, ring: ProfileFace, radius_mm: float) -> "GroovedFace":
        """The face whose groove has a meridian of ``radius_mm`` (mm) where it is tightest.

        Raises :class:`InputError` if they meet in none.
        """
        groove = Groove.of(lens, ring)
        if groove is None:
            raise InputError("grooved: lens and ring do not meet in a groove; move the ring out, or the lens up")
        x = np.linspace(-1.0, 1.0, _ACROSS)  # places in the band, from the lens to the ring
        share = _lens_share(x)
        slopes = share * groove.lens_slope + (1.0 - share) * groove.ring_slope
        stretch = (1.0 + (slopes / groove.value) ** 2) ** 1.5
        bands = _BEND * (1.0 - x**2) ** 2 * groove.turn**2 / (groove.value + stretch / radius_mm)
        return GroovedFace(reach_mm, lens, ring, float(bands.max()))

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square"

    @cached_property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature: of a zone, or of the groove."""
        groove = Groove.of(self.lens, self.ring)
        detail = super().detail_rad
        return detail if groove is None else min(detail, _DETAIL * self.band_per_mm / groove.turn)

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``1/rho``, that of the farther zone, and its gradient in space."""
        lens, lens_slope = self.lens.reciprocal(directions)
        ring, ring_slope = self.ring.reciprocal(directions)
        x = np.clip((lens - ring) / self.band_per_mm, -1.0, 1.0)
        lens_share = _lens_share(x)
        slope = lens_share[:, None] * lens_slope + (1.0 - lens_share)[:, None] * ring_slope
        return blended(lens, ring, self.band_per_mm), slope

    def value(self, directions: _Vectors) -> _Values:
        """``1/rho`` of the farther zone."""
        return blended(self.lens.value(directions), self.ring.value(directions), self.band_per_mm)


@dataclass(frozen=True)
class Groove:
    """Crossing of two zones, the first from the axis on: ``cosine`` to it, and ``value`` of ``1/rho`` (1/mm).

    ``lens_slope``, ``ring_slope``: of 1/rho by the angle from the axis, on either side of it.
    """

    cosine: float
    value: float
    lens_slope: float
    ring_slope: float

    @property
    def turn(self) -> float:
        """Difference of the slopes."""
        return abs(self.lens_slope - self.ring_slope)

    @staticmethod
    def of(lens: ProfileFace, ring: ProfileFace) -> "Groove | None":
        """The groove of a lens within a ring; None if the lens is nowhere the farther zone, or everywhere."""
        cosines = np.linspace(1.0, 0.0, _SOUGHT)
        ahead = ring.value(_towards(cosines)) - lens.value(_towards(cosines))
        if not (ahead[0] > 0.0 and ahead.min() < 0.0):
            return None
        first = int(np.argmax(ahead < 0.0))
        share = ahead[first - 1] / (ahead[first - 1] - ahead[first])
        cosine = float(cosines[first - 1] + share * (cosines[first] - cosines[first - 1]))
        at = _towards(np.array([cosine]))
        lens_slope, ring_slope = (float(-at[0, 0] * zone.reciprocal(at)[1][0, 2]) for zone in (lens, ring))
        return Groove(cosine, float(lens.value(at)[0]), lens_slope, ring_slope)


def _towards(cosines: _Values) -> _Vectors:
    return np.column_stack([np.sqrt(1.0 - cosines**2), np.zeros_like(cosines), cosines])


class GroovedRecord(SurfaceRecord):
    """A lens about the axis and a ring around it, which meet in a groove; `band_per_mm` rounds it."""

    kind: Literal["grooved"]
    reach_mm: Length
    lens: ProfileRecord
    ring: ProfileRecord
    band_per_mm: Annotated[Number, Field(gt=0.0, le=1e9)]

    def surface(self) -> GroovedFace:
        """The surface. Raises :class:`InputError` if a zone lies nowhere within its reach."""
        lens, ring = (ProfileFace(**zone.model_dump(exclude={"kind"})) for zone in (self.lens, self.ring))
        return GroovedFace(self.reach_mm, lens, ring, self.band_per_mm)


@surface_record.register
def _(surface: GroovedFace) -> SurfaceRecord:
    lens, ring = (surface_record(zone) for zone in (surface.lens, surface.ring))
    return GroovedRecord.model_validate(
        {
            "kind": "grooved",
            "reach_mm": surface.reach_mm,
            "lens": lens,
            "ring": ring,
            "band_per_mm": surface.band_per_mm,
        }
    )
