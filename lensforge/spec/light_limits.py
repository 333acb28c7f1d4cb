"""Limits of the light beside targets: ``[[limits]]`` at points, lines, zones and angles, and ``[photometry]``.

Limits are compared with the receivers that they are on: their units, and places off the receiver. The photometry names
which lighting the lens is for.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import cos, hypot, pi, radians, sin
from typing import Annotated, Any, ClassVar, Literal, Protocol, get_args

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from lensforge.optics.pose import ORIGIN
from lensforge.public import public
from lensforge.results.numerals import unit_in
from lensforge.results.record import Sense
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.housing_sections import HousingSection
from lensforge.spec.quantities import (
    BeamAngle,
    BodyLight,
    BodyMean,
    Contrast,
    FluxShare,
    LeastOverMean,
    LeastOverMost,
    LostShare,
    MeanLight,
    PlaceLight,
    Quantity,
    RelativeLight,
)
from lensforge.spec.receiver_fields import OF_RECEIVER, Direction, ReceiverSection, require_on
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.shape_targets import DiscTarget, EllipseTarget, PolygonTarget, RectangleTarget, RingTarget
from lensforge.spec.spec_section import Coordinate, Label, Section, check, fault_of
from lensforge.spec.target_sections import DegreesOff, InOneUnit, TargetSection, Unit

Amount = Annotated[float, Field(ge=1e-30, le=1e12)]
Fraction = Annotated[float, Field(gt=0.0, le=1.0)]
Azimuth = Annotated[float, Field(ge=-360.0, le=360.0)]
LossCause = Literal["beside", "opening", "base", "flange", "total_reflection", "trapped", "housing"]
LightUnitName = Literal[
    "w_per_m2", "mw_per_cm2", "mj_per_cm2", "lx", "umol_per_m2_s", "w_per_sr", "cd", "w_per_m2_sr", "cd_per_m2",
    "relative",
]  # fmt: skip
LIGHT_UNITS: tuple[LightUnitName, ...] = get_args(LightUnitName)
Places = Float[np.ndarray, "*_"]
_Quantities = Mapping[str, type[Quantity]]
OF_MEAN = "mean_"  # before a unit: the mean light in it is bounded
PHOTONS = "umol_per_m2_s"  # photosynthetic photon flux density, PPFD
DOSE = "mj_per_cm2"  # irradiance over the time of an exposure
_OF_SURFACES = ("w_per_m2", "mw_per_cm2", DOSE, "lx", PHOTONS)
_OF_FAR_FIELD = ("w_per_sr", "cd")
_OF_EYES = ("w_per_m2_sr", "cd_per_m2")
_MOST_POINTS = 1000
_MOST_EYES = 16
ZONES = RectangleTarget | DiscTarget | EllipseTarget | RingTarget | PolygonTarget
_OF_PICTURES = ("level", "uniform_mm", "uniform_deg", "edge_mm", "edge_deg")


class ReceiverPicture(Protocol):
    """Picture of a receiver, as a limit asks where to read it; places (x, y) are in the receiver's unit."""

    @property
    def half(self) -> float:
        """Largest distance from the axis within which every place is on the picture."""

    @property
    def steps(self) -> int:
        """Places along a cut through the whole picture, less one."""

    def steps_between(self, start: tuple[float, float], end: tuple[float, float]) -> int:
        """Places from ``start`` to ``end``, less one; at least one."""


