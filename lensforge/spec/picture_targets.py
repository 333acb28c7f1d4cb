"""Targets that are pictures, by their width: text, image files, tables, and numbers on a grid."""

import unicodedata
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field

from lensforge.optics.image import Luminance
from lensforge.public import public
from lensforge.spec.spec_section import FilePath, Numbers, check
from lensforge.spec.target_sections import Places, SizedTarget, SoftTarget

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


@public
class PictureTarget(SizedTarget, SoftTarget):
    """A picture, by its width."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    takes: ClassVar[tuple[str, ...]] = (*SoftTarget.takes, "height")

    mirrored: bool = Field(
        default=False,
        description="Turn left and right about, for eyes on the lens's side of a wall: without it, it is read "
        "from behind a screen.",
    )

    @property
    def description(self) -> str:
        """The target in a few words, and from where it is read."""
        return f"{super().description}, {'mirrored' if self.mirrored else 'as seen from behind'}"

    def size_of(self, rows: int, columns: int) -> tuple[float, float]:
        """Width and height of a picture of so many rows and columns, in the target's unit."""
        width = self.size("width")
        height = self.length("height")
        return width, height if isinstance(height, float) else width * rows / columns

    def shown(self, picture: Float[np.ndarray, "h w"], x: Places, y: Places) -> Places:
        """``picture`` at places about its centre: nearest pixel, 0 outside; row 0 of it is its top."""
        height, width = picture.shape
        x = -x if self.mirrored else x
        size = self.size_of(height, width)
        framed = np.pad(picture, 1)
        # clipped to the frame: far from a narrow picture the index would overflow
        column = np.clip(np.floor(x * (width / size[0]) + width / 2.0) + 1.0, 0.0, width + 1.0).astype(int)
        row = np.clip(np.floor(-y * (height / size[1]) + height / 2.0) + 1.0, 0.0, height + 1.0).astype(int)
        return framed[row, column]


@public
class TextTarget(PictureTarget):
    """One line of glyphs, uniform on a dark ground, read from behind the screen unless it is ``mirrored``."""

    phrase: ClassVar[str] = "“{0.text}”, {width} wide"

    kind: Literal["text"] = "text"
    text: Annotated[str, Field(min_length=1, max_length=40), AfterValidator(_visible)] = Field(
        description="One line of visible characters."
    )

    @property
    def bounds(self) -> tuple[float, float]:
        """Width, and the height of as many narrow glyphs unless it is given."""
        width = self.size("width")
        return width, self.length("height") or _GLYPH * width / len(self.text)


@public
class ImageTarget(PictureTarget):
    """A PNG, TIFF, JPEG or BMP file; the light that it stands for is what is wanted. What is transparent is dark."""

    phrase: ClassVar[str] = "{0.file.name}, {width} wide"

    kind: Literal["image"] = "image"
    file: FilePath = Field(description="PNG, TIFF, JPEG or BMP file.")
    luminance: Luminance = Field(
        default="as_stored",
        description='Light that a value stands for: "as_stored" takes the values themselves, half the value for '
        'half the light, and of colours their luma; "srgb" what a screen would show, decoded by the '
        "sRGB curve.",
    )


@public
class ArrayTarget(PictureTarget):
    """Light (relative) given as an array [row, column]; row 0 is the top, as in a picture."""

    positional: ClassVar[str] = "values"
    phrase: ClassVar[str] = "given pattern, {width} wide"

    kind: Literal["array"] = "array"
    values: Annotated[Float[np.ndarray, "h w"], Numbers(2)] = Field(
        description="Light (relative), row by row from the top."
    )

    if TYPE_CHECKING:  # the arguments of the class; the fields themselves are validated as everywhere

        def __init__(self, values: ArrayLike | None = None, /, **fields: Any) -> None: ...

    def __hash__(self) -> int:
        """Hash of all but the numbers themselves, which may be many; equality compares them."""
        names = (name for name in type(self).model_fields if name != "values")
        return hash((self.values.shape, *(getattr(self, name) for name in names)))

    @check
    def _is_light(self) -> None:
        if self.values.size > _MOST_VALUES:
            raise ValueError(f"values: {self.values.size} numbers, must be at most {_MOST_VALUES}; average them")
        if not (self.values.min() >= 0.0 and self.values.max() > 0.0):
            raise ValueError("values: must be 0 or above, and not 0 everywhere")


@public
class TableTarget(PictureTarget):
    """Light (relative) in a table: CSV, a line for each row from the top, or npz with one array [row, column]."""

    phrase: ClassVar[str] = "{0.file.name}, {width} wide"

    kind: Literal["table"] = "table"
    file: FilePath = Field(description="CSV, a line for each row from the top, or npz with one array.")
