"""Targets that are shapes: one level of light inside, none outside; and the flat top, whose edges fall smoothly."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Bool
from pydantic import Field

from lensforge.public import public
from lensforge.spec.spec_section import Coordinate, Millimetres, check
from lensforge.spec.target_sections import DegreesOff, DegreesWide, Places, SizedTarget, SoftTarget, TargetSection

Lit = Bool[np.ndarray, "..."]
_MOST_CORNERS = 1000
_MOST_SPOTS = 1000
_LEAST_SPREAD = 1e-12  # of a polygon's corners about a line, squared: below, they lie on it


@public
class ShapeTarget(SoftTarget):
    """A shape: one level of light inside, none outside."""

    def contains(self, x: Places, y: Places) -> Lit:
        """True inside, at places about its centre that broadcast."""
        raise NotImplementedError

    def light(self, x: Places, y: Places) -> Places:
        """1 inside, 0 outside."""
        return self.contains(x, y).astype(np.float64)


@public
class FlatTopTarget(SizedTarget):
    """A rectangular super-Gaussian, ``exp(-|2 x / width|^p - |2 y / height|^p)``; square without a height."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    takes: ClassVar[tuple[str, ...]] = (*TargetSection.takes, "height")
    phrase: ClassVar[str] = "flat top, {width} × {height}"

    kind: Literal["flat_top"] = "flat_top"
    exponent: Annotated[float, Field(ge=2.0, le=200.0)] = Field(
        default=18.0, description="Power p: the larger, the steeper the edges."
    )

    def pair(self, name: str) -> tuple[float, float] | None:
        """Length ``name`` along x and along y; without a height that is the width."""
        return super().pair("width" if name == "height" and self.length(name) is None else name)

    def light(self, x: Places, y: Places) -> Places:
        """The super-Gaussian."""
        half_width = 0.5 * self.size("width")
        half_height = 0.5 * self.sides("height")[1]
        with np.errstate(over="ignore"):  # far outside a narrow pattern: exp(-inf) is the 0 that is meant
            along_x = np.exp(-(np.abs(x / half_width) ** self.exponent))
            along_y = np.exp(-(np.abs(y / half_height) ** self.exponent))
        return along_y * along_x


@public
class RectangleTarget(SizedTarget, ShapeTarget):
    """A rectangle."""

    phrase: ClassVar[str] = "rectangle, {width} × {height}"
    has_word: ClassVar[bool] = True

    kind: Literal["rectangle"] = "rectangle"

    def contains(self, x: Places, y: Places) -> Lit:
        """True inside."""
        return _in_rectangle(x, y, self.size("width"), self.size("height"))


@public
class DiscTarget(ShapeTarget):
    """A disc."""

    needs: ClassVar[tuple[str, ...]] = ("diameter",)
    phrase: ClassVar[str] = "disc, {diameter} wide"
    across: ClassVar[str] = "diameter"
    has_word: ClassVar[bool] = True
    is_round: ClassVar[bool] = True

    kind: Literal["disc"] = "disc"
    diameter_mm: Millimetres | None = Field(default=None, description="Diameter on a surface.")
    diameter_deg: DegreesWide | None = None

    def contains(self, x: Places, y: Places) -> Lit:
        """True inside."""
        return _in_ellipse(x, y, self.size("diameter"), self.size("diameter"))


@public
class EllipseTarget(SizedTarget, ShapeTarget):
    """An ellipse with its axes along x and y."""

    phrase: ClassVar[str] = "ellipse, {width} × {height}"
    has_word: ClassVar[bool] = True
    is_round: ClassVar[bool] = True

    kind: Literal["ellipse"] = "ellipse"

    def contains(self, x: Places, y: Places) -> Lit:
        """True inside."""
        return _in_ellipse(x, y, self.size("width"), self.size("height"))


@public
class RingTarget(ShapeTarget):
    """A ring between two circles."""

    needs: ClassVar[tuple[str, ...]] = ("outer_diameter", "inner_diameter")
    phrase: ClassVar[str] = "ring, {inner_diameter} to {outer_diameter} wide"
    across: ClassVar[str] = "outer_diameter"
    has_word: ClassVar[bool] = True
    is_round: ClassVar[bool] = True

    kind: Literal["ring"] = "ring"
    outer_diameter_mm: Millimetres | None = Field(
        default=None, description="Diameter of the outer circle on a surface."
    )
    inner_diameter_mm: Millimetres | None = Field(
        default=None, description="Diameter of the inner circle on a surface."
    )
    outer_diameter_deg: DegreesWide | None = None
    inner_diameter_deg: DegreesWide | None = None

    def contains(self, x: Places, y: Places) -> Lit:
        """True between the circles."""
        outer = self.size("outer_diameter")
        inner = self.size("inner_diameter")
        return np.asarray(_in_ellipse(x, y, outer, outer) & ~_in_ellipse(x, y, inner, inner))

    @check
    def _inner_is_smaller(self) -> None:
        if self.size("inner_diameter") >= self.size("outer_diameter"):
            raise ValueError(
                f"inner_diameter_{self.unit} = {self.size('inner_diameter'):g} must be smaller than "
                f"outer_diameter_{self.unit} = {self.size('outer_diameter'):g}"
            )


