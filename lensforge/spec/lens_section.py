"""The ``[lens]`` of a spec by its kind: material, faces, and the functions that shape the free ones."""

from dataclasses import replace
from math import degrees, hypot, sqrt
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from lensforge.errors import InputError
from lensforge.optics.exit_space import ExitBall, ExitColumn, ExitSpace
from lensforge.optics.media import FLANGE, MOST_EVENTS, OUTSIDE, FaceCoating, Media, Mirror
from lensforge.spec.face_section import LensFaces, ReflectorFaces, TirFaces
from lensforge.spec.lens_material import LensMaterial
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import FilePath, Label, check
from lensforge.surfaces.imported_face import lens_file
from lensforge.surfaces.profile import LEAST_COEFFICIENTS
from lensforge.surfaces.reflector_cup import mouth_radius_mm
from lensforge.surfaces.srbf import MOST_FUNCTIONS, MOST_LEVELS, SrbfBasis, level_sigma

USUAL_KIND = "double"  # of a lens that names none
_OF_ERRORS = (9,)  # functions of form errors as wide as astigmatism and coma
_FEW_FUNCTIONS = 25  # of the finest level: with fewer, each is wider than 28 degrees
_Numbers = Annotated[tuple[Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)], ...], Field(max_length=MOST_LEVELS)]
# chosen by its type, so that a wrong number is named, not both forms
Levels = Annotated[
    Annotated[Literal["auto"], Tag("word")] | Annotated[_Numbers, Tag("numbers")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "numbers"),
]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "diagonal", "rectangle", "square"]


def _kind_of_lens(value: Any) -> str | None:
    """The kind of a lens; the usual kind where none is named."""
    kind = value.get("kind", USUAL_KIND) if isinstance(value, dict) else getattr(value, "kind", USUAL_KIND)
    return str(kind) if isinstance(kind, str) else None


