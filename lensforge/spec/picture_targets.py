"""Targets that are pictures: text, image files, and numbers on a grid."""

import unicodedata
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, model_validator

from lensforge.pictures.picture import Luminance
from lensforge.spec.arrays import Numbers
from lensforge.spec.section import FilePath, Millimetres
from lensforge.spec.target import DegreesWide, SoftTarget

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


class _PictureTarget(SoftTarget):
    """A picture, by its width."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    takes: ClassVar[tuple[str, ...]] = (*SoftTarget.takes, "height")

    width_mm: Millimetres | None = None
    """Width on a surface."""
    height_mm: Millimetres | None = None
    """Height on a surface; by default in proportion."""
    width_deg: DegreesWide | None = None
    """Width in the far field."""
    height_deg: DegreesWide | None = None
    """Height in the far field; by default in proportion."""

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

        def __init__(
            self,
            values: ArrayLike | None = None,
            /,
            *,
            width_mm: float | None = None,
            height_mm: float | None = None,
            width_deg: float | None = None,
            height_deg: float | None = None,
            distance_mm: float | None = None,
            receiver_mm: float | None = None,
            half_angle_deg: float | None = None,
            centre_mm: tuple[float, float] | None = None,
            centre_deg: tuple[float, float] | None = None,
            rotation_deg: float = 0.0,
            level: float = 1.0,
            uniform_mm: float | tuple[float, float] | None = None,
            uniform_deg: float | tuple[float, float] | None = None,
            edge_mm: float | None = None,
            edge_deg: float | None = None,
        ) -> None: ...

    def __hash__(self) -> int:
        """Hash of all but the numbers themselves, which may be many; equality compares them."""
        names = (name for name in type(self).model_fields if name != "values")
        return hash((self.values.shape, *(getattr(self, name) for name in names)))

    def __eq__(self, other: object) -> bool:
        return super().__eq__(other)

    @model_validator(mode="after")
    def _is_light(self) -> "ArrayTarget":
        if self.values.size > _MOST_VALUES:
            raise ValueError(f"values: {self.values.size} numbers, must be at most {_MOST_VALUES}; average them")
        if not (self.values.min() >= 0.0 and self.values.max() > 0.0):
            raise ValueError("values: must be 0 or above, and not 0 everywhere")
        return self


class TableTarget(_PictureTarget):
    """Light (relative) in a table: CSV, a line for each row from the top, or npz with one array [row, column]."""

    kind: Literal["table"] = "table"
    file: FilePath
    """CSV, a line for each row from the top, or npz with one array."""
