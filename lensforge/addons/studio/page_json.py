"""JSON between the server and its page: values as every browser reads them, and requests held against their form.

JSON has no nan and no infinity, and a browser keeps whole numbers to 53 bits: such values of a text go to the page as
they may stand in TOML.
"""

import json
from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lensforge.results.json_npz import parse_json
from lensforge.results.validation import input_error

_MOST_STEPS = 16  # to a field of a spec
_EXACT_BITS = 53  # of whole numbers that a browser keeps
_DECIMAL_BITS = 256  # that are written in decimals


def json_text(value: object) -> str:
    """``value`` as JSON that every browser reads."""
    return json.dumps(_readable(value), allow_nan=False, default=str)


def _readable(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(name): _readable(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(entry) for entry in value]
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    if isinstance(value, int) and value.bit_length() > _EXACT_BITS:
        return str(value) if value.bit_length() <= _DECIMAL_BITS else hex(value)
    return value


class BadRequest(Exception):
    """A request that this page never sends: one line on what is wrong with it."""


class _Request(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", hide_input_in_errors=True)


class WholeText(_Request):
    """The ``text`` of the spec."""

    text: str


class FieldValue(_Request):
    """A ``value`` of the form at its ``place`` in the tables."""

    place: Annotated[list[str | int], Field(min_length=1, max_length=_MOST_STEPS)]
    value: Any


class Example(_Request):
    """The shipped ``example`` to begin from."""

    example: str


class DroppedUse(_Request):
    """The dropped file ``use`` to be the ``source`` or the ``target``."""

    use: str
    place: Annotated[Literal["source", "target"], Field(alias="as")]


class SearchSettings(_Request):
    """Settings of a search; one that is missing stays as it is. Their values are judged by the session."""

    anew: bool = False
    accuracy: Any = None
    seed: Any = None
    force: bool | None = None


class Name(_Request):
    """The ``name`` of a figure or of another design."""

    name: str


class Finer(_Request):
    """The number of ``rings`` of a mesh."""

    rings: Annotated[int, Field(ge=1, le=10_000)]


Change = WholeText | FieldValue | Example | DroppedUse
_CHANGES: dict[str, type[Change]] = {"place": FieldValue, "example": Example, "use": DroppedUse, "text": WholeText}
_Form = TypeVar("_Form", bound=_Request)


def request_of(content: bytes, form: type[_Form]) -> _Form:
    """The request in ``content``. Raises :class:`BadRequest` where it is no JSON of this ``form``."""
    return _validated(_object_in(content), form)


def change_of(content: bytes) -> Change:
    """A change of the spec in ``content``. Raises :class:`BadRequest` where there is none."""
    asked = _object_in(content)
    form = next((form for name, form in _CHANGES.items() if name in asked), None)
    if form is None:
        raise BadRequest(f"request: none of {', '.join(_CHANGES)}; give one")
    return _validated(asked, form)


def _validated(asked: Mapping[str, Any], form: type[_Form]) -> _Form:
    try:
        return form.model_validate(asked)
    except ValidationError as error:
        raise BadRequest(str(input_error(error, "request"))) from None


def _object_in(content: bytes) -> dict[str, Any]:
    try:
        asked = parse_json(content)
        json.dumps(asked, ensure_ascii=False).encode()  # half of a pair of surrogates is no text
    except (ValueError, RecursionError) as error:
        raise BadRequest(" ".join(f"request: not readable as JSON ({error})"[:300].split())) from None
    if not isinstance(asked, dict):
        raise BadRequest("request: a JSON object is expected")
    return asked
