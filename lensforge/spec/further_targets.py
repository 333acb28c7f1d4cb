"""Targets that are no shapes: pictures by their width, and light of the far field.

Pictures are text, image files, tables, and numbers on a grid; the far field has beams, even light on a plane, and the
intensity in a photometric file.
"""

import unicodedata
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field

from lensforge.optics.image import Luminance
from lensforge.spec.spec_section import FilePath, Numbers, check
from lensforge.spec.target_sections import Places, SizedTarget, SoftTarget, TargetSection

# Unicode's general categories of control characters, format characters, surrogates, and breaks of lines and paragraphs.
_NOT_DRAWN = ("Cc", "Cf", "Cs", "Zl", "Zp")
_MOST_VALUES = 2**26  # of an array, as many as a picture may have pixels
_GLYPH = 1.6  # height of a narrow glyph over its width


def _visible(text: str) -> str:
    """``text`` itself. Raises :class:`ValueError` for characters that no font draws."""
    for character in text:
        if unicodedata.category(character) in _NOT_DRAWN:
            raise ValueError(
                f"U+{ord(character):04X} is a line break or another control character, must be one line of visible "
                'characters; draw several lines as a picture, kind = "image"'
            )
    return text


class PictureTarget(SizedTarget, SoftTarget):
    """A picture, by its width."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    takes: ClassVar[tuple[str, ...]] = (*SoftTarget.takes, "height")

    def size_of(self, rows: int, columns: int) -> tuple[float, float]:
        """Width and height of a picture of so many rows and columns, in the target's unit."""
        width, height = self.size("width"), self.length("height")
        return width, height if isinstance(height, float) else width * rows / columns

    def shown(self, picture: Float[np.ndarray, "h w"], x: Places, y: Places) -> Places:
        """``picture`` at places about its centre: nearest pixel, 0 outside; row 0 of it is its top."""
        height, width = picture.shape
        size = self.size_of(height, width)
        framed = np.pad(picture, 1)
        # clipped to the frame: far from a narrow picture the index would overflow
        column = np.clip(np.floor(x * (width / size[0]) + width / 2.0) + 1.0, 0.0, width + 1.0).astype(int)
        row = np.clip(np.floor(-y * (height / size[1]) + height / 2.0) + 1.0, 0.0, height + 1.0).astype(int)
        light: Places = framed[row, column]
        return light


class TextTarget(PictureTarget):
    """One line of glyphs, uniform on a dark ground."""

    words: ClassVar[str] = "“{0.text}”, {width} wide"

    kind: Literal["text"] = "text"
    text: Annotated[str, Field(min_length=1, max_length=40), AfterValidator(_visible)]
    """One line of visible characters."""

    @property
    def bounds_mm(self) -> tuple[float, float] | None:
        """Width, and the height of as many narrow glyphs unless it is given."""
        width_mm = self.width_mm
        return None if width_mm is None else (width_mm, self.height_mm or _GLYPH * width_mm / len(self.text))


class ImageTarget(PictureTarget):
    """A PNG, TIFF, JPEG or BMP file; the light that it stands for is what is wanted. What is transparent is dark."""

    words: ClassVar[str] = "{0.file.name}, {width} wide"

    kind: Literal["image"] = "image"
    file: FilePath
    """PNG, TIFF, JPEG or BMP file."""
    luminance: Luminance = "as_stored"
    """Light that a value stands for: "as_stored" takes the values themselves, half the value for half the light, and of
    colours their luma; "srgb" what a screen would show, decoded by the sRGB curve.
    """


class ArrayTarget(PictureTarget):
    """Light (relative) given as an array [row, column]; row 0 is the top, as in a picture."""

    positional: ClassVar[str] = "values"
    words: ClassVar[str] = "given pattern, {width} wide"

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


class TableTarget(PictureTarget):
    """Light (relative) in a table: CSV, a line for each row from the top, or npz with one array [row, column]."""

    words: ClassVar[str] = "{0.file.name}, {width} wide"

    kind: Literal["table"] = "table"
    file: FilePath
    """CSV, a line for each row from the top, or npz with one array."""


BeamAngle = Annotated[float, Field(ge=0.1, le=170.0)]
_HORIZON = 89.0  # degrees: no plane is lit beyond


class FarFieldTarget(TargetSection):
    """Lengths are angles, whatever is given."""

    far_field_only: ClassVar[bool] = True

    @property
    def in_unit(self) -> Literal["deg"]:
        """Degrees."""
        return "deg"


class BeamTarget(FarFieldTarget, SoftTarget):
    """A beam by its full width at half maximum."""

    needs: ClassVar[tuple[str, ...]] = ("fwhm",)
    words: ClassVar[str] = "{0.profile} beam {fwhm}"
    across: ClassVar[str] = "fwhm"

    kind: Literal["beam"] = "beam"
    fwhm_deg: BeamAngle | tuple[BeamAngle, BeamAngle] | None = None
    """Full width at half maximum, one for both directions or along x and along y."""
    profile: Literal["gaussian", "cosine", "flat"] = "gaussian"
    """Course of the intensity: "gaussian", "cosine" (a power of the cosine of the angle from the axis; between x and y
    the width follows an ellipse), or "flat" up to the half width and dark beyond it, with soft edges by
    ``edge_deg``.
    """

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


class BatwingTarget(FarFieldTarget, SoftTarget):
    """Even illuminance on a plane at right angles to the axis: intensity as 1 / cos^3 of the angle.

    With ``edge_deg`` the edge is soft: the illuminance falls as the integral of a Gaussian with that standard
    deviation, and is one half at ``to_deg``.
    """

    needs: ClassVar[tuple[str, ...]] = ("to",)
    words: ClassVar[str] = "batwing to {to}"
    across: ClassVar[str] = "to"
    has_own_edge: ClassVar[bool] = True

    kind: Literal["batwing"] = "batwing"
    to_deg: Annotated[float, Field(ge=0.1, le=85.0)] | None = None
    """Angle from the axis up to which the light is even."""

    def light(self, x: Places, y: Places) -> Places:
        """Even illuminance on a plane, which falls at its edge as the integral of a Gaussian."""
        from scipy.special import erfc

        gamma, to = np.hypot(x, y), self.size("to")
        lit = gamma <= to if self.edge == 0.0 else 0.5 * erfc((gamma - to) / (np.sqrt(2.0) * self.edge))
        within = gamma < _HORIZON
        light: Places = np.where(within, lit / np.cos(np.radians(np.where(within, gamma, 0.0))) ** 3, 0.0)
        return light


class PhotometricTarget(FarFieldTarget):
    """The intensity in an IES LM-63 or EULUMDAT file; its gamma = 0 is the receiver's axis, C = 0 +x, C = 90 -y.

    ``centre_deg`` tilts it, ``rotation_deg`` turns its C planes.
    """

    words: ClassVar[str] = "intensity of {0.file.name}"

    kind: Literal["photometric"] = "photometric"
    file: FilePath
    """IES LM-63 or EULUMDAT file."""
