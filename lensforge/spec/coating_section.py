"""The coatings of a spec by their reflectance, tables of a coating, and the ``[lens.cover_glass]``.

Tables (.csv, .txt) have angle (degrees), wavelength (nm) and reflectance, a row for each pair. Columns are separated by
commas, semicolons, tabs or blanks, in this order or as a first line names them; comments start with ``#``. The cover
glass is a plane-parallel plate between the lens and the receivers.
"""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from lensforge.optics.material import MATERIALS, Material
from lensforge.optics.media import CoatingLayer, CoverGlass, Film, IndexCurve, LayerStack, ReflectanceTable
from lensforge.public import public
from lensforge.results.files import MIB
from lensforge.results.table_names import DEGREES, NANOMETRES, SHARE, Column, doubt_degrees
from lensforge.results.text_table import TextTable
from lensforge.spec.spec_section import FilePath, Label, Millimetres, Section, check
from lensforge.spec.table_file import OfTableFile

_MOST_BYTES = 32 * MIB
_COLUMNS = (
    Column(("angle", "aoi", "theta", "θ", "angle of incidence", "incidence", "incidence angle", "winkel"), DEGREES),
    Column(("wavelength", "lambda", "λ", "wl", "nm", "wellenlänge"), NANOMETRES),
    Column(("reflectance", "reflectivity", "reflection", "r", "reflexion", "reflexionsgrad"), SHARE),
)

_MOST_ANGLES = 1000
_MOST_WAVELENGTHS = 1000
_MOST_LAYERS = 100
_LIGHT_NM = 100.0, 20_000.0
_STEP_NM = 2.0  # of an index by wavelength: linear between, a glass then errs by less than 1e-6 in the visible range
_SINGLE_ANGLES = (0.0, 90.0)  # of a constant reflectance

_Index = Annotated[float, Field(ge=1.0, le=6.0)]
_Wavelength = Annotated[float, Field(ge=_LIGHT_NM[0], le=_LIGHT_NM[1])]


