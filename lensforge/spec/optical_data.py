"""The ``[lens.optical_data]`` of a spec: index and absorption of a material of one's own, by formula or by table."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from lensforge.errors import InputError
from lensforge.materials.data import MaterialData
from lensforge.materials.formulas import HUGE, MOST_COEFFICIENTS, Formula, IndexTable
from lensforge.materials.material import Absorption, Dispersion, Material
from lensforge.materials.reading import read_material
from lensforge.materials.temperature import HIGHEST_C, LOWEST_C, REFERENCE_C, TemperatureLaw
from lensforge.spec.section import Label, Section

_Wavelength = Annotated[float, Field(ge=100.0, le=20_000.0)]
_MOST_ROWS = 10_000  # of tables: 0.1 nm over the visible range and more
_Wavelengths = Annotated[tuple[_Wavelength, ...], Field(max_length=_MOST_ROWS)]
_Coefficient = Annotated[float, Field(ge=-HUGE, le=HUGE)]
_Schott = Annotated[float, Field(ge=-1e3, le=1e3)]  # the largest is the wavelength of the pole, in um
Celsius = Annotated[float, Field(ge=LOWEST_C, le=HIGHEST_C)]
Expansion = Annotated[float, Field(ge=-1e-4, le=1e-3)]  # 1/K; silicones have 3e-4
_LEAST_INDEX, _LARGEST_INDEX = 1.0, 4.0
_CHECKED = 400  # wavelengths of the range at which a formula is tried


class OpticalData(Section):
    """Index of a material: ``formula`` with ``coefficients``, or ``refractive_index`` at ``wavelength_nm``."""

    source: Label = ""
    """Origin of the numbers, in words."""
    formula: Annotated[str, Field(max_length=40)] | None = None
    """Name of a dispersion formula, such as "sellmeier" (pairs b, c in um^2: n^2 - 1 = sum b w^2 / (w^2 - c)) or
    "cauchy" (n = a + b / w^2 + ...), wavelength w in um.
    """
    coefficients: Annotated[tuple[_Coefficient, ...], Field(max_length=MOST_COEFFICIENTS)] = ()
    """Coefficients of the formula."""
    range_nm: tuple[_Wavelength, _Wavelength] | None = None
    """Wavelengths over which the formula holds."""
    wavelength_nm: _Wavelengths = ()
    """Wavelengths of a table of the index, rising; between them it is linear."""
    refractive_index: Annotated[tuple[float, ...], Field(max_length=_MOST_ROWS)] = ()
    """Index at each of these wavelengths."""
    absorption_nm: _Wavelengths = ()
    """Wavelengths of a table of the absorption, rising; without it the material is clear."""
    absorption_per_mm: Annotated[
        tuple[Annotated[float, Field(ge=0.0, le=100.0)], ...], Field(max_length=_MOST_ROWS)
    ] = ()
    """Absorption at each of these wavelengths."""

    schott_coefficients: tuple[_Schott, _Schott, _Schott, _Schott, _Schott, _Schott] | None = None
    """Coefficients [D0, D1, D2, E0, E1, pole] of the index against temperature (SCHOTT)."""
    reference_temperature_c: Celsius = REFERENCE_C
    """Temperature at which the index is the one above."""
    expansion_per_k: Expansion | None = None
    """Linear expansion of every length with temperature."""

    @model_validator(mode="after")
    def _usable(self) -> "OpticalData":
        if (self.formula is None) == (not self.wavelength_nm):
            raise ValueError("give formula with coefficients and range_nm, or wavelength_nm with refractive_index")
        if self.formula is not None and (self.range_nm is None or not self.coefficients):
            raise ValueError("formula needs coefficients, and range_nm, in which it holds")
        for waves, values, names in (
            (self.wavelength_nm, self.refractive_index, "wavelength_nm and refractive_index"),
            (self.absorption_nm, self.absorption_per_mm, "absorption_nm and absorption_per_mm"),
        ):
            if len(waves) != len(values):
                raise ValueError(f"{names}: {len(waves)} and {len(values)} numbers, must be as many")
            if any(b <= a for a, b in pairwise(waves)):
                raise ValueError(f"{names.split()[0]} must rise")
        low, high = self._span
        if not low < high:
            raise ValueError(f"range_nm = [{low:g}, {high:g}]: must rise")
        try:
            self._require_indices()
        except InputError as error:
            raise ValueError(str(error)) from None
        return self

    def _require_indices(self) -> None:
        waves = np.linspace(*self._span, _CHECKED)
        indices = self._dispersion.index(waves)
        wrong = ~((indices >= _LEAST_INDEX) & (indices <= _LARGEST_INDEX))
        if wrong.any():
            raise InputError(
                f"its index at {waves[wrong][0]:.4g} nm is {indices[wrong][0]:.4g}, must be {_LEAST_INDEX:g} to "
                f"{_LARGEST_INDEX:g}; the formulas take wavelengths in um"
            )

    @property
    def _span(self) -> tuple[float, float]:
        if self.range_nm is not None:
            return self.range_nm
        return self.wavelength_nm[0], self.wavelength_nm[-1]

    @property
    def _dispersion(self) -> Dispersion:
        if self.formula is not None:
            return Formula(self.formula, self.coefficients)
        return IndexTable(self.wavelength_nm, self.refractive_index)

    def material(self, name: str) -> Material:
        """The material of these numbers."""
        absorption = Absorption(self.absorption_nm, self.absorption_per_mm) if self.absorption_nm else None
        law = TemperatureLaw(
            self.reference_temperature_c, self.schott_coefficients or (), expansion_per_k=self.expansion_per_k
        )
        return Material(name, self._dispersion, self._span, self.source or "the spec", None, absorption, law)


def with_optical_data(content: Any) -> Any:
    """Fields of a ``[lens]`` with the data of its ``material_file`` in place of that file: they need it no more.

    Raises :class:`InputError` for a file that cannot be read, or where both are given.
    """
    if not isinstance(content, dict) or not isinstance(content.get("material_file"), str | Path):
        return content
    if content.get("optical_data") is not None:
        raise InputError("material_file and optical_data: give one of the two")
    found = read_material(Path(content["material_file"]), content.get("material"))
    rest = {key: value for key, value in content.items() if key != "material_file"}
    return rest | {"material": found.name, "optical_data": _fields(found)}


def _fields(found: MaterialData) -> dict[str, Any]:
    """Fields of :class:`OpticalData`, plain, as a file would have them."""
    absorption = {"absorption_nm": list(found.absorption_nm), "absorption_per_mm": list(found.absorption_per_mm)}
    if isinstance(found.index, Formula):
        index: dict[str, Any] = {"formula": found.index.name, "coefficients": list(found.index.coefficients)}
        index["range_nm"] = list(found.range_nm)
    else:
        index = {"wavelength_nm": list(found.index.wavelengths_nm), "refractive_index": list(found.index.indices)}
    law, warming = found.temperature, dict[str, Any]()
    if law.reference_c != REFERENCE_C:
        warming["reference_temperature_c"] = law.reference_c
    if law.schott:
        warming["schott_coefficients"] = list(law.schott)
    if law.expansion_per_k is not None:
        warming["expansion_per_k"] = law.expansion_per_k
    return {"source": found.source, **index, **(absorption if found.absorption_nm else {}), **warming}
