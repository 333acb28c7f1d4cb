"""Numbers of a spec: pydantic would take true for 1 and the text "1" for a number, in TOML and in Python."""

from typing import Any

import numpy as np
from pydantic_core import CoreSchema, PydanticKnownError

_KINDS = ("float", "int")


def with_numbers_only(schema: CoreSchema) -> CoreSchema:
    """The schema of a section whose numbers, at any depth, are no booleans and no texts."""
    numbers_only: CoreSchema = _checked(schema)
    return numbers_only


def _checked(part: Any) -> Any:
    if isinstance(part, dict):
        if part.get("type") in _KINDS:
            return _of_number(part)
        if part.get("type") == "function-before" and part["function"].get("function") in _CHECKS.values():
            return part  # of a section within this one
        return {key: _checked(value) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return type(part)(map(_checked, part))
    return part


def _of_number(schema: dict[str, Any]) -> dict[str, Any]:
    function = {"type": "no-info", "function": _CHECKS[schema["type"]]}
    return {"type": "function-before", "function": function, "schema": schema}


def _real(value: Any) -> Any:
    return _require_number(value, "float")


def _whole(value: Any) -> Any:
    return _require_number(value, "int")


_CHECKS = {"float": _real, "int": _whole}


def _require_number(value: Any, kind: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        raise PydanticKnownError(f"{kind}_type")  # type: ignore[arg-type]
    if isinstance(value, str | bytes):
        raise PydanticKnownError(f"{kind}_parsing")  # type: ignore[arg-type]
    return value
