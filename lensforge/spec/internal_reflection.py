"""The lens for total internal reflection: a cap and a side around the source, a wall that reflects, and an exit."""

from dataclasses import replace
from math import radians
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.face_roles import RIM_FLANGE
from lensforge.public import public
from lensforge.spec.derived_values import rounded_length
from lensforge.spec.face_section import FaceSection, FlangeSection
from lensforge.spec.lens_section import Beam, LightShape, ProfiledShape, StartConditions
from lensforge.spec.spec_section import Millimetres, check
from lensforge.surfaces import collimator
from lensforge.surfaces.collimator import Collimator, best_low_collimator
from lensforge.surfaces.grooved_collimator import ThinRoom, best_grooved_collimator, lowest_grooved_collimator
from lensforge.surfaces.profile import AXIS, HORIZON, LEAST_COEFFICIENTS, shrunk
from lensforge.surfaces.reciprocal import ConeFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.surface import Surface

_CLEARANCE_MM = 0.25  # of the cavity from the LED, at least
_DRAFT_DEG = 2.0  # of the side of a cavity, where the spec does not say
_THIN_HEIGHT = 1.1  # over its radius, at most, of a thin lens
_THIN_PROFILE = 24  # coefficients of each face: those of lens and ring are half of them
# Radius of a groove over the height. Narrower ones have more light, but rays that cross them are far off behind splines
# of a STEP: of a lens 6.6 mm high, rms 57 um for 0.18 mm and 39 um for 0.33 mm, where 50 um are allowed.
GROOVE_OF_HEIGHT = 1.0 / 18.0
_WIDEST_BEAM = 3.0  # over the narrowest of this source and radius: wider ones fit any cavity, and the exit makes them


@public
class ExitFace(FaceSection):
    """A face that may be kept a plane."""

    flat: bool = Field(
        default=False,
        description="Keep it a plane across the axis: the search moves its height alone, and the other faces "
        "carry the shape.",
    )

    groove_radius_mm: Millimetres | None = Field(
        default=None,
        description="Radius of the meridian in the middle of a groove, by which the exit is a lens over the cap within "
        "a ring over the wall, where the search starts. The lens is as high as `constraints.max_height_mm`, which may "
        "be half of what it is without; left out, one smooth face.",
    )

    @check
    def _groove_is_shaped(self) -> None:
        if self.groove_radius_mm is not None and (self.flat or self.fixed is not None):
            raise ValueError("groove_radius_mm: such an exit is shaped by the search; leave flat and fixed out")

    @check
    def _flat_is_not_fixed(self) -> None:
        if self.flat and self.fixed is not None:
            raise ValueError("give one of flat, a plane whose height the search finds, and fixed, a surface that stays")


