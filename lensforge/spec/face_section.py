"""The faces of a lens, such as ``[lens.inner]`` and ``[lens.outer]``: each a table with all that is its own."""

from typing import Annotated, ClassVar

from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY, DOUBLE, OUTSIDE, RIM_FLANGE, FaceRole, bounding
from lensforge.public import public
from lensforge.spec.coating_section import CoatingSection
from lensforge.spec.fixed_surface import FixedSurface
from lensforge.spec.processes import MOST_DRAFT_DEG
from lensforge.spec.scatter_section import AnyScatter
from lensforge.spec.spec_section import DraftOrNone, Millimetres, Section, check
from lensforge.spec.tolerances_section import FaceTolerances, lets_light_in, refuse_placement
from lensforge.surfaces.surface import Surface


@public
class _DesignedFace(Section):
    offset_mm: Millimetres | None = Field(
        default=None,
        description="Place of the face where the search starts: of a double lens the radius of a hemisphere; of "
        "cap, exit and mouth, which lie across the axis, the height there; of side, wall and cup, "
        "which lie around it, the radius at z = 0.",
    )
    fixed: FixedSurface | None = Field(
        default=None, description="Surface that the search does not change, in place of `offset_mm`."
    )
    coating: CoatingSection | None = Field(default=None, description="Coating of the face.")
    mirror: Annotated[float, Field(gt=0.0, le=1.0)] | None = Field(
        default=None,
        description="Share of the light that a metal film on the face reflects at every angle, in place of a "
        "coating; the rest is absorbed. Of a face of a lens for total internal reflection.",
    )
    scatter: AnyScatter | None = Field(
        default=None,
        description="How the face spreads the light that passes it, or that its mirror reflects; left out, it is "
        "polished.",
    )
    concave_radius_mm: Millimetres | None = Field(
        default=None,
        description="Least concave radius: of the ball that mills the face, or of the meridian, for the nose that "
        "turns it.",
    )
    draft_deg: Annotated[float, Field(ge=0.0, le=MOST_DRAFT_DEG)] | None = Field(
        default=None, description="Minimum draft along the axis, the direction in which the mould of the face opens."
    )

    @check
    def _starts_once(self) -> None:
        if self.offset_mm is not None and self.fixed is not None:
            raise ValueError("give one of offset_mm, where the search starts, and fixed, a surface that stays")
        if self.coating is not None and self.mirror is not None and "mirror" in self.model_fields_set:
            raise ValueError("give one of coating and mirror")

    @property
    def apex_mm(self) -> float | None:
        """Height on the axis before the search; None before it is derived."""
        return self.offset_mm if self.fixed is None else self.fixed.apex_mm


@public
class FaceSection(FaceTolerances, _DesignedFace):  # in the file, the face stands before its errors
    """A face of the lens: the hemisphere from which its search starts, or the surface that it is; coating, limits that
    the search keeps, and tolerances.
    """

    def with_tolerances(self, tolerances: FaceTolerances) -> "FaceSection":
        """The face with the tolerances of ``tolerances`` in place of its own."""
        face = self.changed(**{name: getattr(tolerances, name) for name in FaceTolerances.model_fields})
        face.model_fields_set.difference_update(FaceTolerances.model_fields.keys() - tolerances.model_fields_set)
        return face


@public
class FlangeSection(Section):
    """Flange at the exit's rim of a lens for total internal reflection: a ring, by which a holder takes the lens.

    A ring around the exit, joined by a cylinder of the lens's diameter. Light that meets that cylinder is absorbed.
    """

    diameter_mm: Millimetres = Field(
        description="Outer diameter; it must exceed that of the lens, twice `constraints.max_radius_mm`."
    )
    thickness_mm: Millimetres = Field(description="Thickness along the axis.")
    setback_mm: Millimetres = Field(
        default=0.1,
        description="Height of the exit's rim over the flange's top, and the least height of its underside over "
        "the wall.",
    )
    tolerance_mm: Millimetres | None = Field(
        default=None,
        description="Tolerance of its diameter and thickness, of the height of its underside, and of the cavity's "
        "cap against it, either way; left out, the general one.",
    )
    draft_deg: DraftOrNone = Field(
        default=None,
        description="Draft of its side, which is as wide as stated at its top; left out, 1 where the part is "
        "moulded, else 0.",
    )

    @property
    def room_mm(self) -> float:
        """Height of the cylinder that it needs."""
        return self.thickness_mm + 2.0 * self.setback_mm


