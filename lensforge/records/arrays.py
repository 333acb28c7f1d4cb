"""Arrays as fields of a record: float64, of a stated shape, finite, and read-only."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema


@dataclass(frozen=True)
class Array:
    """Marks a field ``Annotated[Float[np.ndarray, "p p"], Array("p", "p")]`` that is stored in the stage's npz file.

    ``axes``: a name or a number for each axis; axes of the same name have the same size in all arrays of a record.
    ``gaps``: values may be NaN, as in maps of a face outside its rim; never infinite.
    """

    axes: tuple[str | int, ...]
    gaps: bool = False

    def __init__(self, *axes: str | int, gaps: bool = False) -> None:
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "gaps", gaps)

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
        bind(self.axes, array.shape, {})
        return read_only(array, self.gaps)

    def _named(self) -> str:
        return ", ".join(map(str, self.axes))


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
    """``array`` itself, made read-only. Raises :class:`ValueError` for infinity, and for NaN without ``gaps``."""
    if np.isinf(array).any() or (not gaps and np.isnan(array).any()):
        raise ValueError("holds numbers that are not finite")
    array.flags.writeable = False
    return array


# An image [row y, column x] with as many rows as columns, and a line of the same number of pixels.
Image = Annotated[Float[np.ndarray, "p p"], Array("p", "p")]
Line = Annotated[Float[np.ndarray, " p"], Array("p")]


def bind(axes: tuple[str | int, ...], shape: tuple[int, ...], sizes: dict[str, int]) -> None:
    """Compare ``shape`` with ``axes`` and the known ``sizes``; add the new sizes. Raises :class:`ValueError`."""
    for axis, size in zip(axes, shape, strict=True):
        known = axis if isinstance(axis, int) else sizes.setdefault(axis, size)
        if size != known:
            raise ValueError(f"shape {shape}, must be ({', '.join(map(str, axes))}) with {axis} = {known}")