@public
class LimitSection(OfSeveralKinds, InOneUnit):
    """Fields of every limit. A kind of limit is a class that extends this one: it registers itself.

    Light is that of the evaluation's picture, after its filter, bilinear between pixels.
    """

    takes: ClassVar[tuple[str, ...]] = ("meter",)
    # What may be bounded besides light, by the ends of the fields that bound it.
    others: ClassVar[_Quantities] = {}

    far_field_only: ClassVar[bool] = False
    of_receiver: ClassVar[bool] = True

    kind: str
    name: Label | None = Field(default=None, description="Name in records and on pages.")
    receiver: Annotated[str, Field(max_length=64)] | None = Field(
        default=None, description="Name of the receiver, by default the first."
    )
    at_least: Amount | None = Field(default=None, description="Minimum light, in `unit`.")
    at_most: Amount | None = Field(default=None, description="Maximum light, in `unit`.")
    unit: LightUnitName | None = Field(
        default=None,
        description="Unit of both: irradiance, dose, illuminance or PPFD (photons from 400 to 700 nm) on surfaces, "
        'intensity in the far field, radiance or luminance for eyes, or "relative" to the maximum on the receiver.',
    )
    exposure_s: Annotated[float, Field(ge=1e-9, le=1e9)] | None = Field(
        default=None, description="Time for which the light is on, where the limit is on a dose."
    )
    meter_mm: Annotated[float, Field(ge=1e-3, le=1e5)] | None = Field(
        default=None,
        description="Diameter of the light meter: its reading is the mean light over such a disc. By default the "
        "filter of the picture, which is as wide as a meter of four pixels.",
    )
    meter_deg: Annotated[float, Field(ge=1e-4, le=90.0)] | None = None

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Its places on the receiver, in their unit."""
        return tuple(self.length(name) for name in self.needs)

    def labels(self, number: int) -> list[str]:
        """Name of each of its judgements, where it is limit ``number``: of one, unless many are judged apart."""
        return [self.name or f"limits.{number}"]

    def bounds(self, quantity: str) -> tuple[float | None, float | None]:
        """Least and largest value of ``quantity``, a unit of light or one of ``others``; None if it has no bound."""
        if quantity in LIGHT_UNITS:
            return (self.at_least, self.at_most) if quantity == self.unit else (None, None)
        return getattr(self, f"at_least_{quantity}", None), getattr(self, f"at_most_{quantity}", None)

    def quantities(self) -> Iterator[str]:
        """The quantities that are bounded."""
        yield from (name for name in (*LIGHT_UNITS, *self.others) if any(self.bounds(name)))

    @property
    def bounds_dose(self) -> bool:
        """True where it bounds a dose, for which the time of the exposure is needed."""
        return any(bounded.endswith(DOSE) for bounded in self.quantities())

    @property
    def counts_photons(self) -> bool:
        """True where it bounds photons, for which the spectrum is needed."""
        return any(bounded.endswith(PHOTONS) for bounded in self.quantities())

    def quantity(self, bounded: str, at: Places) -> Quantity:
        """Quantity that is bounded, a unit of light or one of ``others``; ``at``: places (x, y) that are read."""
        if bounded in LIGHT_UNITS:
            return RelativeLight() if bounded == "relative" else PlaceLight()
        return self.others[bounded]()

    def unit_of(self, bounded: str) -> str:
        """Symbol of the unit of what is bounded."""
        return unit_in(f"_{bounded}")

    def read_at(self, picture: ReceiverPicture) -> Places | None:
        """Places (x, y) at which it reads the ``picture``; None if it reads the pixels that it ``contains``."""
        return None

    def reads_as(self, other: "LimitSection") -> bool:
        """True for an ``other`` limit of the same figures, wherever it reads them."""
        return type(other) is type(self)

    def contains(self, x: Places, y: Places) -> Bool[np.ndarray, "*_"]:
        """True at the places that it covers; everywhere by default."""
        return np.ones(np.shape(x), dtype=bool)

    @check
    def _bounds_something_once(self) -> None:
        if (self.unit is None) != (self.at_least is None and self.at_most is None):
            raise ValueError(f"at_least or at_most, and unit go together; unit is one of {', '.join(LIGHT_UNITS)}")
        if self.unit == "relative" and max(self.at_least or 0.0, self.at_most or 0.0) > 1.0:
            raise ValueError('unit = "relative" is a share of the maximum on the receiver; no light is above 1')
        if self.bounds_dose != (self.exposure_s is not None):
            raise ValueError(f"a dose ({DOSE}) and exposure_s, the time for which the light is on, go together")
        bounded = list(self.quantities())
        if not bounded:
            either = ", ".join(("at_least with a unit", *(f"at_least_{name}" for name in self.others)))
            raise ValueError(f"it sets no limit; give {either}, or the same as at_most")
        for name in bounded:
            least, most = self.bounds(name)
            if least is not None and most is not None and least > most:
                raise ValueError(f"at least {least:g} {name} is above at most {most:g}: no light is both")


@public
class PointsLimit(LimitSection):
    """Light at each of some points (x, y)."""

    needs: ClassVar[tuple[str, ...]] = ("at",)

    kind: Literal["points"] = "points"
    at_mm: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=1, max_length=_MOST_POINTS)] | None = (
        Field(default=None, description="Places (x, y) on a surface.")
    )
    at_deg: (
        Annotated[tuple[tuple[DegreesOff, DegreesOff], ...], Field(min_length=1, max_length=_MOST_POINTS)] | None
    ) = None

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The points."""
        return self.length("at")

    def read_at(self, picture: ReceiverPicture) -> Places:
        """The points."""
        return np.array(self.places)