class LensShape(LensMaterial):
    """Material of a lens of any kind, and the SRBFs that will shape the faces that are free.

    ``title``: words for a lens of its kind. ``may_be_round``: it has a shape without any level, faces of revolution.
    ``reflects``: its wall or cup turns light by any angle, and at no loss. ``has_creases``: several faces lie side by
    side, and meet in creases; there it is widest and highest. ``radius_about_axis``: its radius is its distance from
    the axis, not from the LED: its exit or mouth is flat, and it lies in a cylinder.
    """

    title: ClassVar[str] = ""
    may_be_round: ClassVar[bool] = False
    reflects: ClassVar[bool] = False
    has_creases: ClassVar[bool] = False
    radius_about_axis: ClassVar[bool] = False
    kind: str
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

    @check
    def _levels_are_some(self) -> None:
        if not (self.levels or self.may_be_round):
            raise ValueError("levels is empty: give at least one count")
        if self.levels and self.levels != "auto":
            try:
                _ = self.basis
            except InputError as error:
                raise ValueError(str(error)) from None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines on fixed surfaces and on levels that a user should know of before the search."""
        fixed = {name: face.fixed for name, face in self.faces.items() if face.fixed is not None}
        faces = tuple(f"lens.{name}.fixed: {words}" for name, face in fixed.items() for words in face.warnings)
        if self.levels == "auto" or not self.levels or max(self.levels) >= _FEW_FUNCTIONS:
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
        return SrbfBasis(self.levels, self.sigma_c, self._own_symmetry)

    @property
    def is_round(self) -> bool:
        """True where all faces are of revolution."""
        return False

    def exit_space(self, limits: ConstraintsSection) -> ExitSpace:
        """The space that all light leaves of any lens of its kind within ``limits``."""
        return ExitBall(limits.max_radius_mm)

    def height_mm(self, limits: ConstraintsSection) -> float:
        """Height that the largest lens is taken to have: that of its limits, or as much as its radius."""
        return limits.max_radius_mm if limits.max_height_mm is None else limits.max_height_mm

    def extent_mm(self, limits: ConstraintsSection, rise: float | None = None) -> float:
        """Distance from the origin up to which the largest lens is taken to reach: towards a plane, or anywhere.

        ``rise``: cosine of the plane's normal to the axis.
        """
        radius_mm, height_mm = limits.max_radius_mm, self.height_mm(limits)
        if not self.radius_about_axis:
            return radius_mm
        if rise is None:
            return hypot(radius_mm, height_mm)
        return radius_mm * sqrt(max(1.0 - rise**2, 0.0)) + height_mm * max(rise, 0.0)

    @property
    def shape_levels(self) -> tuple[int, ...]:
        """Parameters of a free face, coarse first: the functions of its levels, which are numbers."""
        return self.basis.levels

    @property
    def _own_symmetry(self) -> str:
        return "none" if self.symmetry == "auto" else self.symmetry


class LensSection(LensShape, LensFaces):
    """The usual lens: an inner face towards the source, an outer one towards the target, a refraction at each."""

    title = "double-freeform lens"
    kind: Literal["double"] = "double"


class ProfiledShape(LensShape):
    """A lens of faces of revolution, which meet in creases; with ``levels`` SRBFs shape them beyond that."""

    may_be_round = reflects = has_creases = radius_about_axis = True

    levels: _Numbers = ()
    """Functions of each level, coarse to fine, that shape the free faces beyond their profiles; none: faces of
    revolution.
    """
    profile: Annotated[int, Field(ge=LEAST_COEFFICIENTS, le=64)] = 12
    """Coefficients of the profile of each free face."""
    events: Annotated[int, Field(ge=3, le=MOST_EVENTS)] = 6
    """Largest number of faces that a ray meets; what goes on then is counted as its own fate."""

    @property
    def is_round(self) -> bool:
        """True without levels, and without faces that are given."""
        return not self.levels and all(face.fixed is None for face in self.faces.values())

    def exit_space(self, limits: ConstraintsSection) -> ExitSpace:
        """The cylinder in which the lens lies: light leaves by its wall, too."""
        return ExitColumn(limits.max_radius_mm, ((0.0, limits.tallest_mm),))

    @property
    def shape_levels(self) -> tuple[int, ...]:
        """Parameters of a free face, coarse first: those of its profile, and the functions of its levels."""
        return (self.profile, *self.levels)

    @property
    def basis(self) -> SrbfBasis:
        """The functions of its levels; of faces of revolution those of their form errors."""
        return super().basis if self.levels else SrbfBasis(_OF_ERRORS, self.sigma_c, self._own_symmetry)


class TirSection(ProfiledShape, TirFaces):
    """A lens for total internal reflection: cap and side of the cavity, the reflecting wall, and the exit.

    Faces begin as the lens for a point source that the size of the LED, the radius and the beam ask for. They are faces
    of revolution; with ``levels`` SRBFs shape cap, wall and exit beyond that.
    """

    title = "lens for total internal reflection"
    kind: Literal["tir"]

    @property
    def media(self) -> Media:
        """The media of any lens; a flange takes all light that meets it."""
        media = super().media
        if self.flange is None:
            return media
        return replace(media, coatings=(*media.coatings, FaceCoating(FLANGE, OUTSIDE, Mirror(0.0))))


class ReflectorSection(ProfiledShape, ReflectorFaces):
    """A reflector: a cup about the source, whose inside is a mirror, open at its mouth.

    Light leaves by the mouth, directly or by reflections at the cup. The cup begins as the paraboloid that the size of
    the LED, the radius and the beam ask for, or is given; its back follows it at the least wall.
    """

    title, is_opaque = "reflector", True
    kind: Literal["reflector"]
    material: Label = "metallised plastic"
    """Material of the body, a label: no light enters it."""

    def exit_space(self, limits: ConstraintsSection) -> ExitSpace:
        """The disc of its mouth: as wide and as high as a given cup makes it, else at any height that is allowed."""
        cup, height_mm = self.fixed["cup"], self.mouth.offset_mm
        if cup is None or height_mm is None:
            return ExitColumn.of_mouth(limits.max_radius_mm, limits.tallest_mm)
        return ExitColumn(mouth_radius_mm(cup, height_mm), ((height_mm, height_mm),), upward=True)

    def height_mm(self, limits: ConstraintsSection) -> float:
        """Height of the mouth of a given cup, where it is given, too."""
        given = self.cup.fixed is not None and self.mouth.offset_mm
        return given or super().height_mm(limits)

    @check
    def _is_open(self) -> None:
        if self.cavity_index != self.outside_index:
            raise ValueError(
                f"cavity_index = {self.cavity_index:g}: a reflector is open, and has outside_index = "
                f"{self.outside_index:g} inside, too; give the same for both"
            )


AnyLens = Annotated[
    Annotated[LensSection, Tag("double")]
    | Annotated[TirSection, Tag("tir")]
    | Annotated[ReflectorSection, Tag("reflector")],
    Discriminator(_kind_of_lens),
]