def _as_rows(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [[value]]
    if isinstance(value, list | tuple) and value and not any(isinstance(row, list | tuple) for row in value):
        return [value]
    return value


_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Rows = Annotated[
    tuple[Annotated[tuple[_Share, ...], Field(min_length=1, max_length=_MOST_ANGLES)], ...],
    BeforeValidator(_as_rows, json_schema_input_type=_Share | tuple[_Share, ...] | tuple[tuple[_Share, ...], ...]),
    Field(max_length=_MOST_WAVELENGTHS),
]


@public
class LayerSection(Section):
    """A layer that absorbs nothing: ``refractive_index`` at all wavelengths, or ``material`` of the catalogue."""

    refractive_index: _Index | None = Field(default=None, description="Index at all wavelengths; or give `material`.")
    material: Label | None = Field(
        default=None, description="Material of the catalogue, its index by wavelength; or give `refractive_index`."
    )
    thickness_nm: Annotated[float, Field(gt=0.0, le=100_000.0)] = Field(description="Thickness of the layer.")

    @check
    def _one_index(self) -> None:
        if (self.refractive_index is None) == (self.material is None):
            raise ValueError("give one of refractive_index and material")
        if self.material is not None and self.material not in MATERIALS:
            raise ValueError(f"material = {self.material!r}: must be one of {', '.join(MATERIALS)}")

    @property
    def title(self) -> str:
        """Its index or material, and its thickness."""
        material = self.material or f"n = {self.refractive_index:g}"
        return f"{material}, {self.thickness_nm:g} nm"

    @property
    def dispersion(self) -> Material | None:
        """Material of the catalogue; None for one index."""
        return None if self.material is None else MATERIALS[self.material]


@public
class CoatingSection(OfTableFile):
    """Reflectance of a face below total reflection, in place of Fresnel's; what is not reflected passes.

    One of ``reflectance``, ``file`` and ``layers``. Up to 90 degrees a table goes on to 1.
    """

    reflectance: _Rows = Field(
        default=(),
        description="Share of the light that is reflected: a number for all angles and wavelengths, a row of them "
        "at `angle_deg`, or such a row for each of `wavelength_nm`.",
    )
    angle_deg: Annotated[tuple[Annotated[float, Field(ge=0.0, le=90.0)], ...], Field(max_length=_MOST_ANGLES)] = Field(
        default=(), description="Angles of incidence of the table, rising from 0, in the less dense medium: the air."
    )
    wavelength_nm: Annotated[tuple[_Wavelength, ...], Field(max_length=_MOST_WAVELENGTHS)] = Field(
        default=(), description="Wavelengths of the table's rows, rising."
    )
    layers: Annotated[tuple[LayerSection, ...], Field(max_length=_MOST_LAYERS)] = Field(
        default=(), description="Thin layers, of which the first lies next to what surrounds the body."
    )
    file: FilePath | None = Field(
        default=None,
        description="Table with columns angle_deg, wavelength_nm and reflectance, read into these fields as the "
        "spec is.",
    )

    @classmethod
    def read(cls, path: Path) -> Mapping[str, object]:
        """Fields of the table at ``path``, a row for each angle and wavelength."""
        table = TextTable.read(path, missing="give a table of the reflectance", most_bytes=_MOST_BYTES)
        angles, waves, by_angle = table.grid(_COLUMNS, "angles", "wavelengths")
        doubt_degrees(angles, table.name, "angle_rad")
        return {"angle_deg": angles, "wavelength_nm": waves, "reflectance": np.transpose(by_angle).tolist()}

    @check
    def _usable(self) -> None:
        if bool(self.reflectance) == bool(self.layers):
            raise ValueError("give one of reflectance (a number, or a table by angle_deg), file, and layers")
        if self.layers:
            if self.angle_deg or self.wavelength_nm:
                raise ValueError("layers have no angle_deg or wavelength_nm: leave them out")
            low, high = self.range_nm
            if not low < high:
                raise ValueError(f"layers: one material is known from {low:g} nm on, another up to {high:g} nm")
            return
        angles = self.angle_deg or _SINGLE_ANGLES[:1]
        waves = self.wavelength_nm or (0.0,)
        if len(self.reflectance) != len(waves) or {len(row) for row in self.reflectance} != {len(angles)}:
            widths = " or ".join(str(count) for count in sorted({len(row) for row in self.reflectance}))
            raise ValueError(
                f"reflectance: {len(self.reflectance)} rows of {widths} numbers, must be a row of {len(angles)} "
                f"(angle_deg) for each of {len(waves)} (wavelength_nm)"
            )
        for name, values in (("angle_deg", angles), ("wavelength_nm", waves)):
            if any(b <= a for a, b in pairwise(values)):
                raise ValueError(f"{name} must rise")
        if angles[0] != 0.0 or len(self.angle_deg) == 1:
            raise ValueError(f"angle_deg = {angles[0]:g} and {len(angles)} in all: must rise from 0, two at least")

    @property
    def title(self) -> str:
        """The coating in a few words: its layers from outside to the body, or what it reflects."""
        if self.layers:
            return "; ".join(layer.title for layer in self.layers) + ", from outside to the body"
        low, high = (100.0 * pick(map(pick, self.reflectance)) for pick in (min, max))
        if low == high:
            return f"reflects {low:g} %"
        return f"reflects {low:g} to {high:g} %, up to {self.angle_deg[-1] if self.angle_deg else 90:g}°"

    @property
    def chromatic(self) -> bool:
        """True where it depends on the wavelength."""
        return bool(self.layers or self.wavelength_nm)

    @property
    def range_nm(self) -> tuple[float, float]:
        """Wavelengths at which the materials of all layers are known."""
        known = [_LIGHT_NM, *(layer.dispersion.trusted_nm for layer in self.layers if layer.dispersion is not None)]
        return max(low for low, _ in known), min(high for _, high in known)

    def coating(self, body: float | Material) -> Film:
        """The coating as rays meet it; ``body``: index of what carries it, or its material."""
        if not self.layers:
            if not self.angle_deg:
                return ReflectanceTable(_SINGLE_ANGLES, tuple(row * 2 for row in self.reflectance), self.wavelength_nm)
            return ReflectanceTable(self.angle_deg, self.reflectance, self.wavelength_nm)
        layers = tuple(
            CoatingLayer(_curve(layer.dispersion or layer.refractive_index), layer.thickness_nm)
            for layer in self.layers
        )
        return LayerStack(layers, _curve(body), self.range_nm)


def _curve(index: float | Material | None) -> IndexCurve:
    """Index against wavelength, over the range in which it is known."""
    if isinstance(index, Material):
        low, high = index.trusted_nm
        waves = np.linspace(low, high, int(np.ceil((high - low) / _STEP_NM)) + 1)
        return IndexCurve(tuple(index.index(waves).tolist()), tuple(waves.tolist()))
    assert index is not None
    return IndexCurve((index,))


@public
class CoverGlassSection(Section):
    """A plate across the axis, as wide as the light, in what surrounds the lens.

    What its faces reflect goes back and is followed no further.
    """

    refractive_index: Annotated[float, Field(ge=1.0, le=4.0)] = Field(
        description="Index of the plate at all wavelengths."
    )
    thickness_mm: Millimetres = Field(description="Thickness of the plate.")
    distance_mm: Millimetres = Field(description="Height of its near face above z = 0, beyond the whole lens.")
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=0.0, description="Absorption of the plate: light loses exp(-absorption times path) (Beer and Lambert)."
    )
    coating: CoatingSection | None = Field(
        default=None, description="Coating of both faces, its `layers` counted from outside the glass."
    )

    @property
    def glass(self) -> CoverGlass:
        """The plate as rays meet it."""
        coating = None if self.coating is None else self.coating.coating(self.refractive_index)
        return CoverGlass(self.refractive_index, self.thickness_mm, self.distance_mm, self.absorption_per_mm, coating)
