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
    """Marks a field ``Annotated[Float[np.ndarray, "p p"], Array("p", "p")]`` that is kept in the stage's npz file.

    ``axes``: a name or a number for each axis; axes of one name have one size in all arrays of a record. ``gaps``:
    values may be NaN, as maps of a face have outside of it; never infinite.
    """

    axes: tuple[str | int, ...]
    gaps: bool = False

    def __init__(self, *axes: str | int, gaps: bool = False) -> None:
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "gaps", gaps)

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by :meth:`checked`; in JSON, where no array is expected, nested lists."""
        lists = core_schema.plain_serializer_function_ser_schema(lambda array: array.tolist())
        return core_schema.no_info_plain_validator_function(self.checked, serialization=lists)

    def checked(self, value: Any) -> np.ndarray:
        """``value`` as a read-only float64 array of its own. Raises :class:`ValueError` for what is none."""
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
    """``value``, an array or nested lists, as a float64 array of its own, of any shape.

    Text, truth values and complex numbers are not converted. ``converted`` makes a new array of it. Raises
    :class:`ValueError` for what is none.
    """
    try:
        array = converted(value)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"of type {array.dtype}, must be real")
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        # RuntimeError: a tensor that is on another device, or tracks its gradient
        raise ValueError(f"no array of numbers ({error})") from None


def read_only(array: np.ndarray, gaps: bool = False) -> np.ndarray:
    """``array`` itself, finite (or NaN, with ``gaps``) and from now on read-only. Raises :class:`ValueError`."""
    if np.isinf(array).any() or (not gaps and np.isnan(array).any()):
        raise ValueError("holds numbers that are not finite")
    array.flags.writeable = False
    return array


# An image [row y, column x] with as many rows as columns, and a line of the same number of pixels.
Image = Annotated[Float[np.ndarray, "p p"], Array("p", "p")]
Line = Annotated[Float[np.ndarray, " p"], Array("p")]


def bind(axes: tuple[str | int, ...], shape: tuple[int, ...], sizes: dict[str, int]) -> None:
    """Hold ``shape`` against ``axes`` and the ``sizes`` known so far, which grow. Raises :class:`ValueError`."""
    for axis, size in zip(axes, shape, strict=True):
        known = axis if isinstance(axis, int) else sizes.setdefault(axis, size)
        if size != known:
            raise ValueError(f"shape {shape}, must be ({', '.join(map(str, axes))}) with {axis} = {known}")
