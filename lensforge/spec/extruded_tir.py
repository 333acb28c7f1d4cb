"""The linear lens with walls: the section of a lens for total internal reflection, drawn along y."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.face_roles import MOST_EVENTS
from lensforge.public import public
from lensforge.spec.drawn_shape import DrawnShape
from lensforge.spec.face_section import FaceSection
from lensforge.spec.lens_section import LightAcross, StartConditions
from lensforge.spec.spec_section import check
from lensforge.surfaces import collimator
from lensforge.surfaces.drawn_collimator import SectionRoom, WantedLight, best_drawn_collimator
from lensforge.surfaces.profile import LEAST_COEFFICIENTS
from lensforge.surfaces.surface import Surface

_NARROWEST = 1e-3  # half width (sine) of a beam


@public
class ExtrudedTirSection(DrawnShape):
    """A linear lens with walls: cap and side of its cavity, walls that reflect totally, and the exit, drawn along y.

    The search shapes all profiles, each side of them apart. They begin as the section of the lens for a point source
    that the size of the LED, the radius and the beam require.
    """

    roles = collimator.ROLES
    title = "linear lens for total internal reflection"
    radius_about_axis = True
    kind: Literal["extruded_tir"] = "extruded_tir"
    cap: FaceSection = Field(default_factory=FaceSection, description="Face of the cavity over the source.")
    side: FaceSection = Field(
        default_factory=FaceSection, description="Face of the cavity on both sides of the source."
    )
    wall: FaceSection = Field(
        default_factory=FaceSection,
        description="Face on both sides of the cavity, which reflects totally, or by a mirror.",
    )
    exit: FaceSection = Field(default_factory=FaceSection, description="Face towards the light that is wanted.")
    profile: Annotated[int, Field(ge=4 * LEAST_COEFFICIENTS, le=64)] = Field(
        default=32, description="Coefficients of the profile of each face, from foot to foot."
    )
    events: Annotated[int, Field(ge=3, le=MOST_EVENTS)] = Field(
        default=6, description="Largest number of faces that a ray meets; what goes on then is counted as its own fate."
    )

    @check
    def _is_placed_by_its_start(self) -> None:
        for name, face in self.faces.items():
            if face.offset_mm is not None:
                raise ValueError(f"{name}.offset_mm: the faces of such a lens are found together; leave it out")

    @property
    def most_events(self) -> int:
        """Largest number of faces that a ray meets."""
        return self.events

    def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
        """The section of the lens for a point with the best light for source, radius and beam.

        Raises :class:`InputError` for sizes that leave no room for such a lens.
        """
        limits = conditions.limits
        margin_mm = 2.0 * limits.margin_mm
        room = SectionRoom(
            limits.rim_radius_mm,
            limits.tallest_mm - margin_mm,
            limits.min_thickness_mm + margin_mm,
            max(conditions.clear_mm, limits.cavity_height_mm) + margin_mm,
        )
        across = conditions.across() if conditions.across is not None else LightAcross(np.zeros(2), np.arange(2.0))
        light = WantedLight(across.turned, conditions.side_mm, _half_sine(across))
        try:
            best = best_drawn_collimator(self.refractive_index / self.cavity_index, light, room)
        except InputError as error:
            raise InputError(f"lens: {str(error).removeprefix('collimator: ')} (lens.kind = 'extruded_tir')") from None
        return dict(best.drawn_faces(self.profile))


def _half_sine(across: LightAcross) -> float:
    """Half width, as a sine, of the light in the plane y = 0, without the outermost hundredth on both sides."""
    low, high = np.sin(np.interp([0.01, 0.99], across.shares, across.angles_rad))
    return max(0.5 * float(high - low), _NARROWEST)
