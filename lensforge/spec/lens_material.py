"""The material of a ``[lens]`` and what surrounds it: index, absorption, coatings, and change with temperature."""

from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from lensforge.errors import InputError
from lensforge.materials.catalogue import MATERIALS
from lensforge.materials.formulas import IndexTable
from lensforge.materials.material import D_LINE_NM, Material, by_abbe_number
from lensforge.materials.temperature import UNKNOWN, TemperatureLaw
from lensforge.optics.media import Media
from lensforge.spec.coating import CoatingSection
from lensforge.spec.cover_glass import CoverGlassSection
from lensforge.spec.optical_data import Celsius, Expansion, OpticalData, with_optical_data
from lensforge.spec.section import FilePath, Label, Section

_SHORTEST_NM, _LONGEST_NM = 1.0, 1e7  # of any light
_SAME_INDEX = 1e-9  # tolerance between a material's index and the one stored beside it in a lens.json

_Index = Annotated[float, Field(ge=1.0, le=4.0)]


class LensMaterial(Section):
    """Material of the body, and what lies on its faces and around it.

    Either ``refractive_index`` holds for all wavelengths; or the material is dispersive: a ``material`` of
    ``materials.catalogue``, one with ``optical_data`` or a ``material_file``, or one with ``abbe_number``.
    """

    refractive_index: _Index = 1.4936
    """Index at all wavelengths, ``material`` being only a label; or leave it out for a dispersive material."""
    material: Label = "PMMA at 564 nm"
    """Material of the catalogue, dispersive; or, beside ``refractive_index`` or other data, a label."""
    material_file: FilePath | None = None
    """A Zemax catalogue, of which ``material`` names the glass, a file of refractiveindex.info, or a table; read into
    ``optical_data`` as the spec is.
    """
    optical_data: OpticalData | None = None
    """Index and absorption of a material of one's own."""
    abbe_number: Annotated[float, Field(ge=10.0, le=200.0)] | None = None
    """Abbe number of a material whose n_d is ``refractive_index``: makes it dispersive."""
    cavity_index: _Index = 1.0
    """Index of what fills the cavity, such as a gel that couples the LED to the lens."""
    outside_index: _Index = 1.0
    """Index of what surrounds the lens, such as water."""
    inner_coating: CoatingSection | None = None
    """Coating of the inner face."""
    outer_coating: CoatingSection | None = None
    """Coating of the outer face."""
    cover_glass: CoverGlassSection | None = None
    """Plate in front of the lens."""
    design_wavelength_nm: Annotated[float, Field(ge=100.0, le=20_000.0)] = D_LINE_NM
    """Wavelength of the index where a single number is needed, and for a source without wavelengths."""
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Absorption of the body (Beer and Lambert), if the material itself states none."""
    density_g_per_cm3: Annotated[float, Field(ge=0.1, le=30.0)] | None = None
    """Density of the grade that is ordered; gives the part its mass."""
    index_per_k: Annotated[float, Field(ge=-1e-3, le=1e-3)] | None = None
    """Change of the index relative to air with temperature, for a material that does not state its own."""
    expansion_per_k: Expansion | None = None
    """Linear expansion with temperature, for a material that does not state its own."""
    reference_temperature_c: Celsius | None = None
    """Temperature at which the lens has its index and its size; by default 20, or that of the material."""

    @model_validator(mode="before")
    @classmethod
    def _material_of_the_file(cls, content: Any) -> Any:
        try:
            return with_optical_data(content)
        except InputError as error:
            raise ValueError(f"material_file: {error}") from None

    @model_validator(mode="after")
    def _one_source_of_the_index(self) -> "LensMaterial":
        given = self.model_fields_set
        known = self._own_or_catalogued
        if known is None:
            if "material" in given and "refractive_index" not in given:
                raise ValueError(
                    f"material = {self.material!r}: one of {', '.join(MATERIALS)}, or add refractive_index"
                )
            if self.abbe_number is not None and "refractive_index" not in given:
                raise ValueError("abbe_number needs refractive_index, the n_d of the same material")
            if "design_wavelength_nm" in given and self.design_wavelength_nm != D_LINE_NM and not self._chromatic:
                raise ValueError(
                    f"design_wavelength_nm goes with a material of {', '.join(MATERIALS)}, or a coating by wavelength"
                )
            return self
        if self.abbe_number is not None:
            raise ValueError(f"abbe_number: {self.material} has its own dispersion; leave out one of the two")
        if self.absorption_per_mm > 0.0 and known.absorption is not None:
            raise ValueError(f"absorption_per_mm: {self.material} has its own absorption; leave out one of the two")
        try:
            index = known.index_at(self.design_wavelength_nm)
        except InputError as error:
            raise ValueError(f"design_wavelength_nm: {error}") from None
        if "refractive_index" in given and abs(self.refractive_index - index) > _SAME_INDEX:
            raise ValueError(
                f"refractive_index = {self.refractive_index:g}, but {self.material} has {index:.6g} at "
                f"{self.design_wavelength_nm:g} nm; leave out refractive_index, or name the material otherwise"
            )
        object.__setattr__(self, "refractive_index", index)
        return self

    @model_validator(mode="after")
    def _one_source_of_the_change_with_temperature(self) -> "LensMaterial":
        known = UNKNOWN if self.dispersion is None else self.dispersion.temperature
        for name, own in (
            ("index_per_k", known.knows_index),
            ("reference_temperature_c", known.knows_index),
            ("expansion_per_k", known.expansion_per_k is not None),
        ):
            if own and getattr(self, name) is not None:
                raise ValueError(f"{name}: {self.material} has its own; leave it out, or name the material otherwise")
        return self

    @property
    def temperature_law(self) -> TemperatureLaw:
        """Change of index and size with temperature: that of the material, and the constants of the spec."""
        known = UNKNOWN if self.dispersion is None else self.dispersion.temperature
        expansion, reference_c = self.expansion_per_k, self.reference_temperature_c
        return replace(
            known,
            reference_c=known.reference_c if reference_c is None else reference_c,
            index_per_k=self.index_per_k,
            expansion_per_k=known.expansion_per_k if expansion is None else expansion,
        )

    @model_validator(mode="after")
    def _glass_is_denser(self) -> "LensMaterial":
        glass = self.cover_glass
        if glass is not None and glass.refractive_index < self.outside_index:
            raise ValueError(
                f"cover_glass.refractive_index = {glass.refractive_index:g}: must be outside_index = "
                f"{self.outside_index:g} at least, or it would reflect oblique light totally"
            )
        return self

    @property
    def media(self) -> Media:
        """The body at the design wavelength, and what fills the cavity and surrounds the lens."""
        material = self._material
        if material is None or material.absorption is None:
            absorption = self.absorption_per_mm
        else:
            absorption = float(material.absorption.at(np.array([self.design_wavelength_nm]))[0])
        glass = None if self.cover_glass is None else self.cover_glass.glass
        body = self._material or self.refractive_index
        inner, outer = (
            None if each is None else each.coating(body) for each in (self.inner_coating, self.outer_coating)
        )
        around, wavelength_nm = (self.cavity_index, self.outside_index), self.design_wavelength_nm
        return Media(self.refractive_index, absorption, *around, glass, inner, outer, wavelength_nm)

    @property
    def _chromatic(self) -> bool:
        """True where a coating depends on the wavelength."""
        glass = None if self.cover_glass is None else self.cover_glass.coating
        return any(each is not None and each.chromatic for each in (self.inner_coating, self.outer_coating, glass))

    @property
    def _own_or_catalogued(self) -> Material | None:
        """The material of the spec's own data, or of the catalogue by its name."""
        if self.optical_data is not None:
            return self.optical_data.material(self.material)
        return MATERIALS.get(self.material)

    @property
    def dispersion(self) -> Material | None:
        """Index against wavelength; None for a lens of one index, unless a coating of it depends on the wavelength."""
        if self._material is None and self._chromatic:
            whole = (_SHORTEST_NM, _LONGEST_NM)
            return Material(self.material, IndexTable(whole, 2 * (self.refractive_index,)), whole, "the spec", None)
        return self._material

    @property
    def _material(self) -> Material | None:
        if self.abbe_number is not None:
            return by_abbe_number(self.refractive_index, self.abbe_number, self.material)
        return self._own_or_catalogued
