"""The ``[lens]`` of a spec: material, starting shape, and fixed surfaces."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from lensforge.errors import InputError
from lensforge.optics.materials import D_LINE_NM, MATERIALS, Material, by_abbe_number
from lensforge.optics.medium import Medium
from lensforge.spec.section import Coordinate, FilePath, Label, Millimetres, Section
from lensforge.surfaces.conic import Asphere
from lensforge.surfaces.srbf import MOST_FUNCTIONS, MOST_LEVELS, SrbfBasis

LENS_FILE = "lens.json"  # in a result folder
_SAME_INDEX = 1e-9  # tolerance between a material's index and the one stored beside it in a lens.json

_Numbers = Annotated[tuple[Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)], ...], Field(max_length=MOST_LEVELS)]
# chosen by its type, so that a wrong number is named, not both forms
Levels = Annotated[
    Annotated[Literal["auto"], Tag("word")] | Annotated[_Numbers, Tag("numbers")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "numbers"),
]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "rectangle", "square"]


_MERIDIAN = np.linspace(0.0, 0.5 * np.pi, 2001)  # angles (rad) from the axis to the horizon


def _directions(polar_rad: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    return np.stack([np.sin(polar_rad), np.zeros_like(polar_rad), np.cos(polar_rad)], axis=1)


class _Fixed(Section):
    @property
    def surface(self) -> Asphere:
        """Surface about the axis. Raises :class:`InputError` where it is not star-shaped about the origin."""
        raise NotImplementedError

    @property
    def apex_mm(self) -> float:
        """Height of its vertex on the axis."""
        return self.surface.vertex_mm

    def on_meridian_mm(self, polar_rad: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Distance (mm) from the origin at angles from the axis; the surface is the same all around."""
        return self.surface.radius(_directions(polar_rad))

    @property
    def largest_mm(self) -> float:
        """Largest distance from the origin, z = 0 and above."""
        return float(self.on_meridian_mm(_MERIDIAN).max())

    def clearance_mm(self, height_mm: float, radius_mm: float) -> float:
        """Least height above the paraboloid of that height and radius, Eq. (12); below 0 where it cuts in."""
        points = self.on_meridian_mm(_MERIDIAN)[:, None] * _directions(_MERIDIAN)
        return float((height_mm / radius_mm**2 * points[:, 0] ** 2 + points[:, 2] - height_mm).min())

    def least_draft_deg(self, polar_rad: Float[np.ndarray, " k"]) -> float:
        """Least draft (deg) along the axis: 90 degrees less the angle from the axis to the normal."""
        radius, slope = self.on_meridian_mm(polar_rad), self._slope_mm(polar_rad)
        rise = radius * np.cos(polar_rad) + slope * np.sin(polar_rad)
        return float(np.rad2deg(np.arcsin(rise / np.hypot(radius, slope))).min())

    def curvatures_per_mm(self, polar_rad: Float[np.ndarray, " k"]) -> tuple[float, float]:
        """Least and largest principal curvature (1/mm), along and across the meridian; positive where it bulges."""
        radius, slope = self.on_meridian_mm(polar_rad), self._slope_mm(polar_rad)
        length = np.hypot(radius, slope)
        along = (radius**2 + 2.0 * slope**2 - radius * np.gradient(slope, polar_rad, edge_order=2)) / length**3
        off_axis = np.maximum(np.sin(polar_rad), 1e-9)
        across = (radius * np.sin(polar_rad) - slope * np.cos(polar_rad)) / (radius * off_axis * length)
        both = np.concatenate([along, across[1:]])  # on the axis the two are equal
        return float(both.min()), float(both.max())

    def _slope_mm(self, polar_rad: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Derivative of the radius by the polar angle (mm/rad)."""
        down = np.stack([np.cos(polar_rad), np.zeros_like(polar_rad), -np.sin(polar_rad)], axis=1)
        slope: Float[np.ndarray, " k"] = np.sum(self.surface.gradient(_directions(polar_rad)) * down, axis=1)
        return slope

    @model_validator(mode="after")
    def _is_star_shaped(self) -> "_Fixed":
        try:
            _ = self.surface
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class FixedSphere(_Fixed):
    """Sphere with its centre on the axis; the origin, where the source is, must lie inside."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Millimetres
    centre_z_mm: Coordinate = 0.0

    @property
    def surface(self) -> Asphere:
        """Surface about the axis."""
        return _asphere(self.centre_z_mm + self.radius_mm, -self.radius_mm, 0.0, ())


class FixedAsphere(_Fixed):
    """Even asphere by the sag of ISO 10110-12: ``radius_mm`` at the vertex, below 0 for a dome over the source.

    ``coefficients``: A_4, A_6, A_8, ... in mm^-3, mm^-5, mm^-7, ...
    """

    kind: Literal["asphere"] = "asphere"
    vertex_z_mm: Millimetres
    radius_mm: Coordinate
    conic_constant: Annotated[float, Field(ge=-1e3, le=1e3)] = 0.0
    coefficients: Annotated[tuple[Coordinate, ...], Field(max_length=10)] = ()

    @property
    def surface(self) -> Asphere:
        """Surface about the axis."""
        return _asphere(self.vertex_z_mm, self.radius_mm, self.conic_constant, self.coefficients)


_asphere = lru_cache(maxsize=16)(Asphere)  # a spec asks for its surfaces many times; their profile takes 0.1 s


FixedSurface = Annotated[FixedSphere | FixedAsphere, Field(discriminator="kind")]


def _lens_file(path: Path) -> Path:
    """The file of the lens in a result folder, or ``path`` itself."""
    return path / LENS_FILE if path.is_dir() else path


class LensSection(Section):
    """The starting lens: two hemispheres of the given radii, and the SRBFs that will shape both.

    ``fixed_inner`` or ``fixed_outer`` replaces one hemisphere, and the search does not change that surface.
    ``symmetry`` "auto" is the largest mirror symmetry that source and target share; the record of a lens names it.
    ``start``: a result folder, or its lens.json: the search goes on from that lens instead of from the hemispheres.

    Either ``refractive_index`` holds for all wavelengths, and ``material`` is only a label; or ``material`` names a
    dispersive one of ``optics.materials``, whose index at ``design_wavelength_nm`` is used where a single number is
    needed, and for a source without wavelengths. ``abbe_number`` makes ``refractive_index`` the n_d of a dispersive
    material of one's own. ``absorption_per_mm`` (Beer and Lambert) dims every ray on its way through the body;
    ``density_g_per_cm3``, of the grade that is ordered, gives the part its mass.
    """

    refractive_index: Annotated[float, Field(ge=1.0, le=4.0)] = 1.4936
    material: Label = "PMMA at 564 nm"
    abbe_number: Annotated[float, Field(ge=10.0, le=200.0)] | None = None
    design_wavelength_nm: Annotated[float, Field(ge=100.0, le=20_000.0)] = D_LINE_NM
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    density_g_per_cm3: Annotated[float, Field(ge=0.1, le=30.0)] | None = None
    levels: Levels = "auto"
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.75
    inner_offset_mm: Millimetres | None = None
    outer_offset_mm: Millimetres | None = None
    fixed_inner: FixedSurface | None = None
    fixed_outer: FixedSurface | None = None
    symmetry: Symmetry = "auto"
    start: Annotated[FilePath, AfterValidator(_lens_file)] | None = None

    @model_validator(mode="after")
    def _one_source_of_the_index(self) -> "LensSection":
        given = self.model_fields_set
        known = MATERIALS.get(self.material)
        if known is None:
            if "material" in given and "refractive_index" not in given:
                raise ValueError(
                    f"material = {self.material!r}: one of {', '.join(MATERIALS)}, or add refractive_index"
                )
            if self.abbe_number is not None and "refractive_index" not in given:
                raise ValueError("abbe_number needs refractive_index, the n_d of the same material")
            if "design_wavelength_nm" in given and self.design_wavelength_nm != D_LINE_NM:
                raise ValueError(f"design_wavelength_nm goes with a material of {', '.join(MATERIALS)}")
            return self
        if self.abbe_number is not None:
            raise ValueError(f"abbe_number: {self.material} has its own dispersion; leave out one of the two")
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

    @property
    def medium(self) -> Medium:
        """The body at the design wavelength: refractive index and absorption."""
        return Medium(self.refractive_index, self.absorption_per_mm)

    @property
    def dispersion(self) -> Material | None:
        """Index against wavelength; None for a lens of one index."""
        if self.abbe_number is not None:
            return by_abbe_number(self.refractive_index, self.abbe_number, self.material)
        return MATERIALS.get(self.material)

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
    def fixed(self) -> tuple[Asphere | None, Asphere | None]:
        """The inner and the outer surface where they are fixed."""
        inner, outer = self.fixed_inner, self.fixed_outer
        return None if inner is None else inner.surface, None if outer is None else outer.surface

    @property
    def basis(self) -> SrbfBasis:
        """The functions that shape the free surfaces, of levels that are numbers; "auto" symmetry counts as none."""
        assert self.levels != "auto", "a search sets them"
        return SrbfBasis(self.levels, self.sigma_c, "none" if self.symmetry == "auto" else self.symmetry)
