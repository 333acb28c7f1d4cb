"""Scatter of a face, ``[lens.outer.scatter]``: how it spreads the light that passes, or that its mirror reflects."""

from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from math import exp, radians, sqrt
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.scattering import FacetTurn, GaussianFacets, RingScatter, gaussian, lambertian, shares_within
from lensforge.public import public
from lensforge.results.files import MIB
from lensforge.results.table_names import DEGREES, Column, doubt_degrees
from lensforge.results.text_table import TextTable
from lensforge.spec.spec_section import FilePath, Section, check
from lensforge.spec.table_file import OfTableFile

Values = Float[np.ndarray, " n"]

_MOST_BACK = 0.5  # of the light along the normal: with more the face is no lens any more


@public
class GaussianScatter(Section):
    """A frosted, etched or finely machined face: facets whose slopes are normally distributed."""

    kind: Literal["gaussian"] = "gaussian"
    sigma_deg: Annotated[float, Field(ge=1e-4, le=45.0)] = Field(
        description="Rms angle, along any line, by which the face spreads light that comes along its normal: of "
        "the transmitted light behind the face, of a mirror of the reflected light. An etched face "
        "has 1 to 10, a fine print 0.5 to 2."
    )

    def model(self, turn: FacetTurn) -> GaussianFacets:
        """Facets whose rms slope turns light by that angle."""
        sigma = radians(self.sigma_deg)
        facets = gaussian(sigma, turn) if sigma < turn.most_rad else None
        back = 1.0 if facets is None else _turned_back(facets.slope, turn)
        if facets is None or back > _MOST_BACK:
            raise ValueError(
                f"sigma_deg = {self.sigma_deg:g}: {100.0 * back:.0f} % of the light along the normal would be turned "
                "back; take a smaller angle, on both faces if need be"
            )
        return facets


def _turned_back(slope: float, turn: FacetTurn) -> float:
    """Share of Gaussian facets so steep that they reflect light along the normal totally."""
    if turn.ratio is None or turn.ratio <= 1.0:
        return 0.0
    steepest = 1.0 / sqrt(turn.ratio**2 - 1.0)
    return exp(-0.5 * (steepest / slope) ** 2)


@public
class LambertianScatter(Section):
    """A face that sends a share of its light to all sides alike, as opal material or white paint does."""

    kind: Literal["lambertian"]
    share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=1.0,
        description="Share of the light that passes, or that its mirror reflects; the rest goes on as from a "
        "polished face.",
    )

    def model(self, turn: FacetTurn) -> RingScatter:
        """The share, about the normal."""
        return lambertian(self.share)


_RINGS = 1024  # of a shift: its rings differ by 2 % in radius at most
_FINEST = 1e-7  # a finer scatter is none
_OF_INTERVAL = 16  # rings between two angles of a table


@public
class AbgScatter(Section):
    """A finely rough face by the ABg model (Harvey and Shack): a / (b + s^g) per steradian, where s is the distance of
    the direction cosines from the polished direction, up to 1. It scatters its integral; the rest goes on as polished.
    """

    kind: Literal["abg"]
    a: Annotated[float, Field(gt=0.0, le=1e6)] = Field(description="Amplitude.")
    b: Annotated[float, Field(ge=1e-15, le=1e6)] = Field(
        description="Roll-off: b^(1/g) is the distance from which the light falls."
    )
    g: Annotated[float, Field(ge=0.0, le=10.0)] = Field(description="Slope: of polished glass 1 to 3.")

    def model(self, turn: FacetTurn) -> RingScatter:
        """Rings whose shares are those of the model."""
        first = max(1e-3 * min(self.b ** (1.0 / self.g) if self.g > 0.0 else 1.0, 1.0), _FINEST)
        radii = np.concatenate([[0.0], np.geomspace(first, 1.0, _RINGS)])
        shares = shares_within(radii, lambda s: self.a / (self.b + s**self.g))
        if shares[-1] > 1.0:
            raise ValueError(
                f"a = {self.a:g}: the face would scatter {shares[-1]:.3g} of its light, must be at most 1; "
                f"take a up to {self.a / shares[-1]:.3g}"
            )
        return RingScatter(tuple(radii.tolist()), (tuple(shares.tolist()),))


