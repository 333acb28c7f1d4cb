"""Fields of every target: where it lies on its receiver, and how bright it is among several."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from lensforge.spec.emitter import Turn
from lensforge.spec.section import Coordinate, Millimetres, Section

IN_TARGET = 0.1  # of the target's maximum: light counts as in the target where the target is brighter than that
DegreesWide = Annotated[float, Field(ge=1e-3, le=360.0)]  # a length on the far field; from an arc of 4 seconds
DegreesOrZero = Annotated[float, Field(ge=0.0, le=180.0)]
DegreesOff = Annotated[float, Field(ge=-180.0, le=180.0)]
HalfAngle = Annotated[float, Field(ge=0.1, le=90.0)]
Unit = Literal["mm", "deg"]
_Places = Float[np.ndarray, "..."]
Side = Millimetres | tuple[Millimetres, Millimetres]
SideDegrees = DegreesWide | tuple[DegreesWide, DegreesWide]


class TargetSection(Section):
    """Light wanted on a receiver: a pattern of irradiance, or of intensity on the far field.

    Its receiver: either ``distance_mm`` and ``receiver_mm``, a square in a plane at right angles to the axis; or
    ``half_angle_deg``, the far field about the axis; neither inside ``[[receivers]]``.

    Lengths are in mm (``*_mm``), on the far field in degrees (``*_deg``): along x gamma cos(azimuth), along y gamma
    sin(azimuth), gamma the angle from the receiver's axis.
    """

    needs: ClassVar[tuple[str, ...]] = ()  # lengths without their unit, each of which must be given
    takes: ClassVar[tuple[str, ...]] = ("centre", "uniform")  # and those that may be
    far_field_only: ClassVar[bool] = False

    kind: str
    distance_mm: Millimetres | None = None
    """Distance of the plane from the origin."""
    receiver_mm: Millimetres | None = None
    """Side of the square receiver in that plane."""
    half_angle_deg: HalfAngle | None = None
    """Largest angle of the receiver in the far field from its axis."""
    centre_mm: tuple[Coordinate, Coordinate] | None = None
    """Centre of the pattern on a surface."""
    centre_deg: tuple[DegreesOff, DegreesOff] | None = None
    """Centre of the pattern in the far field."""
    rotation_deg: Turn = 0.0
    """Turn of the pattern about its centre, from x towards y."""
    level: Annotated[float, Field(ge=1e-9, le=1e9)] = 1.0
    """Peak of the pattern, relative to the other targets of the receiver."""
    uniform_mm: Side | None = None
    """Side, or width and height, of the rectangle about its centre whose uniformity counts, on a surface."""
    uniform_deg: SideDegrees | None = None
    """Side, or width and height, of the rectangle about its centre whose uniformity counts, in the far field."""

    @model_validator(mode="after")
    def _lengths_have_one_unit(self) -> "TargetSection":
        unit = self.unit
        for name in (*self.needs, *self.takes):
            if self.length(name, "deg" if unit == "mm" else "mm") is not None:
                given, other = (f"{name}_{each}" for each in (("deg", "mm") if unit == "mm" else ("mm", "deg")))
                raise ValueError(f"{given} is given among lengths in {unit}; give {other}")
        for name in self.needs:
            if self.length(name, unit) is None:
                raise ValueError(f"{name}_{unit}: missing; give it, in {'mm' if unit == 'mm' else 'degrees'}")
        if self.half_angle_deg is not None and (self.distance_mm, self.receiver_mm) != (None, None):
            raise ValueError("half_angle_deg is the far field, distance_mm and receiver_mm are a plane; give one")
        if self.distance_mm is None and self.receiver_mm is not None:
            raise ValueError("distance_mm: missing; a plane on the axis has both distance_mm and receiver_mm")
        if self.on_receiver is not None and self.on_receiver != unit:
            if self.far_field_only:
                raise ValueError("it is light of the far field; give half_angle_deg, not distance_mm and receiver_mm")
            where = "on the far field lengths are in degrees" if unit == "mm" else "on a plane lengths are in mm"
            raise ValueError(f"{where}; give {', '.join(f'{name}_{self.on_receiver}' for name in self.needs)}")
        return self

    @property
    def unit(self) -> Unit:
        """Unit of the target's lengths; without any that of its receiver."""
        names = (*self.needs, *self.takes)
        if any(getattr(self, f"{name}_deg", None) is not None for name in names):
            return "deg"
        if any(getattr(self, f"{name}_mm", None) is not None for name in names):
            return "mm"
        return self.on_receiver or "mm"

    @property
    def on_receiver(self) -> Unit | None:
        """Unit of lengths on the receiver that the target itself names; None where it names none."""
        return "deg" if self.half_angle_deg is not None else "mm" if self.distance_mm is not None else None

    def length(self, name: str, unit: Unit | None = None) -> float | tuple[float, float] | None:
        """Length ``name`` in ``unit``, by default the target's own; None where it is not given."""
        value: float | tuple[float, float] | None = getattr(self, f"{name}_{unit or self.unit}", None)
        return value

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

    def about_centre(self, x: _Places, y: _Places) -> tuple[_Places, _Places]:
        """Places on the receiver in the target's own axes; the same bits where it is centred and upright."""
        if self.centre != (0.0, 0.0):
            x, y = x - self.centre[0], y - self.centre[1]
        if self.rotation_deg != 0.0:
            cosine, sine = np.cos(np.radians(self.rotation_deg)), np.sin(np.radians(self.rotation_deg))
            x, y = cosine * x + sine * y, cosine * y - sine * x
        return x, y

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the pattern on its receiver, in the target's unit."""
        return self.pair("centre") or (0.0, 0.0)


class SoftTarget(TargetSection):
    """A target with sharp edges that a Gaussian softens."""

    takes: ClassVar[tuple[str, ...]] = (*TargetSection.takes, "edge")

    edge_mm: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    """Standard deviation of the Gaussian that softens edges, on a surface; by default they are sharp."""
    edge_deg: DegreesOrZero | None = None
    """Standard deviation of the Gaussian that softens edges, in the far field; by default they are sharp."""

    @property
    def edge(self) -> float:
        """Standard deviation of the edges in the target's unit; 0: sharp."""
        value = self.length("edge")
        return value if isinstance(value, float) else 0.0
