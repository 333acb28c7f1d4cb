"""Targets of a spec: the fields of all.

Every target has a place on its receiver, and a brightness among several. A kind of target is a class that extends one
of these and says what light it is: it registers itself.
"""

from math import cos, pi, sin
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.emitter_section import Turn
from lensforge.spec.spec_section import Coordinate, Millimetres, Section, check

IN_TARGET = 0.1  # of the target's maximum: light counts as in the target where the target is brighter than that
DegreesWide = Annotated[float, Field(ge=1e-3, le=360.0)]  # a length on the far field; from an arc of 4 seconds
DegreesOrZero = Annotated[float, Field(ge=0.0, le=180.0)]
DegreesOff = Annotated[float, Field(ge=-180.0, le=180.0)]
HalfAngle = Annotated[float, Field(ge=0.1, le=90.0)]
Unit = Literal["mm", "deg"]
_UNITS: tuple[Unit, Unit] = ("deg", "mm")
Places = Float[np.ndarray, "..."]
_CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
_CIRCLE = tuple((cos(k * pi / 32.0), sin(k * pi / 32.0)) for k in range(64))
Side = Millimetres | tuple[Millimetres, Millimetres]
SideDegrees = DegreesWide | tuple[DegreesWide, DegreesWide]


@public
class InOneUnit(Section):
    """Lengths, each with a field in mm and one in degrees: ``diameter_mm``, ``diameter_deg``; all are in one unit."""

    needs: ClassVar[tuple[str, ...]] = ()  # lengths without their unit, each of which must be given
    takes: ClassVar[tuple[str, ...]] = ()  # and those that may be

    @property
    def in_unit(self) -> Unit:
        """Unit of the lengths; mm where none is given."""
        return self.given_unit or "mm"

    @property
    def given_unit(self) -> Unit | None:
        """Unit of the lengths that are given; None without any."""
        names = (*self.needs, *self.takes)
        return next((unit for unit in _UNITS if any(self.length(name, unit) is not None for name in names)), None)

    def length(self, name: str, unit: Unit | None = None) -> Any:
        """Length ``name`` in ``unit``, by default the section's own; None if it is not given."""
        return getattr(self, f"{name}_{unit or self.in_unit}", None)

    @check
    def _lengths_have_one_unit(self) -> None:
        unit = self.in_unit
        for name in (*self.needs, *self.takes):
            for other in _UNITS:
                if other != unit and self.length(name, other) is not None:
                    raise ValueError(f"{name}_{other} is given among lengths in {unit}; give {name}_{unit}")
        for name in self.needs:
            if self.length(name) is None:
                raise ValueError(f"{name}_{unit}: missing; give it, in {'mm' if unit == 'mm' else 'degrees'}")


