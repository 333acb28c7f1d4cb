"""The field of a camera that stands beside the lamp, lit so that its picture of a flat wall is even.

A rectilinear lens shows the direction (x, y, z) at (x/z, y/z): its field is a rectangle there. Its picture of an even
wall falls towards the corners as a power of the cosine, by which the wall is lit more.
"""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lensforge.public import public
from lensforge.spec.far_field_targets import FarFieldTarget
from lensforge.spec.spec_section import check
from lensforge.spec.target_sections import Places, SizedTarget, SoftTarget

_WIDEST_DEG = 160.0
_HORIZON_DEG = 89.0  # no wall is lit beyond
_TO_WALL = 3.0  # power of the cosine by which an even intensity lights a wall at right angles to the axis
_PER_SIDE = 16  # places of the outline


@public
class CameraTarget(FarFieldTarget, SizedTarget, SoftTarget):
    """Light on a flat wall in the field of a camera, as much more as the camera's lens dims it towards the corners.

    ``width_deg`` and ``height_deg`` are the horizontal and the vertical full angle of a rectilinear camera, whose axis
    is that of the receiver.
    """

    takes: ClassVar[tuple[str, ...]] = SoftTarget.takes
    phrase: ClassVar[str] = "field of a camera, {width} × {height}"

    kind: Literal["camera"] = "camera"
    rolloff: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=4.0,
        description="Power n of the cosine of the angle from the axis by which the camera's lens dims its picture: "
        "the light makes up for it; 0 for an evenly lit wall.",
    )

    @property
    def outline(self) -> tuple[complex, ...]:
        """Its edge in angles: sides that bulge, and corners that lie nearer than those of a rectangle."""
        side = np.linspace(-1.0, 1.0, _PER_SIDE, endpoint=False)
        around = np.concatenate([side - 1j, 1.0 + 1j * side, 1j - side, -1.0 - 1j * side])
        across, up = self._half
        seen = across * around.real + 1j * up * around.imag
        gamma = np.degrees(np.arctan(np.abs(seen)))
        return tuple(complex(place) for place in gamma * seen / np.abs(seen))

    @property
    def _half(self) -> tuple[float, float]:
        """Half of the field at the distance 1."""
        across, up = (float(np.tan(np.radians(0.5 * self.size(name)))) for name in ("width", "height"))
        return across, up

    def light(self, x: Places, y: Places) -> Places:
        """Intensity at angles: 1/cos^(n + 3) in the field, since a wall gets cos^3 of an even one."""
        gamma = np.hypot(x, y)
        angle = np.radians(np.minimum(gamma, _HORIZON_DEG))
        stretched = np.divide(np.tan(angle), gamma, out=np.ones_like(angle), where=gamma > 0.0)
        across, up = self._half
        inside = (np.abs(x * stretched) <= across) & (np.abs(y * stretched) <= up) & (gamma < _HORIZON_DEG)
        return np.where(inside, np.cos(angle) ** -(self.rolloff + _TO_WALL), 0.0)

    @check
    def _is_seen_by_a_rectilinear_camera(self) -> None:
        for name in ("width", "height"):
            if self.size(name) > _WIDEST_DEG:
                raise ValueError(
                    f"{name}_deg = {self.size(name):g}: a rectilinear camera sees {_WIDEST_DEG:g} degrees at most; "
                    "give less, or a table of light for a fisheye"
                )