_MOST_ROWS = 1000
_MOST_BYTES = 32 * MIB
_COLUMNS = (
    Column(("incidence", "aoi", "theta_i", "incidence angle", "angle of incidence"), DEGREES),
    Column(("scattering", "scatter", "theta_s", "scattering angle", "scatter angle"), DEGREES),
    Column(("bsdf", "btdf", "brdf", "scatter function"), {"": 1.0, "per_sr": 1.0}),
)
_Angles = Annotated[tuple[Annotated[float, Field(ge=0.0, le=90.0)], ...], Field(max_length=_MOST_ROWS)]
_Row = Annotated[tuple[Annotated[float, Field(ge=0.0, le=1e12)], ...], Field(max_length=_MOST_ROWS)]


def _density(angles_rad: Values, bsdf_per_sr: Values, radii: Values) -> Values:
    density: Values = np.interp(np.arcsin(radii), angles_rad, bsdf_per_sr)
    return density


@public
class TableScatter(OfTableFile):
    """A face whose scatter function (BSDF) was measured, the same all around the polished direction.

    Even between its angles, and 0 beyond the last of ``scattering_deg``. What a row leaves of 1 goes on as from a
    polished face; Fresnel's or the coating's reflectance comes on top of it.
    """

    kind: Literal["table"]
    incidence_deg: _Angles = Field(default=(), description="Angles of incidence, before the face, rising from 0.")
    scattering_deg: _Angles = Field(
        default=(),
        description="Angles from the polished direction, rising from 0; their sine is the distance of the "
        "direction cosines.",
    )
    bsdf_per_sr: Annotated[tuple[_Row, ...], Field(max_length=_MOST_ROWS)] = Field(
        default=(), description="Scatter function (1/sr), a row for each of `incidence_deg`."
    )
    file: FilePath | None = Field(
        default=None,
        description="Table with columns incidence_deg, scattering_deg and bsdf, read into these fields as the spec is.",
    )

    @classmethod
    def read(cls, path: Path) -> Mapping[str, object]:
        """Fields of the table at ``path``, a row for each angle of incidence and of scattering."""
        table = TextTable.read(path, missing="give a table of the BSDF", most_bytes=_MOST_BYTES)
        incidence, scattering, rows = table.grid(_COLUMNS, "angles of incidence", "of scattering")
        doubt_degrees(incidence, table.name, "incidence_rad")
        return {"incidence_deg": incidence, "scattering_deg": scattering, "bsdf_per_sr": rows}

    @check
    def _usable(self) -> None:
        if not (self.incidence_deg and self.scattering_deg and self.bsdf_per_sr):
            raise ValueError("give file, or incidence_deg, scattering_deg and bsdf_per_sr")
        counts = len(self.incidence_deg), len(self.scattering_deg)
        if len(self.bsdf_per_sr) != counts[0] or {len(row) for row in self.bsdf_per_sr} != {counts[1]}:
            raise ValueError(
                f"bsdf_per_sr: must be {counts[0]} rows (incidence_deg) of {counts[1]} numbers (scattering_deg)"
            )
        for name, angles, least in (
            ("incidence_deg", self.incidence_deg, 1),
            ("scattering_deg", self.scattering_deg, 2),
        ):
            if angles[0] != 0.0 or len(angles) < least or any(b <= a for a, b in pairwise(angles)):
                raise ValueError(f"{name}: must rise from 0, {least} at least")

    def model(self, turn: FacetTurn) -> RingScatter:
        """Rings whose shares are those of the table."""
        angles = np.radians(self.scattering_deg)
        fine = np.interp(np.arange(_OF_INTERVAL * (len(angles) - 1) + 1) / _OF_INTERVAL, np.arange(len(angles)), angles)
        radii = np.sin(fine)
        shares = []
        for incidence, row in zip(self.incidence_deg, self.bsdf_per_sr, strict=True):
            within = shares_within(radii, partial(_density, angles, np.array(row)))
            if within[-1] > 1.0 + 1e-9:
                raise ValueError(
                    f"bsdf_per_sr at incidence_deg = {incidence:g}: the face would scatter {within[-1]:.3g} of its "
                    "light, must be at most 1; a scatter function has the unit 1/sr, without the cosine"
                )
            shares.append(tuple(np.minimum(within, 1.0).tolist()))
        cosines = np.cos(np.radians(self.incidence_deg))[::-1]
        return RingScatter(tuple(radii.tolist()), tuple(shares[::-1]), tuple(cosines.tolist()))


AnyScatter = Annotated[GaussianScatter | LambertianScatter | AbgScatter | TableScatter, Field(discriminator="kind")]
