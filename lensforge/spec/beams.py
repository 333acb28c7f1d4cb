"""Targets of the far field that lamps are specified by: beams, even light on a plane, photometric files."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from lensforge.spec.section import FilePath
from lensforge.spec.target import SoftTarget, TargetSection

BeamAngle = Annotated[float, Field(ge=0.1, le=170.0)]


class _FarFieldTarget(TargetSection):
    """Lengths are angles, whatever is given."""

    far_field_only: ClassVar[bool] = True

    @property
    def unit(self) -> Literal["deg"]:
        """Degrees."""
        return "deg"


class BeamTarget(_FarFieldTarget, SoftTarget):
    """A beam by its full width at half maximum."""

    needs: ClassVar[tuple[str, ...]] = ("fwhm",)

    kind: Literal["beam"] = "beam"
    fwhm_deg: BeamAngle | tuple[BeamAngle, BeamAngle] | None = None
    """Full width at half maximum, one for both directions or along x and along y."""
    profile: Literal["gaussian", "cosine", "flat"] = "gaussian"
    """Course of the intensity: "gaussian", "cosine" (a power of the cosine of the angle from the axis; between x and y
    the width is that of an ellipse), or "flat" up to the half width and dark beyond it, with soft edges by
    ``edge_deg``.
    """

    @model_validator(mode="after")
    def _only_flat_beams_have_edges(self) -> "BeamTarget":
        if self.edge and self.profile != "flat":
            raise ValueError(f'edge_deg = {self.edge:g} goes with profile = "flat"; leave it out')
        return self


class BatwingTarget(_FarFieldTarget, SoftTarget):
    """Even illuminance on a plane at right angles to the axis: intensity as 1 / cos^3 of the angle.

    ``edge_deg``: standard deviation of the Gaussian whose integral the illuminance falls as: to half at ``to_deg``.
    """

    needs: ClassVar[tuple[str, ...]] = ("to",)

    kind: Literal["batwing"] = "batwing"
    to_deg: Annotated[float, Field(ge=0.1, le=85.0)] | None = None
    """Angle from the axis up to which the light is even."""


class PhotometricTarget(_FarFieldTarget):
    """The intensity in an IES LM-63 or EULUMDAT file; its gamma = 0 is the receiver's axis, C = 0 +x, C = 90 -y.

    ``centre_deg`` tilts it, ``rotation_deg`` turns its C planes.
    """

    kind: Literal["photometric"] = "photometric"
    file: FilePath
    """IES LM-63 or EULUMDAT file."""
