"""Targets of the far field: beams, even light on a plane, and the intensity in a photometric file."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lensforge.public import public
from lensforge.spec.spec_section import FilePath, check
from lensforge.spec.target_sections import Places, SoftTarget, TargetSection

BeamAngle = Annotated[float, Field(ge=0.1, le=170.0)]
_HORIZON = 89.0  # degrees: no plane is lit beyond


@public
class FarFieldTarget(TargetSection):
    """Lengths are angles, whatever is given."""

    far_field_only: ClassVar[bool] = True

    @property
    def in_unit(self) -> Literal["deg"]:
        """Degrees."""
        return "deg"


@public
class BeamTarget(FarFieldTarget, SoftTarget):
    """A beam by its full width at half maximum."""

    needs: ClassVar[tuple[str, ...]] = ("fwhm",)
    phrase: ClassVar[str] = "{0.profile} beam {fwhm}"
    across: ClassVar[str] = "fwhm"
    is_round: ClassVar[bool] = True

    kind: Literal["beam"] = "beam"
    fwhm_deg: BeamAngle | tuple[BeamAngle, BeamAngle] | None = Field(
        default=None, description="Full width at half maximum, one for both directions or along x and along y."
    )
    profile: Literal["gaussian", "cosine", "flat"] = Field(
        default="gaussian",
        description='Course of the intensity: "gaussian", "cosine" (a power of the cosine of the angle from the '
        'axis; between x and y the width follows an ellipse), or "flat" up to the half width and dark '
        "beyond it, with soft edges by `edge_deg`.",
    )

    def light(self, x: Places, y: Places) -> Places:
        """Intensity at angles: full widths at half maximum are those of the target, along x and along y."""
        width, height = self.sides("fwhm")
        ellipse = (2.0 * x / width) ** 2 + (2.0 * y / height) ** 2
        if self.profile == "gaussian":
            return np.asarray(np.exp2(-ellipse))
        if self.profile == "flat":
            return np.asarray(ellipse <= 1.0, dtype=np.float64)
        gamma = np.hypot(x, y)
        # half the width in the direction of each place; on the axis, where no direction is, the power does not count
        half = np.divide(gamma, np.sqrt(ellipse), out=np.ones_like(gamma), where=gamma > 0.0)
        power = np.log(0.5) / np.log(np.cos(np.radians(half)))
        return np.asarray(np.where(gamma < 90.0, np.cos(np.radians(gamma)), 0.0) ** power)

    @check
    def _only_flat_beams_have_edges(self) -> None:
        if self.edge and self.profile != "flat":
            raise ValueError(f'edge_deg = {self.edge:g} goes with profile = "flat"; leave it out')


@public
class BatwingTarget(FarFieldTarget, SoftTarget):
    """Even illuminance on a plane at right angles to the axis: intensity as 1 / cos^3 of the angle.

    With ``edge_deg`` the edge is soft: the illuminance falls as the integral of a Gaussian with that standard
    deviation, and is one half at ``to_deg``.
    """

    needs: ClassVar[tuple[str, ...]] = ("to",)
    phrase: ClassVar[str] = "batwing to {to}"
    across: ClassVar[str] = "to"
    is_round: ClassVar[bool] = True
    has_own_edge: ClassVar[bool] = True

    kind: Literal["batwing"] = "batwing"
    to_deg: Annotated[float, Field(ge=0.1, le=85.0)] | None = Field(
        default=None, description="Angle from the axis up to which the light is even."
    )

    @property
    def bounds(self) -> tuple[float, float]:
        """Twice the angle."""
        return 2.0 * self.size("to"), 2.0 * self.size("to")

    def light(self, x: Places, y: Places) -> Places:
        """Even illuminance on a plane, which falls at its edge as the integral of a Gaussian."""
        from scipy.special import erfc

        gamma = np.hypot(x, y)
        to = self.size("to")
        lit = gamma <= to if self.edge == 0.0 else 0.5 * erfc((gamma - to) / (np.sqrt(2.0) * self.edge))
        within = gamma < _HORIZON
        return np.where(within, lit / np.cos(np.radians(np.where(within, gamma, 0.0))) ** 3, 0.0)


@public
class PhotometricTarget(FarFieldTarget):
    """Intensity in an IES LM-63 or EULUMDAT file; its gamma = 0 is the receiver's axis, C = 0 +x, C = 90 -y.

    ``centre_deg`` tilts it, ``rotation_deg`` turns its C planes.
    """

    phrase: ClassVar[str] = "intensity of {0.file.name}"

    kind: Literal["photometric"] = "photometric"
    file: FilePath = Field(description="IES LM-63 or EULUMDAT file.")
