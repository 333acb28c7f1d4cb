"""Lenses of two faces, one within the other, each of which refracts the light."""

from math import floor

from pydantic import Field

from lensforge.optics.face_roles import SHELL
from lensforge.public import public
from lensforge.spec.derived_values import WHY, LensSizes, three_digits
from lensforge.spec.face_section import FaceSection
from lensforge.spec.lens_section import LensShape
from lensforge.spec.spec_section import check

# Radii of the start's hemispheres over the largest radius.
_INNER = 0.43
_OUTER = 0.98
_AROUND_CAVITY = 1.05  # least inner hemisphere over the cavity

WHY["lens.inner.offset_mm"] = f"{_INNER:g} x max_radius_mm, the inner hemisphere of the start"
WHY["lens.outer.offset_mm"] = f"{_OUTER:g} x max_radius_mm, the outer hemisphere of the start"


@public
class ShellShape(LensShape):
    """A lens of two faces, one within the other, each of which refracts the light."""

    roles = SHELL
    inner: FaceSection = Field(
        default_factory=FaceSection,
        description="Face towards the source: it bounds the cavity, and the others are placed against it.",
    )
    outer: FaceSection = Field(default_factory=FaceSection, description="Face towards the light that is wanted.")

    @check
    def _no_mirror(self) -> None:
        for name, face in self.faces.items():
            if face.mirror is not None:
                raise ValueError(f"{name}.mirror = {face.mirror:g}: no light would leave; it goes with kind = 'tir'")

    @check
    def _outer_lies_outside(self) -> None:
        low = self.inner.apex_mm
        high = self.outer.apex_mm
        if low is not None and high is not None and high <= low:
            field = "outer.offset_mm" if self.outer.fixed is None else "the vertex of outer.fixed"
            raise ValueError(f"{field} = {high} must exceed where the inner face meets the axis, {low:g} mm")

    def derived_offsets_mm(self, sizes: LensSizes) -> dict[str, float]:
        """Hemispheres: the inner one around the cavity, and with some wall."""
        outer = three_digits(_OUTER * sizes.max_radius_mm, floor)
        wanted = max(_INNER * sizes.max_radius_mm, _AROUND_CAVITY * sizes.cavity_radius_mm)
        return {"inner": three_digits(min(wanted, outer - 1.5 * sizes.min_thickness_mm), floor), "outer": outer}
