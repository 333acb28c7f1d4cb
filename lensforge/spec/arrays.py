"""Arrays in a spec: given as arrays or nested lists, written as text without loss."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from lensforge.records.arrays import read_only, real_numbers

_MOST_NUMBERS = 2**31


@dataclass(frozen=True)
class Numbers:
    """Marks a field that is a float64 array of ``ndim`` axes, the last of size ``last`` if that is given.

    In TOML and JSON it is a table ``{shape = [...], float64 = "..."}``, the bytes of the numbers (little-endian, row by
    row) in base64; nested lists are read as well.
    """

    ndim: int
    last: int | None = None

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by :meth:`checked`, write by :func:`packed`."""
        text = core_schema.plain_serializer_function_ser_schema(packed)
        return core_schema.no_info_plain_validator_function(self.checked, serialization=text)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The table, or nested lists of as many axes."""
        lists: JsonSchemaValue = {"type": "number"}
        for _ in range(self.ndim):
            lists = {"type": "array", "items": lists}
        shape = {"type": "array", "items": {"type": "integer"}}
        table = {
            "type": "object",
            "properties": {"shape": shape, "float64": {"type": "string"}},
            "required": ["shape", "float64"],
            "additionalProperties": False,
        }
        return {"anyOf": [lists, table]}

    def checked(self, value: Any) -> np.ndarray:
        """Convert ``value`` to a new, read-only float64 array. Raises :class:`ValueError` for a wrong shape or type."""
        array = numbers_of(value)
        if array.ndim != self.ndim or array.size == 0 or (self.last is not None and array.shape[-1] != self.last):
            wanted = ", ".join([*("n" * (self.ndim - 1)), str(self.last or "n")])
            raise ValueError(f"shape {array.shape}, must be ({wanted}), not empty")
        return read_only(array)


def numbers_of(value: Any) -> np.ndarray:
    """Convert an array, nested lists, or what :func:`packed` makes to a new float64 array of any shape.

    Raises :class:`ValueError` for anything else.
    """
    return real_numbers(value, _unpacked if isinstance(value, Mapping) else np.array)


def packed(array: np.ndarray) -> dict[str, Any]:
    """The table that :class:`Numbers` reads."""
    little = np.ascontiguousarray(array, dtype="<f8")
    return {"shape": list(array.shape), "float64": base64.b64encode(little.tobytes()).decode("ascii")}


def _unpacked(table: Mapping[str, Any]) -> np.ndarray:
    if set(table) != {"shape", "float64"}:
        raise ValueError("must be a table of shape and float64")
    shape = tuple(int(size) for size in table["shape"])
    if any(size < 0 for size in shape) or np.prod(shape, dtype=float) > _MOST_NUMBERS:
        raise ValueError(f"shape = {shape}")
    numbers = np.frombuffer(base64.b64decode(table["float64"], validate=True), dtype="<f8")
    return numbers.reshape(shape).astype(np.float64)
