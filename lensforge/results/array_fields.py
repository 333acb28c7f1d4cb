"""Arrays as fields of a record: float64, of a stated shape, finite, and read-only."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

# Of any number in a record, in the unit of its field: products of three, and squares over products, stay within
# floating point. The largest that a sound result may hold are W/m^2 of a laser's focus, 1e20.
LARGEST = 1e30
MOST_PIXELS = 4096  # along an axis; a page draws all of them
_CENTRED = 1e-9  # relative


@dataclass(frozen=True)
class Array:
    """Marks a field ``Annotated[Float[np.ndarray, "p p"], Array("p", "p")]`` that is stored in the stage's npz file.

    ``axes``: a name or a number for each axis; axes of the same name have the same size in all arrays of a record, at
    most ``most``. ``gaps``: values may be NaN, as in maps of a face outside its rim; never infinite. ``least``: of all
    values. ``centred``: values increase from -a to a, as the positions of pixels and nodes do.
    """

    axes: tuple[str | int, ...]
    gaps: bool = False
    most: int = MOST_PIXELS
    least: float = -LARGEST
    centred: bool = False

    def __init__(
        self,
        *axes: str | int,
        gaps: bool = False,
        most: int = MOST_PIXELS,
        least: float = -LARGEST,
        centred: bool = False,
    ) -> None:
        for name, value in zip(
            ("axes", "gaps", "most", "least", "centred"), (axes, gaps, most, least, centred), strict=True
        ):
            object.__setattr__(self, name, value)

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by :meth:`checked`; serialise to nested lists."""
        lists = core_schema.plain_serializer_function_ser_schema(lambda array: array.tolist())
        return core_schema.no_info_plain_validator_function(self.checked, serialization=lists)

    def checked(self, value: Any) -> np.ndarray:
        """``value`` as a new read-only float64 array. Raises :class:`ValueError` where it cannot be one."""
        array = real_numbers(value)
        if array.ndim != len(self.axes):
            raise ValueError(f"shape {array.shape}, must have {len(self.axes)} axes ({self._named()})")
        if array.size == 0:
            raise ValueError(f"shape {array.shape}, must not be empty")
        if max(array.shape) > self.most:
            raise ValueError(f"shape {array.shape}, must have at most {self.most} along an axis")
        bind(self.axes, array.shape, {})
        array = read_only(array, self.gaps)
        if self.centred:
            _require_centred(array)
        if (array < self.least).any():
            raise ValueError(f"holds {np.nanmin(array):.3g}, must be at least {self.least:g}")
        return array

    def _named(self) -> str:
        return ", ".join(map(str, self.axes))


def _require_centred(positions: np.ndarray) -> None:
    """Raise :class:`ValueError` unless ``positions`` increase from -a to a."""
    reach = float(positions[-1])
    if (np.diff(positions) <= 0.0).any() or abs(positions[0] + reach) > _CENTRED * abs(reach):
        raise ValueError(f"from {positions[0]:.6g} to {reach:.6g}, must increase from -a to a")


def real_numbers(value: Any, converted: Callable[[Any], np.ndarray] = np.array) -> np.ndarray:
    """``value``, an array or nested lists, as a new float64 array of any shape.

    ``converted`` makes an array of it. Raises :class:`ValueError` for text, booleans, complex numbers and anything that
    is not an array.
    """
    try:
        array = converted(value)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"of type {array.dtype}, must be real")
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        # RuntimeError: a tensor on another device, or one that requires its gradient
        raise ValueError(f"not an array of numbers ({error})") from None


def read_only(array: np.ndarray, gaps: bool = False) -> np.ndarray:
    """``array`` itself, made read-only.

    Raises :class:`ValueError` for infinity, for NaN without ``gaps``, for numbers beyond :data:`LARGEST`, and where all
    but 0 are below its inverse.
    """
    if np.isinf(array).any() or (not gaps and np.isnan(array).any()):
        raise ValueError("holds numbers that are not finite")
    peak = float(np.fmax.reduce(np.abs(array), axis=None, initial=0.0))
    if peak > LARGEST or 0.0 < peak < 1.0 / LARGEST:
        raise ValueError(f"has {peak:.3g} as its largest number; must be from {1.0 / LARGEST:g} to {LARGEST:g}, or 0")
    array.flags.writeable = False
    return array


# An image [row y, column x], a square one, one of light; a line of a square one, and the positions of its pixels.
Image = Annotated[Float[np.ndarray, "h w"], Array("h", "w")]
SquareImage = Annotated[Float[np.ndarray, "p p"], Array("p", "p")]
Irradiance = Annotated[Float[np.ndarray, "h w"], Array("h", "w", least=0.0)]
Line = Annotated[Float[np.ndarray, " p"], Array("p")]
PixelCentres = Annotated[Float[np.ndarray, " p"], Array("p", centred=True)]


def bind(axes: tuple[str | int, ...], shape: tuple[int, ...], sizes: dict[str, int]) -> None:
    """Compare ``shape`` with ``axes`` and the known ``sizes``; add the new sizes. Raises :class:`ValueError`."""
    for axis, size in zip(axes, shape, strict=True):
        known = axis if isinstance(axis, int) else sizes.setdefault(axis, size)
        if size != known:
            raise ValueError(f"shape {shape}, must be ({', '.join(map(str, axes))}) with {axis} = {known}")
