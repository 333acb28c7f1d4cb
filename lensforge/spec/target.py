"""The ``[target]`` of a spec: an irradiance pattern on a receiver."""

import unicodedata
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, model_validator

from lensforge.pictures.picture import Luminance
from lensforge.spec.arrays import Numbers
from lensforge.spec.section import FilePath, Millimetres, MillimetresOrZero, Section

IN_TARGET = 0.1  # of the target's maximum: light counts as in the target where the target is brighter than that
# Unicode's general categories of control characters, format characters, surrogates, and breaks of lines and paragraphs.
_NOT_DRAWN = ("Cc", "Cf", "Cs", "Zl", "Zp")
_MOST_VALUES = 2**26  # of an array, as many as a picture may have pixels


class _Target(Section):
    distance_mm: Millimetres
    receiver_mm: Millimetres
    uniform_mm: Millimetres | None = None

    @model_validator(mode="after")
    def _mask_inside(self) -> "_Target":
        if self.uniform_mm is not None and self.uniform_mm > self.receiver_mm:
            raise ValueError(f"uniform_mm = {self.uniform_mm} must not exceed receiver_mm = {self.receiver_mm}")
        return self


class FlatTopTarget(_Target):
    """A square super-Gaussian, ``exp(-|x/a|^p - |y/a|^p)``."""

    kind: Literal["flat_top"] = "flat_top"
    half_width_mm: Millimetres
    exponent: Annotated[float, Field(ge=2.0, le=200.0)] = 18.0


class _SoftTarget(_Target):
    edge_mm: MillimetresOrZero = 0.0

    @model_validator(mode="after")
    def _edge_fits(self) -> "_SoftTarget":
        if self.edge_mm > self.receiver_mm:
            raise ValueError(f"edge_mm = {self.edge_mm} must not exceed receiver_mm = {self.receiver_mm}")
        return self


class CrossTarget(_SoftTarget):
    """An upright cross of equal arms, ``length_mm`` from end to end, edges softened by a Gaussian of ``edge_mm``."""

    kind: Literal["cross"] = "cross"
    length_mm: Millimetres
    stroke_mm: Millimetres


def _visible(text: str) -> str:
    """``text`` itself. Raises :class:`ValueError` for characters that no font draws."""
    for character in text:
        if unicodedata.category(character) in _NOT_DRAWN:
            raise ValueError(
                f"U+{ord(character):04X} is a line break or another control character, must be one line of visible "
                'characters; draw several lines as a picture, kind = "image"'
            )
    return text


class TextTarget(_SoftTarget):
    """One line of glyphs, ``width_mm`` wide, uniform on a dark ground, edges softened by a Gaussian of ``edge_mm``."""

    kind: Literal["text"] = "text"
    text: Annotated[str, Field(min_length=1, max_length=40), AfterValidator(_visible)]
    width_mm: Millimetres


class ImageTarget(_SoftTarget):
    """A PNG, TIFF, JPEG or BMP file, ``width_mm`` wide; the light that it stands for is the irradiance.

    ``luminance``: "as_stored" takes the values themselves, half the value for half the irradiance, and of colours their
    luma; "srgb" what a screen would show, decoded by the sRGB curve. What is transparent is dark.
    """

    kind: Literal["image"] = "image"
    file: FilePath
    width_mm: Millimetres
    luminance: Luminance = "as_stored"


class ArrayTarget(_SoftTarget):
    """Irradiance (relative) given as an array [row, column], ``width_mm`` wide; row 0 is the top, as in a picture."""

    positional: ClassVar[str] = "values"

    kind: Literal["array"] = "array"
    values: Annotated[Float[np.ndarray, "h w"], Numbers(2)]
    width_mm: Millimetres

    if TYPE_CHECKING:  # the arguments of the class; the fields themselves are validated as everywhere

        def __init__(
            self,
            values: ArrayLike | None = None,
            /,
            *,
            width_mm: float,
            distance_mm: float,
            receiver_mm: float,
            uniform_mm: float | None = None,
            edge_mm: float = 0.0,
        ) -> None: ...

    def __hash__(self) -> int:
        """Hash of all but the numbers themselves, which may be many; equality compares them."""
        return hash((self.values.shape, self.width_mm, self.distance_mm, self.receiver_mm, self.edge_mm))

    def __eq__(self, other: object) -> bool:
        return super().__eq__(other)

    @model_validator(mode="after")
    def _is_light(self) -> "ArrayTarget":
        if self.values.size > _MOST_VALUES:
            raise ValueError(f"values: {self.values.size} numbers, must be at most {_MOST_VALUES}; average them")
        if not (self.values.min() >= 0.0 and self.values.max() > 0.0):
            raise ValueError("values: must be 0 or above, and not 0 everywhere")
        return self


Target = Annotated[FlatTopTarget | CrossTarget | TextTarget | ImageTarget | ArrayTarget, Field(discriminator="kind")]