@public
class TirSection(ProfiledShape):
    """A lens for total internal reflection: cap and side of the cavity, the reflecting wall, and the exit.

    Faces begin as the lens for a point source that the size of the LED, the radius and the beam require. They are faces
    of revolution; with ``levels`` SRBFs shape cap, wall and exit beyond that.
    """

    roles = collimator.ROLES
    title = "lens for total internal reflection"
    may_be_thin = True
    kind: Literal["tir"] = "tir"
    cap: FaceSection = Field(
        default_factory=FaceSection,
        description="Face of the cavity over the source; `offset_mm`: its height on the axis.",
    )
    side: FaceSection = Field(
        default_factory=FaceSection,
        description="Face of the cavity around the source: a cone with its draft, 2 degrees by default; "
        "`offset_mm`: its radius at z = 0.",
    )
    wall: FaceSection = Field(
        default_factory=FaceSection,
        description="Face around the cavity, which reflects totally, or by a mirror; `offset_mm`: its radius at z = 0.",
    )
    exit: ExitFace = Field(
        default_factory=ExitFace,
        description="Face towards the light that is wanted; `offset_mm`: its height on the axis.",
    )
    flange: FlangeSection | None = Field(
        default=None, description="Flange at the exit's rim; by default there is none."
    )

    @check
    def _groove_is_of_revolution(self) -> None:
        if self.exit.groove_radius_mm is None:
            return
        if self.levels:
            raise ValueError("exit.groove_radius_mm: a groove is of revolution; leave levels out")
        if self.flange is not None:
            raise ValueError(
                "exit.groove_radius_mm: a flange has no room yet at the rim of such an exit; leave one out"
            )
        if self.profile < 2 * LEAST_COEFFICIENTS:
            raise ValueError(
                f"profile = {self.profile}: lens and ring of an exit with a groove share them by halves; at least "
                f"{2 * LEAST_COEFFICIENTS}"
            )
        if any(face.offset_mm is not None for face in self.faces.values()):
            raise ValueError(
                "exit.groove_radius_mm: its height and those of other faces are found; leave offset_mm out"
            )

    @classmethod
    def first_tables(cls, shape: LightShape) -> dict[str, dict[str, object]]:
        """Fields for its light; without a base, over which its wall could not be drawn from a mould."""
        return {**super().first_tables(shape), "base": {"kind": "none"}}

    def is_revolved(self, face: str) -> bool:
        """True for a side and a flat exit whatever the levels: they stay a cone and a plane."""
        stays = face == "side" or (face == "exit" and self.exit.flat)
        return (stays and self.faces[face].fixed is None) or super().is_revolved(face)

    @property
    def coarser(self) -> str:
        """A wider groove, where there is one."""
        return super().coarser if self.exit.groove_radius_mm is None else "a larger lens.exit.groove_radius_mm"

    @property
    def begins_tailored(self) -> bool:
        """True for an exit with a groove."""
        return self.exit.groove_radius_mm is not None

    @property
    def rim_flange(self) -> FlangeSection | None:
        """The flange at the exit's rim."""
        return self.flange

    def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
        """The lens for a point with the best light for source, radius and beam; faces and offsets that are given stay.

        Raises :class:`InputError` for sizes that leave no room for such a lens.
        """
        beam = conditions.beam()
        try:
            faces = self._of_a_point(conditions, beam)
        except InputError as error:
            raise InputError(f"lens: {str(error).removeprefix('collimator: ')} (lens.kind = 'tir')") from None
        if self.exit.flat:
            faces["exit"] = PlaneFace(faces["exit"].reach_mm, float(faces["exit"].radius(AXIS)[0]))
        if self.flange is not None:
            faces |= _with_flange(faces["exit"], self.flange, conditions)
        for name, offset_mm, towards in (("wall", self.wall.offset_mm, HORIZON), ("exit", self.exit.offset_mm, AXIS)):
            if offset_mm is not None:
                faces[name] = _resized(faces[name], offset_mm, towards)
        fixed = self.fixed
        return {name: fixed.get(name) or faces[name] for name in self.body_names}

    def _of_a_point(self, conditions: StartConditions, beam: Beam) -> dict[str, ReciprocalSurface]:
        if self.exit.groove_radius_mm is None:
            return self._collimator(conditions, beam).faces
        if conditions.limits.max_height_mm is None:
            raise InputError(
                "lens.exit.groove_radius_mm: a lens with a groove is as high as constraints.max_height_mm; give it"
            )
        best = best_grooved_collimator(
            self.refractive_index / self.cavity_index,
            _thin_room(conditions, conditions.limits.max_height_mm),
            conditions.side_mm,
            beam.most_rad,
            draft_rad=self._draft_rad,
            mirrored=self.wall.mirror is not None,
        )
        return best.faces(self.exit.groove_radius_mm)

    def thin_tables(self, conditions: StartConditions) -> dict[str, dict[str, object]]:
        """Fields of the lowest lens with a groove that has nearly the light of a higher one of its radius.

        Raises :class:`InputError` for sizes that leave no room for such a lens.
        """
        radius_mm = conditions.limits.rim_radius_mm
        lowest = lowest_grooved_collimator(
            self.refractive_index / self.cavity_index,
            _thin_room(conditions, _THIN_HEIGHT * radius_mm),
            conditions.side_mm,
            min(conditions.beam().most_rad, _widest_beam_rad(conditions)),
            draft_rad=self._draft_rad,
        )
        height_mm = rounded_length(lowest.height_mm + 2.0 * conditions.limits.margin_mm)
        groove = {"groove_radius_mm": rounded_length(GROOVE_OF_HEIGHT * height_mm)}
        return {"lens": {"profile": _THIN_PROFILE, "exit": groove}, "constraints": {"max_height_mm": height_mm}}

    @property
    def _draft_rad(self) -> float:
        return radians(_DRAFT_DEG if self.side.draft_deg is None else self.side.draft_deg)

    def _collimator(self, conditions: StartConditions, beam: Beam) -> Collimator:
        limits = conditions.limits
        size = conditions.side_mm
        radius_mm = limits.rim_radius_mm
        margin_mm = 2.0 * limits.margin_mm
        room_mm = np.inf if limits.max_height_mm is None else limits.max_height_mm - (self.flange_room_mm or 0.0)
        best = best_low_collimator(
            self.refractive_index / self.cavity_index,
            radius_mm,
            size,
            min(beam.most_rad, _widest_beam_rad(conditions)),
            room_mm,
            draft_rad=self._draft_rad,
            least_wall_mm=limits.min_thickness_mm + margin_mm,
            mirrored=self.wall.mirror is not None,
            clearance_mm=max(0.0, conditions.clear_mm - size / 2.0**0.5) + margin_mm,
        )
        cap = self.cap.offset_mm
        side = self.side.offset_mm
        return replace(best, cap_mm=cap or best.cap_mm, cavity_mm=side or best.cavity_mm)