@public
class LineLimit(LimitSection):
    """Light everywhere on a line between two places."""

    needs: ClassVar[tuple[str, ...]] = ("from", "to")

    kind: Literal["line"] = "line"
    from_mm: tuple[Coordinate, Coordinate] | None = Field(default=None, description="First end on a surface.")
    to_mm: tuple[Coordinate, Coordinate] | None = Field(default=None, description="Second end on a surface.")
    from_deg: tuple[DegreesOff, DegreesOff] | None = None
    to_deg: tuple[DegreesOff, DegreesOff] | None = None

    def read_at(self, picture: ReceiverPicture) -> Places:
        """Places so close that the light between them is bilinear."""
        start, end = self.places
        part = np.linspace(0.0, 1.0, picture.steps_between(start, end) + 1)
        return np.array(start) + part[:, None] * (np.array(end) - np.array(start))


@public
class ZoneLimit(LimitSection):
    """Light in a zone: everywhere in it, how even it is, and its share."""

    others: ClassVar[_Quantities] = {
        "min_over_mean": LeastOverMean,
        "min_over_max": LeastOverMost,
        "contrast": Contrast,
        "mean_lx": MeanLight,
        "mean_w_per_m2": MeanLight,
        "mean_mw_per_cm2": MeanLight,
        "mean_mj_per_cm2": MeanLight,
        "mean_umol_per_m2_s": MeanLight,
        "share": FluxShare,
    }

    kind: Literal["zone"] = "zone"
    zone: Annotated[ZONES, Field(discriminator="kind")] | None = Field(
        default=None, description="Shape of the zone; by default the whole window of the receiver."
    )
    at_least_min_over_mean: Fraction | None = Field(
        default=None, description="Smallest allowed min/mean of the light in the zone."
    )
    at_least_min_over_max: Fraction | None = Field(
        default=None, description="Smallest allowed min/max of the light in the zone."
    )
    at_least_mean_lx: Amount | None = Field(default=None, description="Least mean illuminance of the zone.")
    at_most_mean_lx: Amount | None = Field(default=None, description="Largest mean illuminance of the zone.")
    at_least_mean_w_per_m2: Amount | None = Field(default=None, description="Least mean irradiance of the zone.")
    at_most_mean_w_per_m2: Amount | None = Field(default=None, description="Largest mean irradiance of the zone.")
    at_least_mean_mw_per_cm2: Amount | None = Field(
        default=None, description="Least mean irradiance of the zone, as curing states it."
    )
    at_most_mean_mw_per_cm2: Amount | None = Field(default=None, description="Largest mean irradiance of the zone.")
    at_least_mean_mj_per_cm2: Amount | None = Field(default=None, description="Least mean dose of the zone.")
    at_most_mean_mj_per_cm2: Amount | None = Field(default=None, description="Largest mean dose of the zone.")
    at_least_mean_umol_per_m2_s: Amount | None = Field(
        default=None, description="Least mean PPFD of the zone, photons from 400 to 700 nm."
    )
    at_most_mean_umol_per_m2_s: Amount | None = Field(default=None, description="Largest mean PPFD of the zone.")
    at_most_contrast: Fraction | None = Field(
        default=None,
        description="Largest allowed (max − min)/(max + min) of the light in the zone, the non-uniformity of "
        "IEC 60904-9: 0.01 for class A+, 0.02 for A, 0.05 for B, 0.1 for C.",
    )
    at_least_share: Fraction | None = Field(default=None, description="Least share of the flux of the source.")
    at_most_share: Fraction | None = Field(default=None, description="Largest share of the flux of the source.")

    @property
    def given_unit(self) -> Unit | None:
        """Unit of the zone; that of the meter for the whole window."""
        return super().given_unit if self.zone is None else self.zone.unit

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The zone's centre."""
        return () if self.zone is None else (self.zone.centre,)

    def contains(self, x: Places, y: Places) -> Bool[np.ndarray, "*_"]:
        """Places in the zone."""
        return super().contains(x, y) if self.zone is None else self.zone.contains(*self.zone.about_centre(x, y))

    @check
    def _zone_is_a_shape(self) -> None:
        zone = self.zone
        if zone is None:
            return
        for name, default in _not_of_zones(zone).items():
            if getattr(zone, name) != default:
                raise ValueError(f"zone.{name}: a zone is a shape on the limit's receiver; leave it out")


