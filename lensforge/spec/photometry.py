"""The ``[photometry]`` of a spec: which lighting the lens is for, and the road that it lights."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.spec.light_limits import Azimuth
from lensforge.spec.receivers import AnyReceiver, FarFieldReceiver, PlaneReceiver
from lensforge.spec.search import ConstraintsSection
from lensforge.spec.section import Section

Metres = Annotated[float, Field(gt=0.0, le=1000.0)]
_OF_ROAD = ("pole_height_m", "pole_spacing_m", "road_width_m")
_ROAD_ONLY = (*_OF_ROAD, "overhang_m", "maintenance_factor")
_FAR = 5.0  # widths of a lamp: there 1/r^2 errs by less than 1 % (five-times rule, CIE S 025)


class PhotometrySection(Section):
    """Lighting that a lens is for, and the road that it lights."""

    use: Literal["general", "area", "road"] = "general"
    """Lighting: "general"; "area" adds the IES distribution type and the BUG rating; "road" adds these, and the classes
    of EN 13201 of a road along whose edge the lamps stand.
    """
    street_side_deg: Azimuth = 90.0
    """Direction from the lens towards the street, from its +x to its +y."""
    lenses: Annotated[int, Field(ge=1, le=100_000)] = 1
    """Equal lenses in a lamp."""
    pole_height_m: Metres | None = None
    """Height of a lamp above the road."""
    pole_spacing_m: Metres | None = None
    """Distance between lamps along the road."""
    road_width_m: Metres | None = None
    """Width of the road."""
    overhang_m: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    """Distance of a lamp from the edge of the road, over the road."""
    maintenance_factor: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """Share of the light that dirt and age leave."""

    @model_validator(mode="after")
    def _names_its_road(self) -> "PhotometrySection":
        missing = [name for name in _OF_ROAD if getattr(self, name) is None]
        if self.use == "road" and missing:
            raise ValueError(f'use = "road" needs {", ".join(missing)}; give them, or use = "area" for a lamp alone')
        fields = type(self).model_fields
        given = [name for name in _ROAD_ONLY if getattr(self, name) != fields[name].default]
        if self.use != "road" and given:
            raise ValueError(f'{given[0]} is of a road; leave it out, or give use = "road"')
        return self


def require_seen_from_afar(
    section: PhotometrySection, receivers: tuple[AnyReceiver, ...], limits: ConstraintsSection
) -> None:
    """Raise ``ValueError`` where a lamp for an area or a road has no receiver far enough to be designed for it."""
    far_mm = _FAR * 2.0 * limits.max_radius_mm
    if section.use == "general" or any(_is_far(each, far_mm) for each in receivers):
        return
    raise ValueError(
        f'photometry.use = "{section.use}" is answered by the far field, but every receiver is nearer than {far_mm:g} '
        "mm, five times the lens's largest diameter; give a far-field target (half_angle_deg), or a plane farther away"
    )


def _is_far(receiver: AnyReceiver, far_mm: float) -> bool:
    plane = isinstance(receiver, PlaneReceiver) and receiver.distance_mm >= far_mm
    return plane or isinstance(receiver, FarFieldReceiver)
