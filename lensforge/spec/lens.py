"""The ``[lens]`` of a spec: material, starting shape, and fixed surfaces."""

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from lensforge.errors import InputError
from lensforge.given_faces.lens_face import lens_file
from lensforge.materials.catalogue import MATERIALS
from lensforge.materials.formulas import IndexTable
from lensforge.materials.material import D_LINE_NM, Material, by_abbe_number
from lensforge.materials.temperature import UNKNOWN, TemperatureLaw
from lensforge.optics.media import Media
from lensforge.spec.coating import CoatingSection
from lensforge.spec.cover_glass import CoverGlassSection
from lensforge.spec.fixed_surface import FixedSurface
from lensforge.spec.optical_data import Celsius, Expansion, OpticalData, with_optical_data
from lensforge.spec.section import FilePath, Label, Millimetres, Section
from lensforge.surfaces.srbf import MOST_FUNCTIONS, MOST_LEVELS, SrbfBasis
from lensforge.surfaces.surface import Surface

_SHORTEST_NM, _LONGEST_NM = 1.0, 1e7  # of any light
_SAME_INDEX = 1e-9  # tolerance between a material's index and the one stored beside it in a lens.json

_Index = Annotated[float, Field(ge=1.0, le=4.0)]
_Numbers = Annotated[tuple[Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)], ...], Field(max_length=MOST_LEVELS)]
# chosen by its type, so that a wrong number is named, not both forms
Levels = Annotated[
    Annotated[Literal["auto"], Tag("word")] | Annotated[_Numbers, Tag("numbers")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "numbers"),
]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "rectangle", "square"]


class LensSection(Section):
    """The starting lens: two hemispheres of the given radii, and the SRBFs that will shape both.

    ``fixed_inner`` or ``fixed_outer`` replaces one hemisphere, and the search does not change that surface.
    ``symmetry`` "auto" is the largest mirror symmetry that source and target share; the record of a lens names it.
    ``start``: a result folder, or its lens.json: the search goes on from that lens instead of from the hemispheres.

    Either ``refractive_index`` holds for all wavelengths, and ``material`` is only a label; or the material is
    dispersive, and its index at ``design_wavelength_nm`` is used where a single number is needed, and for a source
    without wavelengths. Dispersive is a ``material`` of ``materials.catalogue``; one with ``optical_data``; one of a
    ``material_file`` (a Zemax catalogue, of which ``material`` names the glass; a file of refractiveindex.info; a
    table), which becomes ``optical_data`` as the spec is read; and one with ``abbe_number``, whose n_d is
    ``refractive_index``.
    ``absorption_per_mm`` (Beer and Lambert) dims every ray on its way through the body, if the material itself states
    no absorption. ``cavity_index``, ``outside_index``: of what fills the cavity, such as a gel that couples the LED to
    the lens, and of what surrounds the lens, such as water, at all wavelengths. ``inner_coating`` and
    ``outer_coating`` set what the faces reflect. ``density_g_per_cm3``, of the grade that is ordered, gives the part
    its mass.

    ``index_per_k`` (change of the index relative to air, 1/K) and ``expansion_per_k`` (linear, 1/K) are constants of a
    data sheet, for a material that does not state its own: with them the lens can be evaluated at another temperature
    than ``reference_temperature_c``, at which it has its index and its size; by default 20, or that of the material.
    """

    refractive_index: _Index = 1.4936
    material: Label = "PMMA at 564 nm"
    material_file: FilePath | None = None
    optical_data: OpticalData | None = None
    abbe_number: Annotated[float, Field(ge=10.0, le=200.0)] | None = None
    cavity_index: _Index = 1.0
    outside_index: _Index = 1.0
    inner_coating: CoatingSection | None = None
    outer_coating: CoatingSection | None = None
    cover_glass: CoverGlassSection | None = None
    design_wavelength_nm: Annotated[float, Field(ge=100.0, le=20_000.0)] = D_LINE_NM
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    density_g_per_cm3: Annotated[float, Field(ge=0.1, le=30.0)] | None = None
    index_per_k: Annotated[float, Field(ge=-1e-3, le=1e-3)] | None = None
    expansion_per_k: Expansion | None = None
    reference_temperature_c: Celsius | None = None
    levels: Levels = "auto"
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.75
    inner_offset_mm: Millimetres | None = None
    outer_offset_mm: Millimetres | None = None
    fixed_inner: FixedSurface | None = None
    fixed_outer: FixedSurface | None = None
    symmetry: Symmetry = "auto"
    start: Annotated[FilePath, AfterValidator(lens_file)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _material_of_the_file(cls, content: Any) -> Any:
        try:
            return with_optical_data(content)
        except InputError as error:
            raise ValueError(f"material_file: {error}") from None

    @model_validator(mode="after")
    def _one_source_of_the_index(self) -> "LensSection":
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
    def _one_source_of_the_change_with_temperature(self) -> "LensSection":
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
    def _glass_is_denser(self) -> "LensSection":
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

    @model_validator(mode="after")
    def _each_surface_starts_once(self) -> "LensSection":
        for name, offset, fixed in (
            ("inner", self.inner_offset_mm, self.fixed_inner),
            ("outer", self.outer_offset_mm, self.fixed_outer),
        ):
            if (offset is None) == (fixed is None):
                raise ValueError(f"give one of {name}_offset_mm, where the search starts, and [lens.fixed_{name}]")
        if self.fixed_inner is not None and self.fixed_outer is not None:
            raise ValueError("fixed_inner and fixed_outer: one of the surfaces must be free")
        return self

    @model_validator(mode="after")
    def _outer_outside_inner(self) -> "LensSection":
        inner, outer = self.start_mm
        if outer <= inner:
            name = "outer_offset_mm" if self.fixed_outer is None else "the vertex of fixed_outer"
            raise ValueError(f"{name} = {outer} must exceed where the inner surface meets the axis, {inner:g} mm")
        if not self.levels:
            raise ValueError("levels is empty: give at least one count")
        if self.levels != "auto":
            try:
                _ = self.basis
            except InputError as error:
                raise ValueError(str(error)) from None
        return self

    @property
    def start_mm(self) -> tuple[float, float]:
        """Heights on the axis of the inner and the outer surface before the search."""
        inner = self.inner_offset_mm if self.fixed_inner is None else self.fixed_inner.apex_mm
        outer = self.outer_offset_mm if self.fixed_outer is None else self.fixed_outer.apex_mm
        assert inner is not None and outer is not None
        return inner, outer

    @property
    def fixed(self) -> tuple[Surface | None, Surface | None]:
        """The inner and the outer surface where they are fixed."""
        inner, outer = self.fixed_inner, self.fixed_outer
        return None if inner is None else inner.surface, None if outer is None else outer.surface

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines on fixed surfaces that a user should know of before the search."""
        named = (("fixed_inner", self.fixed_inner), ("fixed_outer", self.fixed_outer))
        return tuple(f"lens.{name}: {words}" for name, face in named if face is not None for words in face.warnings)

    @property
    def basis(self) -> SrbfBasis:
        """The functions that shape the free surfaces, of levels that are numbers; "auto" symmetry counts as none."""
        assert self.levels != "auto", "a search sets them"
        return SrbfBasis(self.levels, self.sigma_c, "none" if self.symmetry == "auto" else self.symmetry)
