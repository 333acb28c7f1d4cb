"""The ``[lens]`` of a spec: the shape from which the search starts, and fixed surfaces."""

from math import degrees
from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from lensforge.errors import InputError
from lensforge.spec.fixed_surface import FixedSurface
from lensforge.spec.lens_material import LensMaterial
from lensforge.spec.spec_section import FilePath, Millimetres
from lensforge.surfaces.imported_face import lens_file
from lensforge.surfaces.srbf import MOST_FUNCTIONS, MOST_LEVELS, SrbfBasis, level_sigma
from lensforge.surfaces.surface import Surface

_FEW_FUNCTIONS = 25  # of the finest level: with fewer, each is wider than 28 degrees
_Numbers = Annotated[tuple[Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)], ...], Field(max_length=MOST_LEVELS)]
# chosen by its type, so that a wrong number is named, not both forms
Levels = Annotated[
    Annotated[Literal["auto"], Tag("word")] | Annotated[_Numbers, Tag("numbers")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "numbers"),
]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "rectangle", "square"]


class LensSection(LensMaterial):
    """The starting lens: two hemispheres, or a hemisphere and a fixed surface, and the SRBFs that will shape them."""

    levels: Levels = "auto"
    """Functions of each level, coarse to fine, that shape each free surface; "auto": as many as they gain."""
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.75
    """Factor of the width of every level's functions, Eq. (3)."""
    inner_offset_mm: Millimetres | None = None
    """Radius of the hemisphere from which the search of the inner surface starts."""
    outer_offset_mm: Millimetres | None = None
    """Radius of the hemisphere from which the search of the outer surface starts."""
    fixed_inner: FixedSurface | None = None
    """Inner surface that the search does not change, in place of ``inner_offset_mm``."""
    fixed_outer: FixedSurface | None = None
    """Outer surface that the search does not change, in place of ``outer_offset_mm``."""
    symmetry: Symmetry = "auto"
    """Mirror symmetry of both surfaces; "auto": the largest that source and target share, which the record of a lens
    names.
    """
    start: Annotated[FilePath, AfterValidator(lens_file)] | None = None
    """Result folder, or its lens.json, from whose lens the search goes on instead of from the hemispheres."""

    @model_validator(mode="after")
    def _each_surface_starts_once(self) -> "LensSection":
        for name, offset, fixed in (
            ("inner", self.inner_offset_mm, self.fixed_inner),
            ("outer", self.outer_offset_mm, self.fixed_outer),
        ):
            if offset is not None and fixed is not None:
                raise ValueError(f"give one of {name}_offset_mm, where the search starts, and [lens.fixed_{name}]")
        if self.fixed_inner is not None and self.fixed_outer is not None:
            raise ValueError("fixed_inner and fixed_outer: one of the surfaces must be free")
        return self

    @model_validator(mode="after")
    def _outer_outside_inner(self) -> "LensSection":
        inner, outer = self._apexes_mm
        if inner is not None and outer is not None and outer <= inner:
            name = "outer_offset_mm" if self.fixed_outer is None else "the vertex of fixed_outer"
            raise ValueError(f"{name} = {outer} must exceed where the inner surface meets the axis, {inner:g} mm")
        return self

    @model_validator(mode="after")
    def _levels_are_some(self) -> "LensSection":
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
        inner, outer = self._apexes_mm
        assert inner is not None and outer is not None, "a spec derives what is left out"
        return inner, outer

    @property
    def _apexes_mm(self) -> tuple[float | None, float | None]:
        inner = self.inner_offset_mm if self.fixed_inner is None else self.fixed_inner.apex_mm
        outer = self.outer_offset_mm if self.fixed_outer is None else self.fixed_outer.apex_mm
        return inner, outer

    @property
    def fixed(self) -> tuple[Surface | None, Surface | None]:
        """The inner and the outer surface where they are fixed."""
        inner, outer = self.fixed_inner, self.fixed_outer
        return None if inner is None else inner.surface, None if outer is None else outer.surface

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines on fixed surfaces and on levels that a user should know of before the search."""
        named = (("fixed_inner", self.fixed_inner), ("fixed_outer", self.fixed_outer))
        faces = tuple(f"lens.{name}: {words}" for name, face in named if face is not None for words in face.warnings)
        if self.levels == "auto" or max(self.levels) >= _FEW_FUNCTIONS:
            return faces
        return (
            *faces,
            f"lens.levels = {list(self.levels)}: the finest functions are "
            f"{degrees(level_sigma(max(self.levels), self.sigma_c)):.2g}° wide, and shape no more than a broad spot; "
            'try levels = "auto", or add finer levels, such as 81 and 289',
        )

    @property
    def basis(self) -> SrbfBasis:
        """The functions that shape the free surfaces, of levels that are numbers; "auto" symmetry counts as none."""
        assert self.levels != "auto", "a search sets them"
        return SrbfBasis(self.levels, self.sigma_c, "none" if self.symmetry == "auto" else self.symmetry)
