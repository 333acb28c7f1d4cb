"""The ``[lens]`` of a spec: what all kinds of it share, and those whose faces are shaped by profiles."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, hypot, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, Discriminator, Field, Tag

from lensforge.errors import InputError
from lensforge.optics.exit_space import ExitBall, ExitColumn, ExitSpace
from lensforge.optics.face_roles import BODY, MOST_EVENTS
from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.derived_values import LensSizes
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.lens_material import LensMaterial
from lensforge.spec.processes import Process
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import FilePath, check, fault_of
from lensforge.surfaces.imported_face import lens_file
from lensforge.surfaces.profile import LEAST_COEFFICIENTS
from lensforge.surfaces.srbf import MOST_FUNCTIONS, MOST_LEVELS, SrbfBasis, level_sigma
from lensforge.surfaces.surface import Surface

_OF_ERRORS = (9,)  # functions of form errors as wide as astigmatism and coma
_FIRST_LEVELS = (25, 81)  # of a new lens beyond its profiles, as of the shipped ones
_FEW_FUNCTIONS = 25  # of the finest level: with fewer, each is wider than 28 degrees
_Numbers = Annotated[tuple[Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)], ...], Field(max_length=MOST_LEVELS)]
# chosen by its type, so that a wrong number is named, not both forms
Levels = Annotated[
    Annotated[Literal["auto"], Tag("word")] | Annotated[_Numbers, Tag("numbers")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "numbers"),
]
Symmetry = Literal["auto", "none", "mirror_x", "mirror_y", "diagonal", "rectangle", "square"]


LightShape = Literal["round", "patch", "beside", "picture"]  # about the axis; in a patch around it, or beside; other


class Beam(NamedTuple):
    """Least and largest angle (rad) from the axis of the light that is wanted; least: 0 for light about the axis.

    ``off_rad``, ``azimuth_rad``: of its middle from the axis, and about it from x; ``half_rad``: half angle of a cone
    about its middle as wide as it is.
    """

    least_rad: float
    most_rad: float
    off_rad: float = 0.0
    azimuth_rad: float = 0.0
    half_rad: float = 0.0


class LightAcross(NamedTuple):
    """Wanted light in the plane y = 0: ``shares`` of it up to ``angles_rad`` from z, positive towards +x."""

    angles_rad: Float[np.ndarray, " n"]
    shares: Float[np.ndarray, " n"]

    def turned(self, angles_rad: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Angles to which light of a Lambertian source at ``angles_rad`` is to go: as much on each side there."""
        return np.interp(0.5 * (1.0 + np.sin(angles_rad)), self.shares, self.angles_rad)


@dataclass(frozen=True)
class StartConditions:
    """Conditions that the first faces of a search are to suit: limits, source, and ``beam``, which takes a moment.

    ``extent_mm``: radius of a circle that holds the source; None if its section does not state it. ``across``: the
    wanted light in the plane y = 0, which takes a moment, too.
    """

    limits: ConstraintsSection
    extent_mm: float | None
    beam: Callable[[], Beam]
    across: Callable[[], LightAcross] | None = None

    @property
    def clear_mm(self) -> float:
        """Least radius of a cavity around the source."""
        radius_mm = self.limits.cavity_radius_mm
        return radius_mm if self.extent_mm is None else max(radius_mm, self.extent_mm)

    @property
    def side_mm(self) -> float:
        """Side of a square source of its size."""
        half_mm = self.clear_mm if self.extent_mm is None else max(self.extent_mm, 1e-3 * self.limits.rim_radius_mm)
        return half_mm * sqrt(2.0)


