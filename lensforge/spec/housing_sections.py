"""The ``[[scene]]`` of a spec: bodies in the light behind the lens, such as a bezel, a mirror ring, a cover or a room.

A kind of body is a class that extends :class:`HousingSection`: it registers itself. Its shape is a function of
``scene.housing_mesh.mesh_of`` for the class of its ``bodies``, by default its own.
"""

from collections.abc import Sequence
from math import atan2, degrees, hypot
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from lensforge.optics.material import D_LINE_NM, MATERIALS
from lensforge.optics.media import Reflection
from lensforge.optics.pose import Pose, Vector
from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.emitter_section import Degrees, Turn
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.lens_section import LensShape
from lensforge.spec.spec_files import alike
from lensforge.spec.spec_section import Coordinate, FilePath, Label, Millimetres, MillimetresOrZero, Section, check

MOST_BODIES = 32
MOST_SCENE_EVENTS = 16

Wall = Literal["black", "diffuse", "mirror"]
Finish = Literal[Wall, "clear"]
_OF_CLEAR = ("refractive_index", "material", "absorption_per_mm")
_Reflectance = Annotated[float, Field(ge=0.0, le=1.0)] | None


@public
class HousingSection(OfSeveralKinds, Section):
    """Fields of every body in the light behind the lens. A black one takes all light that meets it.

    Others reflect light, or let it through; what has gone on from as many bodies as `scene_events` says is lost at the
    next one. A body stands in the coordinates of the lens, or of all lamps, as receivers do; those behind it are in its
    shadow. The search knows it, and one reflection, but takes a clear one for air. No body may reach into the room of
    the lens.
    """

    encloses: ClassVar[bool] = False  # all light: no far field and no eye looks at it from outside

    kind: str
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] = Field(
        description="Name, by which the light that is lost there is stated."
    )
    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=(0.0, 0.0, 0.0), description="Place of its origin."
    )
    tilt_deg: tuple[Degrees, Degrees] = Field(
        default=(0.0, 0.0), description="Tilt of its axis from +z: about x, then about y."
    )
    rotate_z_deg: Turn = Field(default=0.0, description="Turn about its own axis, before the tilt.")
    surface: Finish = Field(
        default="black",
        description='Its surface. "black": takes all light. "diffuse": reflects it into all directions by the law of '
        'Lambert. "mirror": reflects it as a mirror. "clear": refracts it, in and out again. The search counts one '
        "reflection, and takes clear bodies for air.",
    )
    reflectance: _Reflectance = Field(
        default=None,
        description="Share of the light that a diffuse surface or a mirror reflects, of a room its walls; it takes the "
        "rest.",
    )
    refractive_index: Annotated[float, Field(gt=1.0, le=4.0)] | None = Field(
        default=None, description="Index of a clear body, over that of what surrounds it, at all wavelengths."
    )
    material: Label | None = Field(
        default=None,
        description="Material of the catalogue in place of `refractive_index`: that at 587.6 nm, at all wavelengths.",
    )
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] | None = Field(
        default=None, description="Absorption of a clear body (Beer and Lambert); by default none."
    )
    patch_mm: Millimetres | None = Field(
        default=None,
        description="Width of the patches by which the light on its surface is measured; by default it is not.",
    )

    @check
    def _reflectance_fits(self) -> None:
        if self.surface == "clear" and self.reflectance is not None:
            raise ValueError(
                f"reflectance = {self.reflectance:g}: a clear surface reflects by its refractive_index; leave it out"
            )
        if self.surface == "black" and self.reflectance is not None:
            raise ValueError(
                f"reflectance = {self.reflectance:g}: a black surface reflects no light; give surface = "
                '"diffuse" or "mirror", or leave it out'
            )
        if self.surface in ("diffuse", "mirror") and self.reflectance is None:
            raise ValueError(f'surface = "{self.surface}": give its reflectance, the share of light that it reflects')

    @check
    def _material_fits(self) -> None:
        if self.surface == "clear":
            if (self.refractive_index is None) == (self.material is None):
                raise ValueError('surface = "clear": give one of refractive_index and material')
            if self.material is not None and self.material not in MATERIALS:
                raise ValueError(f"material = {self.material!r}: must be one of {', '.join(MATERIALS)}")
            if self.patch_mm is not None:
                raise ValueError("patch_mm: light on a clear body is not measured, as it passes; leave it out")
            return
        for name in _OF_CLEAR:
            if (given := getattr(self, name)) is not None:
                raise ValueError(f'{name} = {given}: of a clear body only; give surface = "clear", or leave it out')

    @check
    def _lights_no_patch_of_its_own(self) -> None:
        if self.surface == "black" or self.patch_mm is None:
            return
        if not all(body.is_convex for body in self.bodies):
            raise ValueError(
                "patch_mm: the light that this body reflects onto itself is not measured; measure a box, a room, a "
                'cylinder without a bore, or a body of surface = "black"'
            )

    @model_serializer(mode="wrap")
    def _as_before_reflections(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        """The section without what its surface has not: specs of such bodies keep the hash that they had before."""
        without = {"clear": ("reflectance",), "black": ("surface", "reflectance", *_OF_CLEAR)}
        left_out = without.get(self.surface, _OF_CLEAR)
        return {name: value for name, value in write(self).items() if name not in left_out}

    @property
    def bodies(self) -> "tuple[HousingSection, ...]":
        """The bodies that light meets, of a shape and a reflectance each: itself."""
        return (self,)

    @property
    def index(self) -> float:
        """Refractive index of a clear body; 0 of any other."""
        return self.refractive_index or (MATERIALS[self.material].index_at(D_LINE_NM) if self.material else 0.0)

    @property
    def is_convex(self) -> bool:
        """True for a body that no light can meet twice."""
        return False

    @property
    def pose(self) -> Pose:
        """Place of the body."""
        return Pose.of_tilts(self.centre_mm, self.tilt_deg, self.rotate_z_deg)

    def posed(self, pose: Pose) -> Self:
        """The body in another pose."""
        x, y, z = pose.axis
        tilt_deg = degrees(atan2(-y, hypot(x, z))), degrees(atan2(x, z))
        (along_x, along_y, _), *_ = pose.seen_from(Pose.of_tilts(pose.origin_mm, tilt_deg)).axes
        turn_deg = degrees(atan2(along_y, along_x))
        return self.changed(centre_mm=pose.origin_mm, tilt_deg=tilt_deg, rotate_z_deg=turn_deg)


@public
class HousingBox(HousingSection):
    """A box about its origin, such as a wall."""

    kind: Literal["box"] = "box"
    size_mm: tuple[Millimetres, Millimetres, Millimetres] = Field(description="Its sides along x, y and z.")

    @property
    def is_convex(self) -> bool:
        """True: so is every box."""
        return True


@public
class HousingCylinder(HousingSection):
    """A cylinder along its z axis about its origin; with a bore it is a tube, or a round bezel."""

    kind: Literal["cylinder"] = "cylinder"
    radius_mm: Millimetres = Field(description="Radius.")
    bore_radius_mm: MillimetresOrZero = Field(default=0.0, description="Radius of its bore, 0 for none.")
    length_mm: Millimetres = Field(description="Length along z.")

    @property
    def is_convex(self) -> bool:
        """True without a bore."""
        return self.bore_radius_mm == 0.0

    @check
    def _bore_lies_within(self) -> None:
        if self.bore_radius_mm >= self.radius_mm:
            raise ValueError(
                f"bore_radius_mm = {self.bore_radius_mm:g}: must be less than radius_mm = {self.radius_mm:g}"
            )


@public
class HousingFile(HousingSection):
    """Closed bodies of a STEP, STL or 3MF file, in its coordinates."""

    kind: Literal["file"] = "file"
    file: FilePath = Field(description="STEP, STL or 3MF; STL and 3MF in mm.")


class RoomSide(HousingSection):
    """A side of a room, in the frame of that: the wall that faces into it along ``facing``, one of the six axes."""

    encloses: ClassVar[bool] = True

    kind: str = "side"
    name: str
    size_mm: tuple[Millimetres, Millimetres, Millimetres]
    facing: Vector

    @property
    def is_convex(self) -> bool:
        """True: it is flat."""
        return True


_SIDES: dict[str, Vector] = {
    "floor": (0.0, 0.0, -1.0),
    "ceiling": (0.0, 0.0, 1.0),
    "wall-1": (-1.0, 0.0, 0.0),
    "wall-2": (0.0, -1.0, 0.0),
    "wall-3": (1.0, 0.0, 0.0),
    "wall-4": (0.0, 1.0, 0.0),
}
_BESIDE = 1e-9  # of its size: a lens may stand in the very ceiling


@public
class HousingRoom(HousingSection):
    """A room of one floor, a ceiling and four walls, about its origin, in which all lamps stand.

    The floor is at +z, where the light of a lens goes that looks down. The sides are bodies of names of their own: with
    the name "room" they are "room-floor", "room-ceiling", and "room-wall-1" to "room-wall-4" at +x, +y, -x and -y. Far
    fields and eyes see the lamps without the room.
    """

    encloses: ClassVar[bool] = True

    kind: Literal["room"] = "room"
    size_mm: tuple[Millimetres, Millimetres, Millimetres] = Field(description="Its inner lengths along x, y and z.")
    surface: Wall = Field(
        default="black",
        description='The surface of its sides. "black": takes all light. "diffuse": reflects it into all directions by '
        'the law of Lambert. "mirror": reflects it as a mirror. The search counts one reflection.',
    )
    floor_reflectance: _Reflectance = Field(
        default=None, description="Share of the light that its floor reflects; by default that of the walls."
    )
    ceiling_reflectance: _Reflectance = Field(
        default=None, description="Share of the light that its ceiling reflects; by default that of the walls."
    )

    @check
    def _black_sides_reflect_nothing(self) -> None:
        for name in ("floor_reflectance", "ceiling_reflectance"):
            if self.surface == "black" and (given := getattr(self, name)) is not None:
                raise ValueError(
                    f'{name} = {given:g}: a black surface reflects no light; give surface = "diffuse" and the '
                    "reflectance of the walls, or leave it out"
                )

    @property
    def bodies(self) -> tuple[HousingSection, ...]:
        """Its sides."""
        return tuple(self._side(name, facing) for name, facing in _SIDES.items())

    def _side(self, name: str, facing: Vector) -> RoomSide:
        reflectance = {"floor": self.floor_reflectance, "ceiling": self.ceiling_reflectance}.get(name)
        reflectance = self.reflectance if reflectance is None else reflectance
        return RoomSide(
            name=f"{self.name}-{name}",
            centre_mm=self.centre_mm,
            tilt_deg=self.tilt_deg,
            rotate_z_deg=self.rotate_z_deg,
            surface=self.surface,
            reflectance=reflectance,
            patch_mm=self.patch_mm,
            size_mm=self.size_mm,
            facing=facing,
        )

    def require_around(self, lamps: Lamps) -> None:
        """Raise ``ValueError`` for a lamp outside of the room."""
        half = 0.5 * np.array(self.size_mm)
        for number, lamp in enumerate(lamps.lamps):
            x, y, z = self.pose.to_local_points(np.array(lamp.place_mm)).tolist()
            if (np.abs([x, y, z]) > (1.0 + _BESIDE) * half).any():
                whose = "the lens" if lamps.is_single else f"lamp {number}"
                raise ValueError(
                    f"scene: {self.name!r}: {whose} stands outside of it, at ({x:.4g}, {y:.4g}, {z:.4g}) mm of the "
                    "room; centre_mm is the middle of the room, move it, or widen size_mm"
                )


def bodies_of(scene: Sequence[HousingSection], *, from_afar: bool = False) -> tuple[HousingSection, ...]:
    """The bodies that light meets in a scene; ``from_afar``: without those around all lamps, such as a room."""
    return tuple(body for section in scene for body in section.bodies if not (from_afar and section.encloses))


def reflection_of(bodies: Sequence[HousingSection]) -> Reflection | None:
    """Turn of light by ``bodies``: "diffuse" if any is, else "mirror" if any is one or clear; None if all are black."""
    surfaces = {body.surface for body in bodies}
    return "diffuse" if "diffuse" in surfaces else "mirror" if surfaces & {"mirror", "clear"} else None


def require_scene(bodies: Sequence[HousingSection], lens: LensShape, lamps: Lamps) -> None:
    """Raise ``ValueError`` for bodies of one name, and for scenes whose shadows are not modelled."""
    if not bodies:
        return
    if (duplicate := alike(body.name for body in bodies_of(bodies))) is not None:
        raise ValueError(f"scene: {duplicate}; give each its own")
    rooms = [body for body in bodies if isinstance(body, HousingRoom)]
    if len(rooms) > 1:
        raise ValueError(f"scene: {len(rooms)} rooms; all lamps stand in one, leave out the others")
    for room in rooms:
        room.require_around(lamps)
    if lens.cover_glass is not None:
        raise ValueError(
            "scene: bodies beside a lens.cover_glass are not modelled, as light would meet them on both of its sides; "
            "leave out the glass, or the bodies"
        )
    if lamps.period_mm is not None:
        raise ValueError(
            "scene: an endless lattice of lamps would need endless bodies; give lamps of kind grid, or no bodies"
        )