def _widest_beam_rad(conditions: StartConditions) -> float:
    """Widest half angle of a beam for which the first lens is chosen."""
    of_radius = conditions.side_mm / conditions.limits.rim_radius_mm
    return _WIDEST_BEAM * float(np.arcsin(min(0.5, of_radius / np.sqrt(np.pi))))


def _thin_room(conditions: StartConditions, height_mm: float) -> ThinRoom:
    limits = conditions.limits
    margin_mm = 2.0 * limits.margin_mm
    clear_mm = max(conditions.clear_mm, 0.5**0.5 * conditions.side_mm + _CLEARANCE_MM) + margin_mm
    return ThinRoom(height_mm - margin_mm, limits.rim_radius_mm, limits.min_thickness_mm + margin_mm, clear_mm)


def _with_flange(
    leaving: ReciprocalSurface, flange: FlangeSection, conditions: StartConditions
) -> dict[str, ReciprocalSurface]:
    """The cylinder at which a flange begins, around the light that the wall turns, and the exit so much higher."""
    limits = conditions.limits
    rim_mm = float(leaving.radius(AXIS)[0])
    cylinder = ConeFace(1.1 * leaving.reach_mm, limits.rim_radius_mm)  # its continuation is that of no other face
    height_mm = rim_mm + flange.room_mm + 2.0 * limits.margin_mm
    if height_mm >= leaving.reach_mm:
        most_mm = flange.thickness_mm - (height_mm - leaving.reach_mm)
        raise InputError(
            f"lens.flange.thickness_mm = {flange.thickness_mm:g}: the exit above it would be {height_mm:.4g} mm high, "
            f"where a lens of {limits.rim_radius_mm:g} mm radius has none; less than {most_mm:.3g} mm, or raise "
            "constraints.max_radius_mm"
        )
    return {RIM_FLANGE.name: cylinder, "exit": _resized(leaving, height_mm, AXIS)}


def _resized(face: ReciprocalSurface, offset_mm: float, towards: Float[np.ndarray, "1 3"]) -> ReciprocalSurface:
    return shrunk(face, float(face.radius(towards)[0]) / offset_mm)