def _not_of_zones(shape: TargetSection) -> dict[str, Any]:
    """Fields of a ``shape`` that no zone has, each with its default."""
    fields = type(shape).model_fields
    return {name: fields[name].default for name in (*OF_RECEIVER, *_OF_PICTURES) if name in fields}


def zone_of(target: TargetSection) -> TargetSection:
    """Shape of a ``target``, one of :data:`ZONES`, as the zone of a limit."""
    return target.changed(**_not_of_zones(target))


@public
class GlareLimit(LimitSection):
    """Intensity in all directions of the far field at ``from_deg`` and more from its axis: at most so much."""

    needs: ClassVar[tuple[str, ...]] = ("from",)
    far_field_only: ClassVar[bool] = True

    kind: Literal["glare"] = "glare"
    from_deg: Annotated[float, Field(ge=0.0, le=180.0)] = Field(
        description="Angle from the receiver's axis from which on the limit holds."
    )

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """A direction at that angle."""
        return ((self.from_deg, 0.0),)

    def contains(self, x: Places, y: Places) -> Bool[np.ndarray, "*_"]:
        """Directions that far from the axis."""
        return np.asarray(np.hypot(x, y) >= self.from_deg)

    @check
    def _caps(self) -> None:
        if self.at_least is not None:
            raise ValueError("glare has a largest intensity, no least one; give at_most")


@public
class BeamAngleLimit(LimitSection):
    """Full angle in the far field over which the intensity is above a level, in one plane.

    Between the outermost directions of that level.
    """

    others: ClassVar[_Quantities] = {"deg": BeamAngle}
    far_field_only: ClassVar[bool] = True

    kind: Literal["beam_angle"] = "beam_angle"
    azimuth_deg: Azimuth = Field(default=0.0, description="Azimuth of the plane through the axis, from x towards y.")
    level: Annotated[float, Field(ge=0.01, le=0.99)] = Field(
        default=0.5, description="Level that bounds the beam, relative to the maximum."
    )
    at_least_deg: Annotated[float, Field(gt=0.0, le=180.0)] | None = Field(
        default=None, description="Least full angle."
    )
    at_most_deg: Annotated[float, Field(gt=0.0, le=180.0)] | None = Field(
        default=None, description="Largest full angle."
    )

    def read_at(self, picture: ReceiverPicture) -> Places:
        """Directions along a cut through the far field."""
        turn = radians(self.azimuth_deg)
        return self._angles(picture.half, picture.steps)[:, None] * np.array([cos(turn), sin(turn)])

    def quantity(self, bounded: str, at: Places) -> Quantity:
        """The angle along the cut."""
        return BeamAngle(self._angles(float(np.hypot(*at[0])), len(at) - 1), self.level)

    @staticmethod
    def _angles(half_deg: float, steps: int) -> Places:
        return np.linspace(-half_deg, half_deg, steps + 1)

    @check
    def _bounds_the_angle(self) -> None:
        if self.unit is not None:
            raise ValueError("a beam angle is bounded by at_least_deg and at_most_deg")


@public
class LossLimit(LimitSection):
    """Light of no use: the share of the flux of the source that ends by one cause."""

    others: ClassVar[_Quantities] = {"share": LostShare}

    kind: Literal["loss"] = "loss"
    cause: Annotated[str, Field(max_length=64)] = Field(
        description='"beside": leaves the lens, and reaches no window of the receiver. "opening": starts outside '
        'the cavity, or goes back through its opening. "base": in the body, down through z = 0. '
        '"flange": at the flange. "total_reflection": at a face that lets light out. "trapped": still '
        'in the body after all its events. "housing": blocked by bodies of the scene. Or the name of a face by which '
        'light is not to leave, such as "wall". The search lowers light beside, by faces, by total reflection and by '
        "bodies."
    )
    at_most_share: Fraction = Field(description="Largest share of the flux of the source.")

    @check
    def _bounds_the_share(self) -> None:
        if self.unit is not None or self.given_unit is not None:
            raise ValueError("a loss is bounded by at_most_share alone")