@public
class PolygonTarget(ShapeTarget):
    """A closed polygon; where it crosses itself, by even and odd."""

    needs: ClassVar[tuple[str, ...]] = ("corners",)

    kind: Literal["polygon"] = "polygon"
    corners_mm: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(max_length=_MOST_CORNERS)] | None = Field(
        default=None, description="Corners (x, y) about the target's centre, on a surface."
    )
    corners_deg: Annotated[tuple[tuple[DegreesOff, DegreesOff], ...], Field(max_length=_MOST_CORNERS)] | None = None

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The corners, in the target's unit."""
        return self.corners_mm or self.corners_deg or ()

    @property
    def outline(self) -> tuple[complex, ...]:
        """The corners."""
        return tuple(complex(*corner) for corner in self.corners)

    @property
    def description(self) -> str:
        """The target in a few words."""
        return f"polygon with {len(self.corners)} corners"

    def contains(self, x: Places, y: Places) -> Lit:
        """True where a ray to +x crosses the outline an odd number of times."""
        inside: Lit = np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)), dtype=bool)
        for (x1, y1), (x2, y2) in zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True):
            if y1 != y2:
                crosses = (y1 > y) != (y2 > y)
                inside ^= crosses & (x < x1 + (y - y1) * ((x2 - x1) / (y2 - y1)))
        return inside

    @check
    def _has_an_area(self) -> None:
        if len(self.corners) < 3:
            raise ValueError(f"corners_{self.unit}: {len(self.corners)} corners, a polygon has three at least")
        x, y = (np.array(coordinates) - np.mean(coordinates) for coordinates in zip(*self.corners, strict=True))
        xx = float(x @ x)
        yy = float(y @ y)
        xy = float(x @ y)
        if xx * yy - xy * xy <= _LEAST_SPREAD * (xx + yy) ** 2:
            raise ValueError(f"corners_{self.unit}: all lie on a line; a polygon has an area")


@public
class CrossTarget(ShapeTarget):
    """An upright cross of equal arms."""

    needs: ClassVar[tuple[str, ...]] = ("length", "stroke")
    phrase: ClassVar[str] = "cross, {length} long"
    across: ClassVar[str] = "length"
    has_word: ClassVar[bool] = True

    kind: Literal["cross"] = "cross"
    length_mm: Millimetres | None = Field(default=None, description="Length from end to end on a surface.")
    stroke_mm: Millimetres | None = Field(default=None, description="Width of an arm on a surface.")
    length_deg: DegreesWide | None = None
    stroke_deg: DegreesWide | None = None

    def contains(self, x: Places, y: Places) -> Lit:
        """True in either arm."""
        length = self.size("length")
        stroke = self.size("stroke")
        return np.asarray(_in_rectangle(x, y, length, stroke) | _in_rectangle(x, y, stroke, length))


@public
class SpotsTarget(ShapeTarget):
    """A line or a grid of discs."""

    needs: ClassVar[tuple[str, ...]] = ("diameter", "pitch")
    phrase: ClassVar[str] = "{0.columns} × {0.rows} spots, {pitch} apart"

    kind: Literal["spots"] = "spots"
    columns: Annotated[int, Field(ge=1, le=_MOST_SPOTS)] = Field(description="Discs along x.")
    rows: Annotated[int, Field(ge=1, le=_MOST_SPOTS)] = Field(default=1, description="Discs along y.")
    diameter_mm: Millimetres | None = Field(default=None, description="Diameter of a disc on a surface.")
    diameter_deg: DegreesWide | None = None
    pitch_mm: Millimetres | None = Field(default=None, description="Distance of neighbouring centres on a surface.")
    pitch_deg: DegreesWide | None = None

    @property
    def bounds(self) -> tuple[float, float]:
        """Width and height of all spots."""
        diameter = self.size("diameter")
        pitch = self.size("pitch")
        return diameter + (self.columns - 1) * pitch, diameter + (self.rows - 1) * pitch

    def contains(self, x: Places, y: Places) -> Lit:
        """True in any disc."""
        pitch = self.size("pitch")
        diameter = self.size("diameter")
        return _in_ellipse(_from_spot(x, pitch, self.columns), _from_spot(y, pitch, self.rows), diameter, diameter)

    @check
    def _spots_lie_apart(self) -> None:
        if self.size("pitch") < self.size("diameter"):
            raise ValueError(
                f"pitch_{self.unit} = {self.size('pitch'):g} is less than diameter_{self.unit} = "
                f"{self.size('diameter'):g}: the spots would overlap"
            )


def _in_rectangle(x: Places, y: Places, width: float, height: float) -> Lit:
    return (np.abs(y) <= height / 2.0) & (np.abs(x) <= width / 2.0)


def _in_ellipse(x: Places, y: Places, width: float, height: float) -> Lit:
    return (2.0 * x / width) ** 2 + (2.0 * y / height) ** 2 <= 1.0


def _from_spot(x: Places, pitch: float, count: int) -> Places:
    place = x / pitch + 0.5 * (count - 1)
    return pitch * (place - np.clip(np.round(place), 0, count - 1))
