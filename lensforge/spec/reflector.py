"""The reflector: a mirror around the source, open at its mouth, with a back behind it."""

from dataclasses import replace
from math import radians
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.exit_space import ExitColumn, ExitSpace
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE, FaceRole
from lensforge.public import public
from lensforge.spec.face_section import FaceSection
from lensforge.spec.lens_section import Beam, LightShape, ProfiledShape, StartConditions
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import Label, check
from lensforge.surfaces.reflector_cup import (
    LeaningCup,
    ParabolicCup,
    best_cup,
    best_leaning_cup,
    mouth_radius_mm,
    reflector_faces,
)
from lensforge.surfaces.surface import Surface

_ALUMINISED = 0.88  # reflectance of a plain film of aluminium on a smooth lacquer, over the visible range
_THICKER = 1.15  # a back over the minimum wall: the wall varies as the cup moves
_BESIDE = 0.5  # of the half width of light beside the axis: its middle is so far off


@public
class CupSection(FaceSection):
    """Mirror of a reflector."""

    mirror: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=_ALUMINISED, description="Share of the light that it reflects at every angle; the rest is absorbed."
    )


@public
class ReflectorSection(ProfiledShape):
    """A reflector: a cup about the source, whose inside is a mirror, open at its mouth.

    Light leaves by the mouth, directly or by reflections at the cup. The cup begins as the paraboloid that the size of
    the LED, the radius and the beam require, or is given; its back follows it at the minimum wall.
    """

    roles = (
        FaceRole("cup", CAVITY, BODY, reflects=True, widens=True),
        FaceRole("back", BODY, OUTSIDE, widens=True, follows="cup"),
        FaceRole("mouth", CAVITY, OUTSIDE, on_axis=True),
    )
    title = "reflector"
    draws = frozenset()
    kind: Literal["reflector"] = "reflector"
    material: Label = Field(
        default="metallised plastic", description="Material of the body, a label: no light enters it."
    )
    cup: CupSection = Field(
        default_factory=CupSection, description="Mirror around the source; `offset_mm`: its radius at z = 0."
    )
    back: FaceSection = Field(
        default_factory=FaceSection,
        description="Face behind the mirror, at the minimum wall and a little more; it has no fields of its own.",
    )
    mouth: FaceSection = Field(
        default_factory=FaceSection,
        description="Plane in which the reflector ends and light leaves; `offset_mm`, its height, is its only field.",
    )

    @classmethod
    def first_tables(cls, shape: LightShape) -> dict[str, dict[str, object]]:
        """Fields for as much light as can be where it is wanted, with levels where that is beside; without a base."""
        lens = {**super().first_tables(shape)["lens"], "cup": {"draft_deg": 0.0}} if shape == "beside" else {}
        return {"lens": lens, "base": {"kind": "none"}, "optimise": {"aim": "share"}}

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

    def exit_space(self, limits: ConstraintsSection) -> ExitSpace:
        """The disc of its mouth: as wide and as high as a given cup makes it, else at any height that is allowed."""
        cup = self.fixed["cup"]
        height_mm = self.mouth.offset_mm
        if cup is None or height_mm is None:
            return ExitColumn.of_mouth(limits.max_radius_mm, limits.tallest_mm)
        return ExitColumn(mouth_radius_mm(cup, height_mm), ((height_mm, height_mm),), upward=True)

    def height_mm(self, limits: ConstraintsSection) -> float:
        """Height of the mouth of a given cup, where it is given, too."""
        given = self.cup.fixed is not None and self.mouth.offset_mm
        return given or super().height_mm(limits)

    def highest_mm(self, limits: ConstraintsSection) -> float:
        """Height of the mouth as it is given, or as it may be."""
        return self.mouth.offset_mm or limits.max_height_mm or np.inf

    @property
    def opening_mm(self) -> float | None:
        """0 mm: a cup that levels shape must not close over the axis."""
        return 0.0 if self.levels and self.cup.fixed is None else None

    @check
    def _is_open(self) -> None:
        if self.cavity_index != self.outside_index:
            raise ValueError(
                f"cavity_index = {self.cavity_index:g}: a reflector is open, and has outside_index = "
                f"{self.outside_index:g} inside, too; give the same for both"
            )

    def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
        """The cup that is given, or the paraboloid that suits source, radius and beam best; its back and its mouth.

        Raises :class:`InputError` for sizes that leave no room for such a cup.
        """
        limits = conditions.limits
        wall_mm = _THICKER * (limits.min_thickness_mm + 2.0 * limits.margin_mm)
        most_mm = np.inf if limits.max_height_mm is None else limits.max_height_mm - limits.margin_mm
        cup = self.fixed["cup"]
        height_mm = self.mouth.offset_mm
        beam = conditions.beam() if cup is None else Beam(0.0, 0.0)
        shaped = None
        try:
            leaning = self._leaning(conditions, beam, wall_mm, height_mm or most_mm) if cup is None else None
            if leaning is not None:
                cup = leaning.face(limits.max_radius_mm, beam.azimuth_rad)
                most_mm = min(most_mm, leaning.height_mm)
                shaped = self.basis
            elif cup is None:
                best = self._of_a_point(conditions, beam, wall_mm, most_mm)
                cup = best.face
                height_mm = height_mm or best.height_mm
            return reflector_faces(cup, limits.rim_radius_mm, wall_mm, height_mm, most_mm, shaped)
        except InputError as error:
            raise InputError(f"lens: {str(error).removeprefix('reflector: ')} (lens.kind = 'reflector')") from None

    def _leaning(self, conditions: StartConditions, beam: Beam, wall_mm: float, most_mm: float) -> LeaningCup | None:
        """The cup that leans towards light beside the axis, where levels can shape one; None if none has room."""
        limits = conditions.limits
        if not self.levels or self.cup.offset_mm is not None or beam.off_rad <= _BESIDE * beam.half_rad:
            return None
        sizes = limits.rim_radius_mm - _THICKER * wall_mm, conditions.side_mm
        wanted = beam.off_rad, beam.half_rad, self.cup.mirror
        draft_rad = radians(max(self.cup.draft_deg or 0.0, 0.0))
        return best_leaning_cup(*sizes, *wanted, conditions.clear_mm, min(most_mm, limits.tallest_mm), draft_rad)

    def _of_a_point(self, conditions: StartConditions, beam: Beam, wall_mm: float, most_mm: float) -> ParabolicCup:
        best = best_cup(
            conditions.limits.rim_radius_mm,
            wall_mm,
            conditions.side_mm,
            beam.most_rad,
            beam.least_rad,
            clearance_mm=conditions.clear_mm,
            most_height_mm=most_mm,
        )
        return best if self.cup.offset_mm is None else replace(best, focal_mm=0.5 * self.cup.offset_mm)