@public
class BlockedLimit(LossLimit):
    """Light that the bodies of the scene keep from a receiver: the share of the flux of the source."""

    kind: Literal["blocked"] = "blocked"  # type: ignore[assignment]  # a kind of its own
    cause: Annotated[str, Field(pattern="^housing$")] = Field(default="housing", description="Bodies of the scene.")


@public
class BodyLimit(LimitSection):
    """Light on the surface of a body of the scene, on all of its sides, in its own shadow and in that of others.

    The search knows it where one lamp lights it.
    """

    of_receiver: ClassVar[bool] = False

    kind: Literal["body"] = "body"
    body: Annotated[str, Field(max_length=64)] = Field(description="Name of the body, which has `patch_mm`.")
    of: Literal["patch", "mean"] = Field(
        default="patch", description="The patch with the least or the most light, or the mean over all that count."
    )
    facing: Direction | None = Field(
        default=None, description="Direction (x, y, z) that patches face if they count; by default all do."
    )
    within_deg: Annotated[float, Field(gt=0.0, le=180.0)] = Field(
        default=90.0, description="Largest angle of their normals with `facing`."
    )

    def quantity(self, bounded: str, at: Places) -> Quantity:
        """Light on patches, or its mean."""
        return BodyMean() if self.of == "mean" else BodyLight()

    def counts(self, normals: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
        """True for patches that count, by their unit ``normals``."""
        if self.facing is None:
            return np.ones(len(normals), dtype=bool)
        facing = np.array(self.facing) / hypot(*self.facing)
        return np.asarray(normals @ facing >= cos(radians(self.within_deg)))

    @check
    def _is_of_a_body(self) -> None:
        if self.receiver is not None:
            raise ValueError("receiver: it is on the body itself; leave it out")
        if self.given_unit is not None:
            raise ValueError("meter: light on a body is the mean of a patch; give the body patch_mm")
        if self.unit not in _OF_SURFACES:
            raise ValueError(f"give at_least or at_most, and unit: {', '.join(_OF_SURFACES)}")
        if self.facing == ORIGIN:
            raise ValueError("facing = (0, 0, 0) is no direction")


_Point = tuple[Coordinate, Coordinate, Coordinate]
_Angle = Annotated[float, Field(ge=1e-3, le=45.0)]


_LEAST_RING_DEG = 15.0
_RING_STEP_DEG = 15.0
_MOST_RING_BLUR_DEG = 5.0


@public
class LuminanceLimit(LimitSection):
    """Luminance of the lens as eyes see it: at most so much over any spot, or its mean. Each eye is judged alone, those
    of a ring together.

    They see one lens, of several lamps that of the first, lit by its own LED.
    """

    of_receiver: ClassVar[bool] = False

    kind: Literal["luminance"] = "luminance"
    of: Literal["peak", "mean"] = Field(
        default="peak",
        description="The largest mean over a spot, or the mean over the outline of all places that light leaves.",
    )
    eyes_mm: Annotated[tuple[_Point, ...], Field(min_length=1, max_length=_MOST_EYES)] | None = Field(
        default=None, description="Places (x, y, z) of the eyes, outside of the lens."
    )
    eyes_deg: (
        Annotated[tuple[tuple[DegreesOff, DegreesOff], ...], Field(min_length=1, max_length=_MOST_EYES)] | None
    ) = Field(default=None, description="Directions (x, y) from the axis of eyes far away; or give `eyes_mm`.")
    from_deg: Annotated[float, Field(ge=_LEAST_RING_DEG, le=85.0)] | None = Field(
        default=None,
        description="Angle from the axis from which on eyes look from all around, far away: the brightest that "
        "any sees is judged.",
    )
    spot_deg: _Angle | None = Field(
        default=None,
        description="Diameter of the spot at `eyes_mm`; by default a minute of arc, 1/60, the finest that eyes "
        "resolve.",
    )
    spot_mm: Annotated[float, Field(ge=1e-3, le=1e3)] | None = Field(
        default=None, description="Diameter of the spot on the lens, for `eyes_deg`: 0.58 is a minute of arc 2 m away."
    )
    blur_deg: Annotated[float, Field(ge=0.1, le=30.0)] = Field(
        default=2.0,
        description="Largest angle at which a ray counts that does not just meet the eye: less is sharper, and "
        "has more noise.",
    )

    def eyes(self) -> Iterator[tuple[str, tuple[float, ...]]]:
        """Words for each eye, and its place (mm), or its direction (degrees)."""
        unit = "°" if self.eyes_mm is None else "mm"
        for eye in self.eyes_mm or self.eyes_deg or self._ring():
            yield f"({', '.join(f'{coordinate:g}' for coordinate in eye)}) {unit}".replace(" °", "°"), eye

    def _ring(self) -> Iterator[tuple[float, float]]:
        """Directions (degrees) all around, about as far apart as angles from the axis: multiples of eight of each."""
        angle = self.from_deg or 90.0
        while angle < 90.0:
            count = 8 * max(1, round(3.0 * sin(radians(angle))))
            for number in range(count):
                turn = 2.0 * pi * number / count
                yield round(angle * cos(turn), 6) + 0.0, round(angle * sin(turn), 6) + 0.0  # no -0
            angle += _RING_STEP_DEG

    def eye_labels(self, number: int) -> list[str]:
        """Name with the place of each eye."""
        return [f"{self.name or f'limits.{number}'}, seen from {place}" for place, _ in self.eyes()]

    def labels(self, number: int) -> list[str]:
        """Name with the place of each eye, or with the angle of a ring of them."""
        if self.from_deg is None:
            return self.eye_labels(number)
        return [f"{self.name or f'limits.{number}'}, seen from {self.from_deg:g}° up, all around"]

    @check
    def _is_seen(self) -> None:
        if sum(eyes is not None for eyes in (self.eyes_mm, self.eyes_deg, self.from_deg)) != 1:
            raise ValueError(
                "give one of eyes_mm, places (x, y, z), eyes_deg, directions (x, y) of eyes far away, and from_deg, "
                "the angle from which on they look from all around"
            )
        if self.receiver is not None:
            raise ValueError("receiver: eyes see the lens itself; leave it out")
        if self.length("meter", "mm") is not None or self.length("meter", "deg") is not None:
            raise ValueError("meter: eyes see a spot; give spot_mm or spot_deg")
        if self.unit not in _OF_EYES or (self.at_least is not None and self.of == "peak"):
            raise ValueError(
                'the luminance of a spot has a largest value; give at_most, of = "mean" with at_least, and unit: '
                f"{', '.join(_OF_EYES)}"
            )
        if self.from_deg is not None and (self.of == "mean" or self.blur_deg > _MOST_RING_BLUR_DEG):
            raise ValueError(
                f'from_deg: eyes all around are judged by the brightest spot; give of = "peak", and blur_deg up to '
                f"{_MOST_RING_BLUR_DEG:g}"
            )
        if self.eyes_mm is None and self.spot_mm is None:
            raise ValueError("spot_mm: missing; eyes far away are at no distance: 0.58 is a minute of arc 2 m away")
        if self.spot_mm is not None and self.spot_deg is not None:
            raise ValueError("spot_deg and spot_mm are given; give one, in the far field spot_mm")


LightLimits = Annotated[tuple[LimitSection, ...], Field(max_length=1000)]


def bounds_of(limits: Sequence[LimitSection]) -> Iterator[tuple[str, Sense, float]]:
    """Name, sense and bound of each of ``limits``, in the order in which light is judged."""
    for number, limit in enumerate(limits):
        for least, most in map(limit.bounds, limit.quantities()):
            bounds: dict[Sense, float | None] = {">=": least, "<=": most}
            names = limit.labels(number)
            yield from ((name, sense, bound) for name in names for sense, bound in bounds.items() if bound is not None)


@public
class ColourSection(Section):
    """Colour of the beam, and limits on how far it is from its mean.

    A beam is where the light is above a level of its peak, on each receiver. Colours are of the CIE 1931 observer, and
    their differences are distances in u', v' (CIE 1976).
    """

    within: Literal["fwhm", "tenth"] = Field(
        default="fwhm", description="Level that bounds the beam: half of the peak, or a tenth."
    )
    max_rms_delta_uv: Fraction | None = Field(
        default=None, description="Largest root mean square of the distances from the beam's mean colour."
    )
    max_delta_uv: Fraction | None = Field(default=None, description="Largest distance from the beam's mean colour.")
    weight: Annotated[float, Field(ge=0.0, le=1e4)] = Field(
        default=0.0,
        description="Factor of colour in the merit of the search, where the error of the pattern has 1; 0: none.",
    )

    @property
    def level(self) -> float:
        """Level that bounds the beam, relative to the peak."""
        return 0.5 if self.within == "fwhm" else 0.1

    @property
    def bounds(self) -> dict[str, float]:
        """Largest distances from the mean colour that are allowed, by the figure of the beam that each bounds."""
        bounds = {"rms": self.max_rms_delta_uv, "worst": self.max_delta_uv}
        return {name: bound for name, bound in bounds.items() if bound is not None}

    @property
    def has_limits(self) -> bool:
        """True where it bounds the colour."""
        return bool(self.bounds)


def _require_limit_fits(limit: LimitSection, unit: Unit, extent: tuple[float, float], receiver: str) -> None:
    """Raise ``ValueError`` for units that ``receiver`` does not have, or places off it.

    ``unit``, ``extent``: of its places.
    """
    far_field = unit == "deg"
    if limit.far_field_only and not far_field:
        raise ValueError(f"a {limit.kind} limit is one of the far field, {receiver} is none; name a receiver that is")
    if limit.given_unit not in (None, unit):
        unit_name = "degrees" if far_field else "mm"
        raise ValueError(f"its places are in {limit.given_unit}, on {receiver} they are in {unit_name}")
    allowed = (*(_OF_FAR_FIELD if far_field else _OF_SURFACES), "relative")
    for bounded in limit.quantities():
        light = bounded.removeprefix(OF_MEAN)
        if light in LIGHT_UNITS and light not in allowed:
            raise ValueError(f"its light is in {light}, on {receiver} it is in one of {', '.join(allowed)}")
    for place in limit.places:
        require_on("the place", place, unit, extent, receiver)


def require_limits_fit(
    limits: Sequence[LimitSection],
    receivers: Sequence[ReceiverSection],
    leaks: Sequence[str],
    scene: Sequence[HousingSection] = (),
) -> None:
    """Raise ``ValueError`` for limits that name an unknown or incompatible receiver, or a body that is not measured.

    ``leaks``: names of the faces through which light can be lost. ``scene``: bodies that may block some.
    """
    causes = (*(cause for cause in get_args(LossCause) if scene or cause != "housing"), *leaks)
    measured = [body.name for body in scene if body.patch_mm is not None]
    by_name = {receiver.name: receiver for receiver in receivers}
    for number, limit in enumerate(limits):
        name = limit.receiver or next(iter(by_name))
        if name not in by_name:
            known = ", ".join(str(name) for name in by_name)
            raise ValueError(f"limits.{number}.receiver = {name!r}: there is none of that name; known: {known}")
        if isinstance(limit, BodyLimit) and limit.body not in measured:
            raise ValueError(
                f"limits.{number}.body = {limit.body!r}: the scene has no body of that name with patch_mm; "
                f"known: {', '.join(measured) or 'none'}"
            )
        if not limit.of_receiver:
            continue
        if isinstance(limit, LossLimit) and limit.cause not in causes:
            raise ValueError(f"limits.{number}.cause = {limit.cause!r}: of this scene it is one of {', '.join(causes)}")
        with fault_of(f"limits.{number}"):
            _require_limit_fits(limit, by_name[name].unit, by_name[name].extent, f"receiver {name!r}")


_FAR = 5.0  # widths of a lamp: there 1/r^2 errs by less than 1 % (five-times rule, CIE S 025)


@public
class PhotometrySection(Section):
    """Lighting that a lens is for."""

    use: Literal["general", "area"] = Field(
        default="general",
        description='Lighting: "general"; "area" adds the IES distribution type, the BUG rating and the class of '
        "glare.",
    )
    street_side_deg: Azimuth = Field(
        default=90.0, description="Direction from the lens towards the street, from its +x to its +y."
    )
    lenses: Annotated[int, Field(ge=1, le=100_000)] = Field(default=1, description="Equal lenses in a lamp.")


def require_seen_from_afar(
    section: PhotometrySection, receivers: tuple[ReceiverSection, ...], limits: ConstraintsSection
) -> None:
    """Raise ``ValueError`` where a lamp for an area has no receiver far enough to be designed for it."""
    far_mm = _FAR * 2.0 * limits.max_radius_mm
    if section.use == "general" or any(receiver.clear_mm(ORIGIN) >= far_mm for receiver in receivers):
        return
    raise ValueError(
        f'photometry.use = "{section.use}" is answered by the far field, but every receiver is nearer than {far_mm:g} '
        "mm, five times the lens's largest diameter; give a far-field target (half_angle_deg), or a plane farther away"
    )
