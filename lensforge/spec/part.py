"""The part: the starting lens, what bounds it, and the shop that makes it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.errors import InputError
from lensforge.optics.materials import D_LINE_NM, MATERIALS, Material, by_abbe_number
from lensforge.spec.fixed import FixedSurface
from lensforge.spec.section import Millimetres, MillimetresOrZero, Section
from lensforge.surfaces.conic import Asphere
from lensforge.surfaces.srbf import SrbfBasis

_SAME_INDEX = 1e-9  # a lens.json holds the material and its index: they must be of one mind

DraftDegrees = Annotated[float, Field(ge=0.0, le=25.0)]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "rectangle", "square"]


class LensSection(Section):
    """The starting lens: two hemispheres of the given radii, and the SRBFs that will shape both.

    ``fixed_inner`` or ``fixed_outer`` takes the place of one hemisphere, and the search leaves that surface alone.
    ``symmetry`` "auto" is the largest mirror symmetry that source and target share; a lens's record has its name.

    The index comes from one of two: ``refractive_index`` is that of all light, and ``material`` then only a label; or
    ``material`` names a dispersive one of ``optics.materials``, whose index at ``design_wavelength_nm`` counts where a
    single number is needed, and for a source without wavelengths. ``abbe_number`` makes ``refractive_index`` the n_d
    of a dispersive material of one's own. ``absorption_per_mm`` (Beer-Lambert) counts in the stray-light pass of
    ``verify``; the design leaves it out.
    """

    refractive_index: Annotated[float, Field(ge=1.0, le=4.0)] = 1.4936
    material: str = "PMMA at 564 nm"
    abbe_number: Annotated[float, Field(ge=10.0, le=200.0)] | None = None
    design_wavelength_nm: Annotated[float, Field(ge=100.0, le=20_000.0)] = D_LINE_NM
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    levels: tuple[Annotated[int, Field(ge=1, le=100_000)], ...] = (9, 25, 81, 289)
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.75
    inner_offset_mm: Millimetres | None = None
    outer_offset_mm: Millimetres | None = None
    fixed_inner: FixedSurface | None = None
    fixed_outer: FixedSurface | None = None
    symmetry: Symmetry = "auto"

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
    def dispersion(self) -> Material | None:
        """The index against wavelength; None for a lens of one index."""
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
        return self

    @property
    def start_mm(self) -> tuple[float, float]:
        """Where the inner and the outer surface meet the axis before the search."""
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
        """The functions that shape the free surfaces; a symmetry that is not settled yet counts as none."""
        return SrbfBasis(self.levels, self.sigma_c, "none" if self.symmetry == "auto" else self.symmetry)


class ConstraintsSection(Section):
    """Feasible lenses, Eqs. (10) to (14): a paraboloid of height r_a and radius r_b stays inside the cavity.

    On request, what the shop needs: no hollow of a face is tighter than ``*_concave_radius_mm``, the ball that mills
    it, and each face leans at least ``*_draft_deg`` away from the axis, along which its mould opens.
    """

    cavity_height_mm: Millimetres
    cavity_radius_mm: Millimetres
    min_thickness_mm: MillimetresOrZero
    max_radius_mm: Millimetres
    inner_concave_radius_mm: Millimetres | None = None
    outer_concave_radius_mm: Millimetres | None = None
    inner_draft_deg: DraftDegrees | None = None
    outer_draft_deg: DraftDegrees | None = None

    @property
    def tolerance_mm(self) -> float:
        """A length that is this much outside of its limit counts as feasible: a micrometre for a lens of 14 mm."""
        return 7e-5 * self.max_radius_mm


class Tool(Section):
    """A ball mill: ball, a cylindrical shank of ``length_mm`` from the ball's centre, then the holder's cone."""

    name: Annotated[str, Field(min_length=1)]
    radius_mm: Millimetres
    shank_radius_mm: Millimetres
    length_mm: Millimetres
    holder_half_angle_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = 45.0


class ManufactureSection(Section):
    """What the shop has: the ball cutter of the paper by default, and any ``tools`` besides, shank and holder too.

    ``make``: the lens itself, or the mould inserts that are cut to its shape. ``max_tilt_deg``: how far a tool's axis
    may lean from the lens axis. ``stepover_mm`` and ``slope_limit_mrad``: passes, and the slope of their cusps.
    ``required``: a part that cannot be cut counts as a failure of the run.
    """

    cutter_radius_mm: Millimetres = 1.0
    tools: tuple[Tool, ...] = ()
    make: Literal["part", "insert"] = "part"
    required: bool = False
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=120.0)] = 90.0
    stepover_mm: Millimetres = 0.02
    slope_limit_mrad: Annotated[float, Field(gt=0.0, le=500.0)] = 1.0