@public
class FacesSection(Section):
    """The faces of a lens by name, from the source on: each has a table, and one of the ``roles``."""

    roles: ClassVar[tuple[FaceRole, ...]] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the faces that have tables."""
        return tuple(role.name for role in self.roles)

    @property
    def faces(self) -> dict[str, FaceSection]:
        """The tables of the faces."""
        return {name: getattr(self, name) for name in self.names}

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the faces that a search changes."""
        return tuple(name for name, face in self.faces.items() if face.fixed is None)

    @check
    def _one_is_free(self) -> None:
        if all(face.fixed is not None for face in self.faces.values()):
            raise ValueError(f"{' and '.join(f'{name}.fixed' for name in self.names)}: one of the faces must be free")

    @check
    def _first_is_the_reference(self) -> None:
        refuse_placement(self.roles, self.faces)

    @check
    def _scatters_no_light_that_it_keeps(self) -> None:
        for role in self.roles:
            face = self.faces[role.name]
            if face.scatter is not None and role.reflects and face.mirror is None:
                raise ValueError(
                    f"{role.name}.scatter: the face reflects light totally, which facets would let out; leave it out, "
                    f"or give the face a mirror ({role.name}.mirror)"
                )

    @property
    def rim_flange(self) -> FlangeSection | None:
        """The flange at the rim; None without one."""
        return None

    @property
    def drawn_mm(self) -> float | None:
        """Length of a part whose faces are drawn along y; None for any other."""
        return None

    @property
    def body_roles(self) -> tuple[FaceRole, ...]:
        """All faces of the body, from the source on: those that have tables, and before the last that of a flange."""
        return self.roles if self.rim_flange is None else (*self.roles[:-1], RIM_FLANGE, self.roles[-1])

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of all faces of the body."""
        return tuple(role.name for role in self.body_roles)

    def role(self, name: str) -> FaceRole:
        """The role of the face of that name."""
        return {role.name: role for role in self.body_roles}[name]

    @property
    def leaks(self) -> tuple[str, ...]:
        """Names of the faces of a body of several by which light can leave, though it is not to."""
        before_exit = self.body_roles[:-1] if self.body_names != DOUBLE else ()
        return tuple(role.name for role in before_exit if role.behind == OUTSIDE and role.is_optical)

    @property
    def is_opaque(self) -> bool:
        """True where no light enters the body: its index does not count, and its material is a label."""
        return not lets_light_in(self.roles)

    @property
    def has_creases(self) -> bool:
        """True where several faces lie side by side, and meet in creases; there the lens is widest and highest."""
        return any(len(bounding(self.roles, medium)) > 1 for medium in (CAVITY, BODY))

    @property
    def reflects(self) -> bool:
        """True where a face turns light by any angle, and at no loss."""
        return any(role.reflects for role in self.roles)

    @property
    def outward(self) -> str:
        """The face whose offset sets the wall from outside."""
        last = [role for role in self.roles if role.before == BODY][-1]
        return last.follows or last.name

    @property
    def flange_room_mm(self) -> float | None:
        """Height of the cylinder that a flange needs; None without one."""
        return None if self.rim_flange is None else self.rim_flange.room_mm

    @property
    def start_mm(self) -> dict[str, float]:
        """Heights of the faces on the axis before the search.

        Raises :class:`InputError` where no spec has derived one.
        """
        heights = dict[str, float]()
        for name, face in self.faces.items():
            if face.apex_mm is None:
                raise InputError(f"lens.{name}: without a height on the axis; a spec derives it, ask the lens of one")
            heights[name] = face.apex_mm
        return heights

    @property
    def fixed(self) -> dict[str, Surface | None]:
        """The surfaces of the faces that are fixed."""
        return {name: None if face.fixed is None else face.fixed.surface for name, face in self.faces.items()}
