"""The faces of a lens, such as ``[lens.inner]`` and ``[lens.outer]``: each a table with all that is its own."""

from itertools import pairwise
from typing import Annotated, ClassVar

from pydantic import Field

from lensforge.optics.media import DOUBLE, FLANGE, REFLECTOR, TIR
from lensforge.spec.coating_section import CoatingSection
from lensforge.spec.fixed_surface import FixedSurface
from lensforge.spec.spec_section import Millimetres, Section, check
from lensforge.spec.tolerances_section import FaceTolerances, refuse_placement
from lensforge.surfaces.surface import Surface


class _DesignedFace(Section):
    offset_mm: Millimetres | None = None
    """Radius of the hemisphere from which the search of the face starts."""
    fixed: FixedSurface | None = None
    """Surface that the search does not change, in place of ``offset_mm``."""
    coating: CoatingSection | None = None
    """Coating of the face."""
    mirror: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """Share of the light that a metal film on the face reflects at every angle, in place of a coating; the rest is
    absorbed. Of a face of a lens for total internal reflection.
    """
    concave_radius_mm: Millimetres | None = None
    """Least concave radius: of the ball that mills the face."""
    draft_deg: Annotated[float, Field(ge=0.0, le=25.0)] | None = None
    """Least draft along the axis, the direction in which the mould of the face opens."""

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


class FaceSection(FaceTolerances, _DesignedFace):  # in the file, the face stands before its errors
    """A face of the lens: the hemisphere from which its search starts, or the surface that it is; coating, limits that
    the search keeps, and tolerances.
    """

    def with_tolerances(self, other: FaceTolerances) -> "FaceSection":
        """The face with the tolerances of ``other`` in place of its own."""
        own = self.model_copy(update={name: getattr(other, name) for name in FaceTolerances.model_fields})
        own.model_fields_set.difference_update(FaceTolerances.model_fields.keys() - other.model_fields_set)
        return own


class ExitFace(FaceSection):
    """A face that may be asked to stay a plane."""

    flat: bool = False
    """Keep it a plane across the axis: the search moves its height alone, and the other faces carry the shape."""

    @check
    def _flat_is_not_fixed(self) -> None:
        if self.flat and self.fixed is not None:
            raise ValueError("give one of flat, a plane whose height the search finds, and fixed, a surface that stays")


class FlangeSection(Section):
    """The flange at the exit's rim of a lens for total internal reflection: a ring, by which a holder takes the lens.

    It lies around the lens, whose rim goes on as a cylinder there. Light that meets that cylinder ends in the holder.
    """

    diameter_mm: Millimetres
    """Outer diameter; it must exceed that of the lens, twice ``constraints.max_radius_mm``."""
    thickness_mm: Millimetres
    """Thickness along the axis."""
    setback_mm: Millimetres = 0.1
    """Height of the exit's rim over the flange's top, and the least height of its underside over the wall."""

    @property
    def room_mm(self) -> float:
        """Height of the cylinder that it needs."""
        return self.thickness_mm + 2.0 * self.setback_mm


