"""Fields of every receiver, and all targets that may lie on one."""

from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from lensforge.spec.beams import BatwingTarget, BeamTarget, PhotometricTarget
from lensforge.spec.emitter import Turn
from lensforge.spec.picture_targets import ArrayTarget, ImageTarget, TableTarget, TextTarget
from lensforge.spec.section import Section
from lensforge.spec.shapes import (
    CrossTarget,
    DiscTarget,
    EllipseTarget,
    FlatTopTarget,
    PolygonTarget,
    RectangleTarget,
    RingTarget,
    SpotsTarget,
)
from lensforge.spec.target import Unit

Target = Annotated[
    FlatTopTarget
    | RectangleTarget
    | DiscTarget
    | EllipseTarget
    | RingTarget
    | PolygonTarget
    | CrossTarget
    | TextTarget
    | ImageTarget
    | ArrayTarget
    | TableTarget
    | SpotsTarget
    | BeamTarget
    | BatwingTarget
    | PhotometricTarget,
    Field(discriminator="kind"),
]
_MOST_TARGETS = 1000


class ReceiverSection(Section):
    """Fields of every receiver; receivers are transparent, each sees every ray that leaves the lens."""

    unit: ClassVar[Unit] = "mm"

    kind: str
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] | None = None
    """Name of the receiver, by default its kind."""
    targets: Annotated[tuple[Target, ...], Field(min_length=1, max_length=_MOST_TARGETS)]
    """Targets on it, which add up."""
    share: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.0
    """Weight in the merit, relative to the other receivers."""
    pixel_aspect: Annotated[float, Field(ge=0.01, le=100.0)] = 1.0
    """Width over height of a pixel."""
    rotation_deg: Turn = 0.0
    """Turn about the direction that the receiver faces, from x towards y."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the chart, in its unit."""
        raise NotImplementedError

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height in the unit in which targets are given."""
        return self.size

    @model_validator(mode="after")
    def _targets_belong_here(self) -> "ReceiverSection":
        for target in self.targets:
            if target.unit != self.unit:
                where = "degrees" if self.unit == "deg" else "mm"
                raise ValueError(f"targets: a {target.kind} in {target.unit}, on this receiver lengths are in {where}")
            _require_on_receiver(target, self.extent)
        return self


def _require_on_receiver(target: Target, extent: tuple[float, float]) -> None:
    """Raise ``ValueError`` for a target whose centre, or mask, or edge does not fit the receiver."""
    unit, (width, height) = target.unit, extent
    x, y = target.centre
    off = x * x + y * y > 0.25 * width**2 if unit == "deg" else abs(x) > 0.5 * width or abs(y) > 0.5 * height
    if off:
        raise ValueError(
            f"centre_{unit} = ({x:g}, {y:g}) is off the receiver, which reaches {0.5 * width:g} in x and "
            f"{0.5 * height:g} in y"
        )
    mask = target.pair("uniform")
    if mask is not None and (mask[0] > width or mask[1] > height) and target.rotation_deg == 0.0:
        given = f"{mask[0]:g}" if mask[0] == mask[1] else f"({mask[0]:g}, {mask[1]:g})"
        raise ValueError(f"uniform_{unit} = {given} must not exceed the receiver's {_words(width, height, unit)}")
    edge = getattr(target, "edge", 0.0)
    if edge > max(width, height):
        raise ValueError(f"edge_{unit} = {edge:g} must not exceed the receiver's {_words(width, height, unit)}")


def _words(width: float, height: float, unit: str) -> str:
    return f"{width:g} {unit}" if width == height else f"{width:g} x {height:g} {unit}"