@public
class TargetSection(OfSeveralKinds, InOneUnit):
    """Light wanted on a receiver: a pattern of irradiance, or of intensity on the far field.

    Its receiver: either ``distance_mm`` and ``receiver_mm``, a square in a plane at right angles to the axis; or
    ``half_angle_deg``, the far field about the axis; neither inside ``[[receivers]]``.

    Lengths are in mm (``*_mm``), on the far field in degrees (``*_deg``): along x gamma cos(azimuth), along y gamma
    sin(azimuth), gamma the angle from the receiver's axis. With x to the right and y up, a target is as seen from
    behind its receiver, towards the lens: who looks from the lens at a wall sees it mirrored.
    """

    takes: ClassVar[tuple[str, ...]] = ("centre", "uniform")
    far_field_only: ClassVar[bool] = False
    phrase: ClassVar[str]  # for it, by its fields and by the names of its lengths
    across: ClassVar[str] = "width"  # the length that says how wide it is, where it has one
    is_round: ClassVar[bool] = False  # an ellipse bounds it, not a rectangle
    has_own_edge: ClassVar[bool] = False  # its light falls at the edge already
    has_word: ClassVar[bool] = False  # `lensforge new` takes what it needs in a word, ring:OUTERxINNER

    kind: str
    distance_mm: Millimetres | None = Field(default=None, description="Distance of the plane from the origin.")
    receiver_mm: Millimetres | None = Field(default=None, description="Side of the square receiver in that plane.")
    half_angle_deg: HalfAngle | None = Field(
        default=None, description="Largest angle of the receiver in the far field from its axis."
    )
    centre_mm: tuple[Coordinate, Coordinate] | None = Field(
        default=None, description="Centre of the pattern on a surface."
    )
    centre_deg: tuple[DegreesOff, DegreesOff] | None = None
    rotation_deg: Turn = Field(
        default=0.0,
        description="Turn of the pattern about its centre, from x towards y: counter-clockwise, seen from behind "
        "the receiver.",
    )
    level: Annotated[float, Field(ge=1e-9, le=1e9)] = Field(
        default=1.0, description="Peak of the pattern, relative to the other targets of the receiver."
    )
    uniform_mm: Side | None = Field(
        default=None,
        description="Side, or width and height, of the rectangle about its centre whose uniformity counts, on a "
        "surface.",
    )
    uniform_deg: SideDegrees | None = None

    @check
    def _fits_its_receiver(self) -> None:
        unit = self.unit
        if self.half_angle_deg is not None and (self.distance_mm, self.receiver_mm) != (None, None):
            raise ValueError("half_angle_deg is the far field, distance_mm and receiver_mm are a plane; give one")
        if self.distance_mm is None and self.receiver_mm is not None:
            raise ValueError("distance_mm: missing; a plane on the axis has both distance_mm and receiver_mm")
        if self.on_receiver is not None and self.on_receiver != unit:
            if self.far_field_only:
                raise ValueError("it is light of the far field; give half_angle_deg, not distance_mm and receiver_mm")
            where = "on the far field lengths are in degrees" if unit == "mm" else "on a plane lengths are in mm"
            raise ValueError(f"{where}; give {', '.join(f'{name}_{self.on_receiver}' for name in self.needs)}")

    @property
    def in_unit(self) -> Unit:
        """Unit of the target's lengths; without any that of its receiver."""
        return self.given_unit or self.on_receiver or "mm"

    @property
    def unit(self) -> Unit:
        """Unit of the target's lengths."""
        return self.in_unit

    @property
    def on_receiver(self) -> Unit | None:
        """Unit of lengths on the receiver that the target itself names; None if it names none."""
        return "deg" if self.half_angle_deg is not None else "mm" if self.distance_mm is not None else None

    def size(self, name: str) -> float:
        """Length ``name``, a single number that has been given, in the target's unit."""
        value = self.length(name)
        assert isinstance(value, float), name
        return value

    def pair(self, name: str) -> tuple[float, float] | None:
        """Length ``name`` along x and along y; one number counts for both."""
        value = self.length(name)
        return (value, value) if isinstance(value, float) else value

    def sides(self, name: str) -> tuple[float, float]:
        """Length ``name``, which has been given, along x and along y."""
        value = self.pair(name)
        assert value is not None, name
        return value

    def light(self, x: Places, y: Places) -> Places:
        """Relative light at places about its centre, in its unit, that broadcast; with sharp edges.

        Edges are softened, and light is averaged over pixels, where the places are pixels. On the far field it is the
        intensity at angles along x and y.
        """
        raise NotImplementedError

    @property
    def edge(self) -> float:
        """Standard deviation of the Gaussian that softens its edges, in its unit; 0: sharp."""
        return 0.0

    @property
    def bounds(self) -> tuple[float, float] | None:
        """Width and height of the pattern in its unit, as high as wide without a height; None without a size."""
        across = self.pair(self.across)
        return None if across is None else (across[0], self.length("height") or across[1])

    @property
    def outline(self) -> tuple[complex, ...]:
        """Places x + iy about its centre that bound it; its middle line without a height, none without a size."""
        if self.bounds is None:
            return ()
        if "height" in self.takes and self.pair("height") is None:
            return complex(0.5 * self.bounds[0]), complex(-0.5 * self.bounds[0])
        around = _CIRCLE if self.is_round else _CORNERS
        return tuple(complex(0.5 * self.bounds[0] * x, 0.5 * self.bounds[1] * y) for x, y in around)

    @property
    def description(self) -> str:
        """The target in a few words; of a length that differs along x and y both."""
        named = [name for name in (*self.needs, *self.takes) if f"{{{name}}}" in self.phrase]
        return self.phrase.format(self, **{name: self._in_words(name) for name in named})

    def _in_words(self, name: str) -> str:
        unit = "°" if self.unit == "deg" else " mm"
        return " × ".join(f"{side:g}{unit}" for side in dict.fromkeys(self.sides(name)))

    def about_centre(self, x: Places, y: Places) -> tuple[Places, Places]:
        """Places on the receiver in the target's own axes; the same bits where it is centred and upright."""
        if self.centre != (0.0, 0.0):
            x, y = x - self.centre[0], y - self.centre[1]
        if self.rotation_deg != 0.0:
            cosine = np.cos(np.radians(self.rotation_deg))
            sine = np.sin(np.radians(self.rotation_deg))
            x, y = cosine * x + sine * y, cosine * y - sine * x
        return x, y

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the pattern on its receiver, in the target's unit."""
        return self.pair("centre") or (0.0, 0.0)


@public
class SoftTarget(TargetSection):
    """A target with sharp edges that a Gaussian softens."""

    takes: ClassVar[tuple[str, ...]] = (*TargetSection.takes, "edge")

    edge_mm: Annotated[float, Field(ge=0.0, le=1e9)] | None = Field(
        default=None,
        description="Standard deviation of the Gaussian that softens edges, on a surface; by default they are sharp.",
    )
    edge_deg: DegreesOrZero | None = None

    @property
    def edge(self) -> float:
        """Standard deviation of the edges in the target's unit; 0: sharp."""
        value = self.length("edge")
        return value if isinstance(value, float) else 0.0


@public
class SizedTarget(TargetSection):
    """A target by its width and height."""

    needs: ClassVar[tuple[str, ...]] = ("width", "height")

    width_mm: Millimetres | None = Field(default=None, description="Whole width, along x, on a surface.")
    height_mm: Millimetres | None = Field(
        default=None,
        description="Whole height, along y, on a surface; by default as the width of a flat top, in proportion of "
        "a picture.",
    )
    width_deg: DegreesWide | None = None
    height_deg: DegreesWide | None = None
