"""The ``[lens]`` of a spec: material, faces, and the functions that shape the free ones."""

from math import degrees
from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from lensforge.errors import InputError
from lensforge.spec.lens_material import LensMaterial
from lensforge.spec.spec_section import FilePath
from lensforge.surfaces.imported_face import lens_file
from lensforge.surfaces.srbf import MOST_FUNCTIONS, MOST_LEVELS, SrbfBasis, level_sigma

_FEW_FUNCTIONS = 25  # of the finest level: with fewer, each is wider than 28 degrees
_Numbers = Annotated[tuple[Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)], ...], Field(max_length=MOST_LEVELS)]
# chosen by its type, so that a wrong number is named, not both forms
Levels = Annotated[
    Annotated[Literal["auto"], Tag("word")] | Annotated[_Numbers, Tag("numbers")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "numbers"),
]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "rectangle", "square"]


class LensSection(LensMaterial):
    """The starting lens: its material, its faces, and the SRBFs that will shape those that are free."""

    levels: Levels = "auto"
    """Functions of each level, coarse to fine, that shape each free surface; "auto": as many as they gain."""
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.75
    """Factor of the width of every level's functions, Eq. (3)."""
    symmetry: Symmetry = "auto"
    """Mirror symmetry of both surfaces; "auto": the largest that source and target share, which the record of a lens
    names.
    """
    start: Annotated[FilePath, AfterValidator(lens_file)] | None = None
    """Result folder, or its lens.json, from whose lens the search goes on instead of from the hemispheres."""

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
    def warnings(self) -> tuple[str, ...]:
        """Lines on fixed surfaces and on levels that a user should know of before the search."""
        fixed = {name: face.fixed for name, face in self.faces.items() if face.fixed is not None}
        faces = tuple(f"lens.{name}.fixed: {words}" for name, face in fixed.items() for words in face.warnings)
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
