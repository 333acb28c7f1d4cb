"""Targets that are shapes: one level of light inside, none outside; and the flat top, whose edges fall smoothly."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lensforge.spec.spec_section import Coordinate, Millimetres, check
from lensforge.spec.target_sections import (
    DegreesOff,
    DegreesWide,
    SizedTarget,
    SoftTarget,
    TargetSection,
)

_MOST_CORNERS, _MOST_SPOTS = 1000, 1000
_LEAST_SPREAD = 1e-12  # of a polygon's corners about a line, squared: below, they lie on it


class FlatTopTarget(SizedTarget):
    """A rectangular super-Gaussian, ``exp(-|2 x / width|^p - |2 y / height|^p)``; square without a height."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    takes: ClassVar[tuple[str, ...]] = (*TargetSection.takes, "height")

    kind: Literal["flat_top"] = "flat_top"
    exponent: Annotated[float, Field(ge=2.0, le=200.0)] = 18.0
    """Power p: the larger, the steeper the edges."""

    @property
    def widths(self) -> tuple[float, float]:
        """Width and height, in the target's unit."""
        height = self.length("height")
        return self.size("width"), height if isinstance(height, float) else self.size("width")


class RectangleTarget(SizedTarget, SoftTarget):
    """A rectangle."""

    kind: Literal["rectangle"] = "rectangle"


class DiscTarget(SoftTarget):
    """A disc."""

    needs: ClassVar[tuple[str, ...]] = ("diameter",)

    kind: Literal["disc"] = "disc"
    diameter_mm: Millimetres | None = None
    """Diameter on a surface."""
    diameter_deg: DegreesWide | None = None


class EllipseTarget(SizedTarget, SoftTarget):
    """An ellipse with its axes along x and y."""

    kind: Literal["ellipse"] = "ellipse"


class RingTarget(SoftTarget):
    """A ring between two circles."""

    needs: ClassVar[tuple[str, ...]] = ("outer_diameter", "inner_diameter")

    kind: Literal["ring"] = "ring"
    outer_diameter_mm: Millimetres | None = None
    """Diameter of the outer circle on a surface."""
    inner_diameter_mm: Millimetres | None = None
    """Diameter of the inner circle on a surface."""
    outer_diameter_deg: DegreesWide | None = None
    inner_diameter_deg: DegreesWide | None = None

    @check
    def _inner_is_smaller(self) -> None:
        if self.size("inner_diameter") >= self.size("outer_diameter"):
            raise ValueError(
                f"inner_diameter_{self.unit} = {self.size('inner_diameter'):g} must be smaller than "
                f"outer_diameter_{self.unit} = {self.size('outer_diameter'):g}"
            )


class PolygonTarget(SoftTarget):
    """A closed polygon; where it crosses itself, by even and odd."""

    needs: ClassVar[tuple[str, ...]] = ("corners",)

    kind: Literal["polygon"] = "polygon"
    corners_mm: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(max_length=_MOST_CORNERS)] | None = None
    """Corners (x, y) about the target's centre, on a surface."""
    corners_deg: Annotated[tuple[tuple[DegreesOff, DegreesOff], ...], Field(max_length=_MOST_CORNERS)] | None = None

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The corners, in the target's unit."""
        return self.corners_mm or self.corners_deg or ()

    @check
    def _has_an_area(self) -> None:
        if len(self.corners) < 3:
            raise ValueError(f"corners_{self.unit}: {len(self.corners)} corners, a polygon has three at least")
        x, y = (np.array(each) - np.mean(each) for each in zip(*self.corners, strict=True))
        xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
        if xx * yy - xy * xy <= _LEAST_SPREAD * (xx + yy) ** 2:
            raise ValueError(f"corners_{self.unit}: all lie on a line; a polygon has an area")


class CrossTarget(SoftTarget):
    """An upright cross of equal arms."""

    needs: ClassVar[tuple[str, ...]] = ("length", "stroke")

    kind: Literal["cross"] = "cross"
    length_mm: Millimetres | None = None
    """Length from end to end on a surface."""
    stroke_mm: Millimetres | None = None
    """Width of an arm on a surface."""
    length_deg: DegreesWide | None = None
    stroke_deg: DegreesWide | None = None


class SpotsTarget(SoftTarget):
    """A line or a grid of discs."""

    needs: ClassVar[tuple[str, ...]] = ("diameter", "pitch")

    kind: Literal["spots"] = "spots"
    columns: Annotated[int, Field(ge=1, le=_MOST_SPOTS)]
    """Discs along x."""
    rows: Annotated[int, Field(ge=1, le=_MOST_SPOTS)] = 1
    """Discs along y."""
    diameter_mm: Millimetres | None = None
    """Diameter of a disc on a surface."""
    diameter_deg: DegreesWide | None = None
    pitch_mm: Millimetres | None = None
    """Distance of neighbouring centres on a surface."""
    pitch_deg: DegreesWide | None = None

    @check
    def _spots_lie_apart(self) -> None:
        if self.size("pitch") < self.size("diameter"):
            raise ValueError(
                f"pitch_{self.unit} = {self.size('pitch'):g} is less than diameter_{self.unit} = "
                f"{self.size('diameter'):g}: the spots would overlap"
            )