class FacesSection(Section):
    """The faces of a lens by name, from the source on; ``outward``: the one whose offset sets the wall from outside."""

    names: ClassVar[tuple[str, ...]] = ()
    outward: ClassVar[str] = ""

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
        refuse_placement(self.faces)

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of all faces of the body, from the source on: those that have tables, and that of a flange."""
        return self.names

    @property
    def flange_room_mm(self) -> float | None:
        """Height of the cylinder that a flange needs; None without one."""
        return None

    @property
    def start_mm(self) -> dict[str, float]:
        """Heights of the faces on the axis before the search."""
        apexes = {name: face.apex_mm for name, face in self.faces.items()}
        assert None not in apexes.values(), "a spec derives what is left out"
        return {name: height for name, height in apexes.items() if height is not None}

    @property
    def fixed(self) -> dict[str, Surface | None]:
        """The surfaces of the faces that are fixed."""
        return {name: None if face.fixed is None else face.fixed.surface for name, face in self.faces.items()}


class LensFaces(FacesSection):
    """The two faces of the usual lens."""

    names, outward = DOUBLE, "outer"

    inner: FaceSection = Field(default_factory=FaceSection)
    """Face towards the source: it bounds the cavity, and the others are placed against it."""
    outer: FaceSection = Field(default_factory=FaceSection)
    """Face towards the light that is wanted."""

    @check
    def _no_mirror(self) -> None:
        for name, face in self.faces.items():
            if face.mirror is not None:
                raise ValueError(f"{name}.mirror = {face.mirror:g}: no light would leave; it goes with kind = 'tir'")

    @check
    def _each_outside_the_one_before(self) -> None:
        for (before, inside), (name, face) in pairwise(self.faces.items()):
            low, high = inside.apex_mm, face.apex_mm
            if low is not None and high is not None and high <= low:
                field = f"{name}.offset_mm" if face.fixed is None else f"the vertex of {name}.fixed"
                raise ValueError(f"{field} = {high} must exceed where the {before} face meets the axis, {low:g} mm")


class TirFaces(FacesSection):
    """The four faces of a lens for total internal reflection."""

    names, outward = TIR, "exit"

    cap: FaceSection = Field(default_factory=FaceSection)
    """Face of the cavity over the source; ``offset_mm``: its height on the axis."""
    side: FaceSection = Field(default_factory=FaceSection)
    """Face of the cavity around the source: a cone with its draft, 2 degrees by default; ``offset_mm``: its radius at
    z = 0.
    """
    wall: FaceSection = Field(default_factory=FaceSection)
    """Face around the cavity, which reflects totally, or by a mirror; ``offset_mm``: its radius at z = 0."""
    exit: ExitFace = Field(default_factory=ExitFace)
    """Face towards the light that is wanted; ``offset_mm``: its height on the axis."""
    flange: FlangeSection | None = None
    """Flange at the exit's rim; by default there is none."""

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of all faces of the body, the exit last."""
        return self.names if self.flange is None else (*self.names[:-1], FLANGE, self.names[-1])

    @property
    def flange_room_mm(self) -> float | None:
        """Height of the cylinder that the flange needs; None without one."""
        return None if self.flange is None else self.flange.room_mm


_ALUMINISED = 0.88  # reflectance of a plain film of aluminium on a smooth lacquer, over the visible range


class CupSection(FaceSection):
    """The mirror of a reflector."""

    mirror: Annotated[float, Field(gt=0.0, le=1.0)] = _ALUMINISED
    """Share of the light that it reflects at every angle; the rest is absorbed."""


class ReflectorFaces(FacesSection):
    """The mirror of a reflector, its back, and its mouth."""

    names, outward = REFLECTOR, "cup"  # its back follows it

    cup: CupSection = Field(default_factory=CupSection)
    """Mirror around the source; ``offset_mm``: its radius at z = 0."""
    back: FaceSection = Field(default_factory=FaceSection)
    """Face behind the mirror, at the least wall and a little more; it has no fields of its own."""
    mouth: FaceSection = Field(default_factory=FaceSection)
    """Plane in which the reflector ends and light leaves; ``offset_mm``, its height, is its only field."""

    @check
    def _only_the_cup_is_a_mirror(self) -> None:
        if self.cup.coating is not None:
            raise ValueError("cup.coating: the cup is a mirror; give cup.mirror, the share that it reflects")
        for name, allowed in (("back", ()), ("mouth", ("offset_mm",))):
            face = self.faces[name]
            for field in sorted(face.model_fields_set.difference(allowed)):
                if getattr(face, field) is not None:
                    has = (
                        f"it has {' and '.join(allowed)} alone" if allowed else "it follows the cup, and has no fields"
                    )
                    raise ValueError(f"{name}.{field}: {has}; leave it out")

    @property
    def free(self) -> tuple[str, ...]:
        """All faces, or none where the cup is given: the others follow it."""
        return self.names if self.cup.fixed is None else ()
