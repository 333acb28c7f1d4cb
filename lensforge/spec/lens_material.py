"""The material of a ``[lens]`` and what surrounds it: index, absorption, coatings, and change with temperature.

The ``[lens.optical_data]`` are index and absorption of a custom material, by formula or by table.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, ValidationInfo, model_serializer, model_validator

from lensforge.optics.face_roles import BODY, CAVITY, DRAWN_END, OUTSIDE, RIM_FLANGE
from lensforge.optics.material import (
    D_LINE_NM,
    HIGHEST_C,
    HUGE,
    LOWEST_C,
    MATERIALS,
    MOST_COEFFICIENTS,
    REFERENCE_C,
    UNKNOWN,
    Absorption,
    AgainstVacuum,
    Dispersion,
    Formula,
    IndexTable,
    Material,
    TemperatureLaw,
    by_abbe_number,
)
from lensforge.optics.material_files import read_material
from lensforge.optics.media import FaceCoating, FaceScatter, Media, Medium, Mirror
from lensforge.optics.scattering import FacetTurn
from lensforge.public import public
from lensforge.spec.coating_section import CoverGlassSection
from lensforge.spec.face_section import FacesSection
from lensforge.spec.spec_files import full_path
from lensforge.spec.spec_section import FilePath, Label, Section, check, fault_of

_Wavelength = Annotated[float, Field(ge=100.0, le=20_000.0)]
_MOST_ROWS = 10_000  # of tables: 0.1 nm over the visible range and more
_Wavelengths = Annotated[tuple[_Wavelength, ...], Field(max_length=_MOST_ROWS)]
_Coefficient = Annotated[float, Field(ge=-HUGE, le=HUGE)]
_Schott = Annotated[float, Field(ge=-1e3, le=1e3)]  # the largest is the wavelength of the pole, in um
Celsius = Annotated[float, Field(ge=LOWEST_C, le=HIGHEST_C)]
Expansion = Annotated[float, Field(ge=-1e-4, le=1e-3)]  # 1/K; silicones have 3e-4
_LEAST_INDEX = 1.0
_LARGEST_INDEX = 4.0
_OF_CHANGE = {  # fields that state a change with temperature
    "index_per_k": "lens.index_per_k (1/K, of a data sheet: about -1e-4 for plastics, -4e-4 for silicones)",
    "expansion_per_k": "lens.expansion_per_k (1/K: about 7e-5 for plastics, 3e-4 for silicones, 7e-6 for glasses)",
}
_CHECKED = 400  # wavelengths of the range at which a formula is tried


@public
class OpticalData(Section):
    """Index of a material: ``formula`` with ``coefficients``, or ``refractive_index`` at ``wavelength_nm``."""

    source: Label = Field(default="", description="Origin of the numbers, in words.")
    formula: Annotated[str, Field(max_length=40)] | None = Field(
        default=None,
        description='Name of a dispersion formula, such as "sellmeier" (pairs b, c in um^2: n^2 - 1 = sum b w^2 / '
        '(w^2 - c)) or "cauchy" (n = a + b / w^2 + ...), wavelength w in um.',
    )
    coefficients: Annotated[tuple[_Coefficient, ...], Field(max_length=MOST_COEFFICIENTS)] = Field(
        default=(), description="Coefficients of the formula."
    )
    range_nm: tuple[_Wavelength, _Wavelength] | None = Field(
        default=None, description="Wavelengths over which the formula holds."
    )
    wavelength_nm: _Wavelengths = Field(
        default=(), description="Wavelengths of a table of the index, rising; between them it is linear."
    )
    refractive_index: Annotated[tuple[float, ...], Field(max_length=_MOST_ROWS)] = Field(
        default=(), description="Index at each of these wavelengths."
    )
    absolute: bool = Field(
        default=False, description="True where the index is that against vacuum: it is divided by that of air at 20 °C."
    )
    absorption_nm: _Wavelengths = Field(
        default=(), description="Wavelengths of a table of the absorption, rising; without it the material is clear."
    )
    absorption_per_mm: Annotated[
        tuple[Annotated[float, Field(ge=0.0, le=100.0)], ...], Field(max_length=_MOST_ROWS)
    ] = Field(default=(), description="Absorption at each of these wavelengths.")

    schott_coefficients: tuple[_Schott, _Schott, _Schott, _Schott, _Schott, _Schott] | None = Field(
        default=None, description="Coefficients [D0, D1, D2, E0, E1, pole] of the index against temperature (SCHOTT)."
    )
    reference_temperature_c: Celsius = Field(
        default=REFERENCE_C, description="Temperature at which the index is the one above."
    )
    expansion_per_k: Expansion | None = Field(
        default=None, description="Linear expansion of every length with temperature."
    )

    @check
    def _usable(self) -> None:
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
        tried = np.linspace(low, high, _CHECKED)
        with fault_of():
            indices = self._dispersion.index(tried)
        wrong = ~((indices >= _LEAST_INDEX) & (indices <= _LARGEST_INDEX))
        if wrong.any():
            raise ValueError(
                f"its index at {tried[wrong][0]:.4g} nm is {indices[wrong][0]:.4g}, must be {_LEAST_INDEX:g} to "
                f"{_LARGEST_INDEX:g}; the formulas take wavelengths in um"
            )

    @property
    def _span(self) -> tuple[float, float]:
        if self.range_nm is not None:
            return self.range_nm
        return self.wavelength_nm[0], self.wavelength_nm[-1]

    @property
    def _dispersion(self) -> Dispersion:
        table = IndexTable(self.wavelength_nm, self.refractive_index)
        stated = table if self.formula is None else Formula(self.formula, self.coefficients)
        return AgainstVacuum(stated) if self.absolute else stated

    def material(self, name: str) -> Material:
        """The material of these numbers."""
        absorption = Absorption(self.absorption_nm, self.absorption_per_mm) if self.absorption_nm else None
        law = TemperatureLaw(
            self.reference_temperature_c, self.schott_coefficients or (), expansion_per_k=self.expansion_per_k
        )
        return Material(name, self._dispersion, self._span, self.source or "the spec", None, absorption, law)


@public
class OfMaterial(Section):
    """A section that may name the file of its material, whose data it has in place of that file: it needs it no more.

    Raises ``ValueError`` for a file that cannot be read, or where both are given.
    """

    @model_validator(mode="before")
    @classmethod
    def _data_of_the_file(cls, content: Any, info: ValidationInfo) -> Any:
        if not isinstance(content, dict) or not isinstance(content.get("material_file"), str | Path):
            return content
        if content.get("optical_data") is not None:
            raise ValueError("material_file: material_file and optical_data: give one of the two")
        with fault_of("material_file"):
            material = read_material(full_path(Path(content["material_file"]), info), content.get("material"))
        rest = {key: value for key, value in content.items() if key != "material_file"}
        return rest | {"material": material.name, "optical_data": _fields(material)}


def _fields(material: Material) -> dict[str, Any]:
    """Fields of :class:`OpticalData`, plain, as a file would have them."""
    fields: dict[str, Any] = {"source": material.source}
    index = material.dispersion
    if isinstance(index, AgainstVacuum):
        index = index.absolute
        fields["absolute"] = True
    match index:
        case Formula(name, coefficients):
            fields |= {"formula": name, "coefficients": list(coefficients), "range_nm": list(material.range_nm)}
        case IndexTable(waves, indices):
            fields |= {"wavelength_nm": list(waves), "refractive_index": list(indices)}
    if material.absorption is not None:
        fields["absorption_nm"] = list(material.absorption.wavelengths_nm)
        fields["absorption_per_mm"] = list(material.absorption.per_mm)
    law = material.temperature
    if law.reference_c != REFERENCE_C:
        fields["reference_temperature_c"] = law.reference_c
    if law.schott:
        fields["schott_coefficients"] = list(law.schott)
    if law.expansion_per_k is not None:
        fields["expansion_per_k"] = law.expansion_per_k
    return fields


@dataclass(frozen=True)
class Density:
    """A density (g/cm^3), and where it is from."""

    g_per_cm3: float
    source: str


_PUBLISHED = {  # densities by source: grades of one plastic differ by 2 %, of silicone by more, so that it has none
    "comparison of plastics in the data sheet of OKP4, Osaka Gas Chemicals": {
        "PMMA": 1.19,
        "PC": 1.2,
        "COP": 1.01,
        "polyester": 1.22,
    },
    "Apollo Optical Systems, optical polymers": {"PS": 1.05, "COC": 1.02},
    "SCHOTT data sheet": {"N-BK7": 2.51, "B270": 2.56, "borosilicate 3.3": 2.23},
    "Corning HPFS 7980 data sheet": {"fused silica": 2.2},
}
DENSITIES = {name: Density(density, source) for source, table in _PUBLISHED.items() for name, density in table.items()}

# Wavelengths of any light.
_SHORTEST_NM = 1.0
_LONGEST_NM = 1e7
_SAME_INDEX = 1e-9  # tolerance between a material's index and the one stored beside it in a lens.json

_Index = Annotated[float, Field(ge=1.0, le=4.0)]


@public
class LensMaterial(OfMaterial, FacesSection):
    """Material of the body, and what lies on its faces and around it.

    Either ``refractive_index`` holds for all wavelengths; or the material is dispersive: a ``material`` of
    ``optics.material.MATERIALS``, one with ``optical_data`` or a ``material_file``, or one with ``abbe_number``.
    """

    refractive_index: _Index = Field(
        default=1.4936,
        description="Index at all wavelengths, `material` being only a label, no name of the catalogue; or leave "
        "it out for a dispersive material.",
    )
    material: Label = Field(
        default="PMMA at 564 nm",
        description="Name in the catalogue, which is dispersive; beside `refractive_index` or other data only a label.",
    )
    material_file: FilePath | None = Field(
        default=None,
        description="A Zemax catalogue, of which `material` names the glass, a file of refractiveindex.info, or a "
        "table; read into `optical_data` as the spec is.",
    )
    optical_data: OpticalData | None = Field(default=None, description="Index and absorption of a custom material.")
    abbe_number: Annotated[float, Field(ge=10.0, le=200.0)] | None = Field(
        default=None, description="Abbe number of a material whose n_d is `refractive_index`: makes it dispersive."
    )
    cavity_index: _Index = Field(
        default=1.0, description="Index of what fills the cavity, such as a gel that couples the LED to the lens."
    )
    outside_index: _Index = Field(default=1.0, description="Index of what surrounds the lens, such as water.")
    cover_glass: CoverGlassSection | None = Field(default=None, description="Plate in front of the lens.")
    design_wavelength_nm: Annotated[float, Field(ge=100.0, le=20_000.0)] = Field(
        default=D_LINE_NM,
        description="Wavelength of the index where a single number is needed, and for a source without wavelengths.",
    )
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=0.0, description="Absorption of the body (Beer and Lambert), if the material itself states none."
    )
    density_g_per_cm3: Annotated[float, Field(ge=0.1, le=30.0)] | None = Field(
        default=None,
        description="Density of the grade that is ordered, which gives the part its mass; left out, that of the "
        "plastic or glass that `material` names, if it is known.",
    )
    index_per_k: Annotated[float, Field(ge=-1e-3, le=1e-3)] | None = Field(
        default=None,
        description="Change of the index relative to air with temperature, for a material that does not state its own.",
    )
    expansion_per_k: Expansion | None = Field(
        default=None, description="Linear expansion with temperature, for a material that does not state its own."
    )
    reference_temperature_c: Celsius | None = Field(
        default=None,
        description="Temperature at which the lens has its index and its size; by default 20, or as the material "
        "states.",
    )
    temperature_c: Celsius | None = Field(
        default=None,
        description="Temperature at which the lens is at work, with the index and the size that it has there; by "
        "default that of reference, which is that of all files and drawings.",
    )

    @model_serializer(mode="wrap")
    def _as_before_temperatures(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        """The section without an empty temperature: specs without one keep the hash that they had before."""
        return {name: value for name, value in write(self).items() if name != "temperature_c" or value is not None}

    @check
    def _one_source_of_the_index(self) -> None:
        given = self.model_fields_set
        if self.is_opaque:
            return
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
            return
        if self.abbe_number is not None:
            raise ValueError(f"abbe_number: {self.material} has its own dispersion; leave out one of the two")
        if self.absorption_per_mm > 0.0 and known.absorption is not None:
            raise ValueError(f"absorption_per_mm: {self.material} has its own absorption; leave out one of the two")
        with fault_of("design_wavelength_nm"):
            index = known.index_at(self.design_wavelength_nm)
        if "refractive_index" in given and abs(self.refractive_index - index) > _SAME_INDEX:
            raise ValueError(
                f"refractive_index = {self.refractive_index:g}, but {self.material} has {index:.6g} at "
                f"{self.design_wavelength_nm:g} nm; leave out refractive_index, or name the material otherwise"
            )
        object.__setattr__(self, "refractive_index", index)

    @check
    def _one_source_of_the_change_with_temperature(self) -> None:
        known = UNKNOWN if self.dispersion is None else self.dispersion.temperature
        for name, value in (
            ("index_per_k", known.knows_index),
            ("reference_temperature_c", known.knows_index),
            ("expansion_per_k", known.expansion_per_k is not None),
        ):
            if value and getattr(self, name) is not None:
                raise ValueError(f"{name}: {self.material} has its own; leave it out, or name the material otherwise")

    @check
    def _is_known_at_work(self) -> None:
        celsius = self.at_work_c
        if celsius is None:
            return
        law = self.temperature_law
        known = {"index_per_k": law.knows_index, "expansion_per_k": law.expansion_per_k is not None}
        missing = [description for name, description in _OF_CHANGE.items() if not known[name]]
        if missing:
            raise ValueError(
                f"temperature_c = {celsius:g}: nothing is known of how {self.material} changes with it; "
                f"give {' and '.join(missing)}"
            )
        indices = np.array([self._index_at(celsius)])
        dispersion = self._dispersion_at(celsius)
        if dispersion is not None:
            indices = np.append(indices, dispersion.index(np.linspace(*dispersion.range_nm, _CHECKED)))
        wrong = indices[~((indices >= _LEAST_INDEX) & (indices <= _LARGEST_INDEX))]
        if len(wrong):
            raise ValueError(
                f"temperature_c = {celsius:g}: the index of {self.material} would be {wrong[0]:.4g}, "
                f"must be {_LEAST_INDEX:g} to {_LARGEST_INDEX:g}; correct its change per kelvin"
            )

    @property
    def at_work_c(self) -> float | None:
        """Temperature (Celsius) at which the lens is at work; None for that of reference."""
        return None if self.temperature_c == self.temperature_law.reference_c else self.temperature_c

    def at(self, celsius: float) -> Self:
        """The section at work at ``celsius``. Raises ``ValueError`` where its change with temperature is not known."""
        warm = self.changed(temperature_c=celsius)
        warm._is_known_at_work()
        return warm

    @property
    def temperature_warnings(self) -> tuple[str, ...]:
        """One line where its index at work is extrapolated."""
        celsius = self.at_work_c
        return () if celsius is None else self.temperature_law.warnings(celsius)

    @property
    def scale(self) -> float:
        """Factor of every length of the lens at work."""
        celsius = self.at_work_c
        return 1.0 if celsius is None else self.temperature_law.scale(celsius)

    def warmed_by(self, kelvin: float) -> tuple[float, float]:
        """Change of the index, and factor of every length, by ``kelvin`` above the temperature at which it is at work.

        Raises ``ValueError`` where its change with temperature is not known.
        """
        if kelvin == 0.0:
            return 0.0, 1.0
        celsius = self.temperature_law.reference_c if self.temperature_c is None else self.temperature_c
        warm = self.at(celsius + kelvin)
        change = 0.0 if self.is_opaque else self._index_at(celsius + kelvin) - self._index_at(celsius)
        return change, warm.scale / self.scale

    def _index_at(self, celsius: float) -> float:
        """Index of the body at the design wavelength and a temperature."""
        cold = np.array([self.refractive_index])
        wave = np.array([self.design_wavelength_nm])
        return float(self.temperature_law.index(cold, wave, celsius)[0])

    def _dispersion_at(self, celsius: float) -> Material | None:
        """Index of the body against wavelength at a temperature."""
        return None if self.dispersion is None else self.dispersion.at(self.temperature_law, celsius)

    @property
    def temperature_law(self) -> TemperatureLaw:
        """Change of index and size with temperature: that of the material, and the constants of the spec."""
        known = UNKNOWN if self.dispersion is None else self.dispersion.temperature
        expansion = self.expansion_per_k
        reference_c = self.reference_temperature_c
        return replace(
            known,
            reference_c=known.reference_c if reference_c is None else reference_c,
            index_per_k=self.index_per_k,
            expansion_per_k=known.expansion_per_k if expansion is None else expansion,
        )

    @check
    def _glass_is_denser(self) -> None:
        glass = self.cover_glass
        if glass is not None and glass.refractive_index < self.outside_index:
            raise ValueError(
                f"cover_glass.refractive_index = {glass.refractive_index:g}: must be outside_index = "
                f"{self.outside_index:g} at least, or it would reflect oblique light totally"
            )

    @property
    def density(self) -> Density | None:
        """Density of the body: that of the spec, or of the material that its label begins with; None if unknown."""
        if self.density_g_per_cm3 is not None:
            return Density(self.density_g_per_cm3, "the spec")
        first_word, _, _ = self.material.partition(" ")
        return DENSITIES.get(self.material) or DENSITIES.get(first_word)

    @property
    def media(self) -> Media:
        """The body, what fills the cavity and surrounds the lens, and the coatings of its faces."""
        material = self._material
        absorption = self.absorption_per_mm
        if material is not None:
            absorption = material.absorption_at(self.design_wavelength_nm, absorption)
        glass = None if self.cover_glass is None else self.cover_glass.glass
        body = material or self.refractive_index
        coatings = []
        for name, face in self.faces.items():
            around = self.role(name).around
            if face.mirror is not None:
                coatings.append(FaceCoating(name, around, Mirror(face.mirror)))
            elif face.coating is not None:
                coatings.append(FaceCoating(name, around, face.coating.coating(body)))
        if self.rim_flange is not None:  # it takes all light that meets it
            coatings.append(FaceCoating(RIM_FLANGE.name, RIM_FLANGE.around, Mirror(0.0)))
        roles = self.body_roles
        if self.drawn_mm is not None:  # what holds its ends takes the light there
            coatings.append(FaceCoating(DRAWN_END.name, DRAWN_END.around, Mirror(0.0)))
            roles += (DRAWN_END,)
        medium = Medium(self.refractive_index, absorption, self.dispersion)
        celsius = self.at_work_c
        if celsius is not None:
            medium = Medium(self._index_at(celsius), absorption, self._dispersion_at(celsius))
        return Media(
            medium,
            self.cavity_index,
            self.outside_index,
            glass,
            tuple(coatings),
            wavelength_nm=self.design_wavelength_nm,
            faces=roles,
            scatter=tuple(self._scatter),
        )

    @property
    def _scatter(self) -> Iterator[FaceScatter]:
        """Scatter of each face that is not polished. Raises ``ValueError`` for what no facets do."""
        indices = {CAVITY: self.cavity_index, OUTSIDE: self.outside_index}
        for name, face in self.faces.items():
            if face.scatter is not None:
                role = self.role(name)
                ratio = self.refractive_index / indices[role.around]
                turn = FacetTurn(None if face.mirror is not None else ratio if role.before == BODY else 1.0 / ratio)
                with fault_of(f"{name}.scatter"):
                    model = face.scatter.model(turn)
                yield FaceScatter(name, model)

    @check
    def _faces_can_scatter_so(self) -> None:
        tuple(self._scatter)

    @property
    def _chromatic(self) -> bool:
        coatings = [face.coating for face in self.faces.values()]
        glass = None if self.cover_glass is None else self.cover_glass.coating
        return any(coating is not None and coating.chromatic for coating in (*coatings, glass))

    @property
    def _own_or_catalogued(self) -> Material | None:
        """The material of the spec's own data, or of the catalogue by its name; None of an opaque body."""
        if self.is_opaque:
            return None
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
        if self.abbe_number is not None and not self.is_opaque:
            return by_abbe_number(self.refractive_index, self.abbe_number, self.material)
        return self._own_or_catalogued
