"""The linear lens: the profiles of two faces drawn along y, over one LED or a row of them."""

from typing import Literal

from lensforge.public import public
from lensforge.spec.drawn_shape import DrawnShape
from lensforge.spec.lens_section import StartConditions
from lensforge.spec.shell_shape import ShellShape
from lensforge.surfaces.drawn_profile import REACH, round_profile
from lensforge.surfaces.surface import Surface
from lensforge.surfaces.tailored_profiles import Room, tailored_profiles


@public
class ExtrudedSection(DrawnShape, ShellShape):
    """A linear lens: the profiles of two faces drawn along y, whose search shapes the profiles."""

    title = "linear lens"
    kind: Literal["extruded"] = "extruded"

    def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
        """Profiles tailored to a point and the wanted light where there is room for them, else half cylinders."""
        limits = conditions.limits
        largest_mm = limits.max_radius_mm
        given = any(face.model_fields_set & {"offset_mm"} for face in self.faces.values())
        if conditions.across is not None and not given:
            clear_mm = max(limits.cavity_radius_mm, limits.cavity_height_mm) + 2.0 * limits.margin_mm
            room = Room(largest_mm, clear_mm, limits.min_thickness_mm)
            index = self.refractive_index / self.outside_index
            tailored = tailored_profiles(index, conditions.across().turned, room, REACH * largest_mm, self.profile)
            if tailored is not None:
                return dict(zip(self.names, tailored, strict=True))
        return {name: round_profile(radius_mm, largest_mm, self.profile) for name, radius_mm in self.start_mm.items()}
