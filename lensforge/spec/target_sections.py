"""Targets of a spec: the fields of all, far fields by beam and photometric file, and pictures.

Every target has a place on its receiver, and a brightness among several. Pictures are text, image files, and numbers on
a grid.
"""

import unicodedata
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field

from lensforge.optics.image import Luminance
from lensforge.spec.emitter_section import Turn
from lensforge.spec.spec_section import Coordinate, FilePath, Millimetres, Numbers, Section, check

IN_TARGET = 0.1  # of the target's maximum: light counts as in the target where the target is brighter than that
DegreesWide = Annotated[float, Field(ge=1e-3, le=360.0)]  # a length on the far field; from an arc of 4 seconds
DegreesOrZero = Annotated[float, Field(ge=0.0, le=180.0)]
DegreesOff = Annotated[float, Field(ge=-180.0, le=180.0)]
HalfAngle = Annotated[float, Field(ge=0.1, le=90.0)]
Unit = Literal["mm", "deg"]
_UNITS: tuple[Unit, Unit] = ("deg", "mm")
_Places = Float[np.ndarray, "..."]
Side = Millimetres | tuple[Millimetres, Millimetres]
SideDegrees = DegreesWide | tuple[DegreesWide, DegreesWide]


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
        """Length ``name`` in ``unit``, by default the section's own; None where it is not given."""
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


class TargetSection(InOneUnit):
    """Light wanted on a receiver: a pattern of irradiance, or of intensity on the far field.

    Its receiver: either ``distance_mm`` and ``receiver_mm``, a square in a plane at right angles to the axis; or
    ``half_angle_deg``, the far field about the axis; neither inside ``[[receivers]]``.

    Lengths are in mm (``*_mm``), on the far field in degrees (``*_deg``): along x gamma cos(azimuth), along y gamma
    sin(azimuth), gamma the angle from the receiver's axis.
    """

    takes: ClassVar[tuple[str, ...]] = ("centre", "uniform")
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
    rotation_deg: Turn = 0.0
    """Turn of the pattern about its centre, from x towards y."""
    level: Annotated[float, Field(ge=1e-9, le=1e9)] = 1.0
    """Peak of the pattern, relative to the other targets of the receiver."""
    uniform_mm: Side | None = None
    """Side, or width and height, of the rectangle about its centre whose uniformity counts, on a surface."""
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
        """Unit of lengths on the receiver that the target itself names; None where it names none."""
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

    @property
    def edge(self) -> float:
        """Standard deviation of the edges in the target's unit; 0: sharp."""
        value = self.length("edge")
        return value if isinstance(value, float) else 0.0


BeamAngle = Annotated[float, Field(ge=0.1, le=170.0)]


class _FarFieldTarget(TargetSection):
    """Lengths are angles, whatever is given."""

    far_field_only: ClassVar[bool] = True

    @property
    def in_unit(self) -> Literal["deg"]:
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
    the width follows an ellipse), or "flat" up to the half width and dark beyond it, with soft edges by
    ``edge_deg``.
    """

    @check
    def _only_flat_beams_have_edges(self) -> None:
        if self.edge and self.profile != "flat":
            raise ValueError(f'edge_deg = {self.edge:g} goes with profile = "flat"; leave it out')


class BatwingTarget(_FarFieldTarget, SoftTarget):
    """Even illuminance on a plane at right angles to the axis: intensity as 1 / cos^3 of the angle.

    With ``edge_deg`` the edge is soft: the illuminance falls as the integral of a Gaussian with that standard
    deviation, and is one half at ``to_deg``.
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


# Unicode's general categories of control characters, format characters, surrogates, and breaks of lines and paragraphs.
_NOT_DRAWN = ("Cc", "Cf", "Cs", "Zl", "Zp")
_MOST_VALUES = 2**26  # of an array, as many as a picture may have pixels


def _visible(text: str) -> str:
    """``text`` itself. Raises :class:`ValueError` for characters that no font draws."""
    for character in text:
        if unicodedata.category(character) in _NOT_DRAWN:
            raise ValueError(
                f"U+{ord(character):04X} is a line break or another control character, must be one line of visible "
                'characters; draw several lines as a picture, kind = "image"'
            )
    return text


class SizedTarget(TargetSection):
    """A target by its width and height."""

    needs: ClassVar[tuple[str, ...]] = ("width", "height")

    width_mm: Millimetres | None = None
    """Whole width, along x, on a surface."""
    height_mm: Millimetres | None = None
    """Whole height, along y, on a surface; by default as the width of a flat top, in proportion of a picture."""
    width_deg: DegreesWide | None = None
    height_deg: DegreesWide | None = None


class _PictureTarget(SizedTarget, SoftTarget):
    """A picture, by its width."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    takes: ClassVar[tuple[str, ...]] = (*SoftTarget.takes, "height")

    def size_of(self, rows: int, columns: int) -> tuple[float, float]:
        """Width and height of a picture of so many rows and columns, in the target's unit."""
        width, height = self.size("width"), self.length("height")
        return width, height if isinstance(height, float) else width * rows / columns


class TextTarget(_PictureTarget):
    """One line of glyphs, uniform on a dark ground."""

    kind: Literal["text"] = "text"
    text: Annotated[str, Field(min_length=1, max_length=40), AfterValidator(_visible)]
    """One line of visible characters."""


class ImageTarget(_PictureTarget):
    """A PNG, TIFF, JPEG or BMP file; the light that it stands for is what is wanted. What is transparent is dark."""

    kind: Literal["image"] = "image"
    file: FilePath
    """PNG, TIFF, JPEG or BMP file."""
    luminance: Luminance = "as_stored"
    """Light that a value stands for: "as_stored" takes the values themselves, half the value for half the light, and of
    colours their luma; "srgb" what a screen would show, decoded by the sRGB curve.
    """


class ArrayTarget(_PictureTarget):
    """Light (relative) given as an array [row, column]; row 0 is the top, as in a picture."""

    positional: ClassVar[str] = "values"

    kind: Literal["array"] = "array"
    values: Annotated[Float[np.ndarray, "h w"], Numbers(2)]
    """Light (relative), row by row from the top."""

    if TYPE_CHECKING:  # the arguments of the class; the fields themselves are validated as everywhere

        def __init__(self, values: ArrayLike | None = None, /, **fields: Any) -> None: ...

    def __hash__(self) -> int:
        """Hash of all but the numbers themselves, which may be many; equality compares them."""
        names = (name for name in type(self).model_fields if name != "values")
        return hash((self.values.shape, *(getattr(self, name) for name in names)))

    def __eq__(self, other: object) -> bool:
        return super().__eq__(other)

    @check
    def _is_light(self) -> None:
        if self.values.size > _MOST_VALUES:
            raise ValueError(f"values: {self.values.size} numbers, must be at most {_MOST_VALUES}; average them")
        if not (self.values.min() >= 0.0 and self.values.max() > 0.0):
            raise ValueError("values: must be 0 or above, and not 0 everywhere")


class TableTarget(_PictureTarget):
    """Light (relative) in a table: CSV, a line for each row from the top, or npz with one array [row, column]."""

    kind: Literal["table"] = "table"
    file: FilePath
    """CSV, a line for each row from the top, or npz with one array."""