@public
class LensShape(OfSeveralKinds, LensMaterial):
    """Material of a lens of any kind, and the SRBFs that will shape the faces that are free.

    A kind is a class of its own in a module of its own: its faces with their ``roles``, the faces from which a
    search begins, and what else differs from here. ``title``: words for such a lens. ``draws``: shapes of light for
    which it is advised (``search.lens_advice``). ``parametrisation``: how a search shapes its faces, a name in
    ``search.problem``. ``may_be_round``: it has a shape without any level, faces of revolution. ``radius_about_axis``:
    its radius is its distance from the axis, not from the LED: its exit or mouth is flat, and it lies in a cylinder.
    ``largest_symmetry``: mirror group of the most symmetric one. ``is_advised``: `lensforge new` weighs it
    against others, unasked. ``lies_along_y``: it is as long as a line of light. ``without``: stages that it does not
    have, and why. ``may_be_thin``: it may be much lower than wide, by :meth:`thin_tables`.
    """

    usual_kind = "double"
    title: ClassVar[str] = ""
    draws: ClassVar[frozenset[LightShape]] = frozenset({"round", "patch", "beside", "picture"})
    parametrisation: ClassVar[str] = "spheres"
    may_be_round: ClassVar[bool] = False
    radius_about_axis: ClassVar[bool] = False
    largest_symmetry: ClassVar[str] = "square"
    is_advised: ClassVar[bool] = True
    lies_along_y: ClassVar[bool] = False
    without: ClassVar[Mapping[str, str]] = {}
    may_be_thin: ClassVar[bool] = False
    kind: str
    levels: Levels = Field(
        default="auto",
        description='Functions of each level, coarse to fine, that shape each free surface; "auto": as many as '
        "they gain.",
    )
    sigma_c: Annotated[float, Field(ge=1e-6, le=1e6)] = Field(
        default=1.75, description="Factor of the width of every level's functions, Eq. (3)."
    )
    symmetry: Symmetry = Field(
        default="auto",
        description='Mirror symmetry of both surfaces; "auto": the largest that source and target share, which '
        "the record of a lens names.",
    )
    start: Annotated[FilePath, AfterValidator(lens_file)] | None = Field(
        default=None,
        description="Result folder, or its lens.json, from whose lens the search goes on instead of from the "
        "hemispheres.",
    )

    @classmethod
    def first_tables(cls, shape: LightShape) -> dict[str, dict[str, object]]:
        """Fields of a new spec with such a lens, by section; ``shape``: of its light, as in ``draws``."""
        return {"lens": {"levels": "auto"}}

    @check
    def _levels_are_some(self) -> None:
        if not (self.levels or self.may_be_round):
            raise ValueError("levels is empty: give at least one count")
        if self.levels and self.levels != "auto":
            with fault_of():
                _ = self.basis

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines on fixed surfaces and on levels that a user should know of before the search."""
        fixed = {name: face.fixed for name, face in self.faces.items() if face.fixed is not None}
        faces = tuple(f"lens.{name}.fixed: {warning}" for name, face in fixed.items() for warning in face.warnings)
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
        """The functions that shape the free surfaces; "auto" symmetry counts as none.

        Raises :class:`InputError` for levels that are no numbers yet.
        """
        if self.levels == "auto":
            raise InputError('lens.levels = "auto": a search chooses them; ask its lens, or give numbers')
        return SrbfBasis(self.levels, self.sigma_c, self._own_symmetry)

    @property
    def is_round(self) -> bool:
        """True where all faces are of revolution."""
        return False

    def is_revolved(self, face: str) -> bool:
        """True for a face of revolution about the axis."""
        fixed = self.faces[face].fixed
        return self.is_round if fixed is None else fixed.is_round

    @property
    def made_alone(self) -> Process:
        """Process by which such a lens is made where it is no part of a plate.

        It is turned, if all its faces can be; moulded, if no ball reaches the edges of its cavity; else milled.
        """
        if all(map(self.is_revolved, self.names)):
            return "turned"
        return "moulded" if self.has_creases and not self.is_opaque else "milled"

    @property
    def drawn_half_mm(self) -> float | None:
        """Half of the length of faces that are drawn along y, infinite without an end; None for any other."""
        return None

    def require_stage(self, stage: str) -> None:
        """Raise :class:`InputError` with the reason for a ``stage`` that such a lens does not have."""
        if (reason := self.without.get(stage)) is not None:
            raise InputError(f"{stage}: {reason}")

    def apart(self, lamps: Lamps) -> Lamps:
        """The lamps with a lens of their own: all, where no kind of lens is over several."""
        return lamps

    @property
    def coarser(self) -> str:
        """Advice for faces that are finer than tables resolve."""
        return "coarser lens.levels"

    @property
    def begins_tailored(self) -> bool:
        """True where the faces from which a search begins are near the best, so that long steps lead away from them."""
        return False

    @property
    def opening_mm(self) -> float | None:
        """Distance that the search keeps a mirror from closing over its opening; None if it cannot close."""
        return None

    @property
    def drawn_from_below(self) -> str | None:
        """Name of the outer face that widens upwards, which a base or a plate hides from a mould; None without any."""
        return next((role.name for role in self.roles if role.widens and role.before == BODY), None)

    @property
    def most_events(self) -> int:
        """Largest number of faces that a ray meets: each once, one after the other."""
        return len(self.roles)

    def derived_offsets_mm(self, sizes: LensSizes) -> dict[str, float]:
        """Offsets of faces by name where they are left out; of faces that only a search can place there is none."""
        return {}

    def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
        """The faces of the body by name from which a search begins; those that are fixed stay.

        Raises :class:`InputError` for sizes that leave no room for such a lens.
        """
        raise NotImplementedError

    def thin_tables(self, conditions: StartConditions) -> dict[str, dict[str, object]]:
        """Fields by section that make such a lens low, for a kind that may be thin.

        Raises :class:`InputError` for sizes that leave no room for it.
        """
        raise NotImplementedError

    def exit_space(self, limits: ConstraintsSection) -> ExitSpace:
        """The space that all light leaves of any lens of its kind within ``limits``."""
        return ExitBall(limits.max_radius_mm)

    def height_mm(self, limits: ConstraintsSection) -> float:
        """Height that the largest lens is taken to have: that of its limits, or as much as its radius."""
        return limits.max_radius_mm if limits.max_height_mm is None else limits.max_height_mm

    def highest_mm(self, limits: ConstraintsSection) -> float:
        """Height below which no cover glass has room."""
        height_mm = self.height_mm(limits)
        return height_mm if self.radius_about_axis else min(height_mm, limits.max_radius_mm)

    def extent_mm(self, limits: ConstraintsSection, rise: float | None = None) -> float:
        """Distance from the origin up to which the largest lens is taken to reach: towards a plane, or anywhere.

        ``rise``: cosine of the plane's normal to the axis.
        """
        radius_mm = limits.max_radius_mm
        height_mm = self.height_mm(limits)
        if not self.radius_about_axis:
            return radius_mm
        if rise is None:
            return hypot(radius_mm, height_mm)
        return radius_mm * sqrt(max(1.0 - rise**2, 0.0)) + height_mm * max(rise, 0.0)

    @property
    def shape_levels(self) -> tuple[int, ...]:
        """Number of basis functions of a free face at each level, coarse first."""
        return self.basis.levels

    @property
    def _own_symmetry(self) -> str:
        return "none" if self.symmetry == "auto" else self.symmetry


@public
class ProfiledShape(LensShape):
    """A lens of faces of revolution, which meet in creases; with ``levels`` SRBFs shape them beyond that."""

    parametrisation = "profiles"
    may_be_round = radius_about_axis = True
    draws = frozenset({"round", "patch"})

    levels: _Numbers = Field(
        default=(),
        description="Functions of each level, coarse to fine, that shape the free faces beyond their profiles; "
        "none: faces of revolution.",
    )
    profile: Annotated[int, Field(ge=LEAST_COEFFICIENTS, le=64)] = Field(
        default=12, description="Coefficients of the profile of each free face."
    )
    events: Annotated[int, Field(ge=3, le=MOST_EVENTS)] = Field(
        default=6, description="Largest number of faces that a ray meets; what goes on then is counted as its own fate."
    )

    @classmethod
    def first_tables(cls, shape: LightShape) -> dict[str, dict[str, object]]:
        """Faces of revolution for round light, else also some functions beyond their profiles."""
        return {"lens": {} if shape == "round" else {"levels": list(_FIRST_LEVELS)}}

    @property
    def most_events(self) -> int:
        """Largest number of faces that a ray meets."""
        return self.events

    @property
    def is_round(self) -> bool:
        """True without levels, and without faces that are given."""
        return not self.levels and all(face.fixed is None for face in self.faces.values())

    def is_revolved(self, face: str) -> bool:
        """True without levels for a face that is not given, and for one that is given so."""
        fixed = self.faces[face].fixed
        return not self.levels if fixed is None else fixed.is_round

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
