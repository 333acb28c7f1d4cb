"""Reading of records from files; every error is one line with its remedy."""

import hashlib
import io
import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from lensforge.errors import InputError, OutdatedResult
from lensforge.files import read_json
from lensforge.records.record import Record
from lensforge.records.validation import input_error, its_type

_Record = TypeVar("_Record", bound=Record)


def read_object(path: Path, schema: str, remedy: str, first: str = "") -> dict[str, Any]:
    """The object in a JSON file that states ``schema``, without that entry; ``first``: the remedy for a missing file.

    Raises :class:`OutdatedResult` for another version of the schema, :class:`InputError` for any other file.
    """
    return without_schema(read_json(path, first or remedy), schema, path, remedy)


def without_schema(content: object, schema: str, path: Path, remedy: str) -> dict[str, Any]:
    """``content`` of a file without its entry "schema", which must be ``schema``; errors as in :func:`read_object`."""
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds {its_type(content)}, must be an object; {remedy}")
    _require_schema(content, schema, path, remedy)
    return {key: value for key, value in content.items() if key != "schema"}


def _require_schema(content: Mapping[str, object], schema: str, path: Path, remedy: str) -> None:
    found = content.get("schema")
    if found == schema:
        return
    what = "written before version 0.2.0" if found is None else f"schema = {json.dumps(found)[:60]}"
    of_this_kind = isinstance(found, str) and re.fullmatch(re.escape(schema.rstrip("0123456789")) + r"\d+", found)
    kind = OutdatedResult if found is None or of_this_kind else InputError
    raise kind(f"{path}: {what}, must be {schema!r}; {remedy}")


def validated(
    kind: type[_Record], content: Mapping[str, object], path: Path, remedy: str, stored_elsewhere: Collection[str] = ()
) -> _Record:
    """``content`` of a file as a record; every field must be there, defaults too, except those ``stored_elsewhere``."""
    try:
        record = kind.model_validate(content)
    except ValidationError as error:
        raise input_error(error, str(path), remedy=remedy, unions=kind.unions) from None
    missing = _first_missing(record.model_dump(mode="json", exclude={*stored_elsewhere}), content)
    if missing:
        raise InputError(f"{path}: {missing}: missing; {remedy}")
    return record


def _first_missing(whole: object, content: object) -> str:
    """Dotted name of the first field of ``whole`` that ``content`` lacks; empty where it lacks none."""
    if isinstance(whole, dict) and isinstance(content, dict):
        for name, value in whole.items():
            if name not in content:
                return str(name)
            if deeper := _first_missing(value, content[name]):
                return f"{name}.{deeper}"
    elif isinstance(whole, list) and isinstance(content, list | tuple):
        for index, (value, given) in enumerate(zip(whole, content, strict=False)):
            if deeper := _first_missing(value, given):
                return f"{index}.{deeper}"
    return ""


def read_bytes(path: Path, required: bool, remedy: str) -> bytes | None:
    """Content of a file; None where it is missing and not ``required``."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        if required:
            raise InputError(f"{path}: no such file; {remedy}") from None
        return None
    except OSError as error:
        raise InputError(f"{path}: not readable ({error.strerror}); {remedy}") from None


def read_arrays(path: Path, names: Sequence[str], sha256: object, remedy: str) -> dict[str, np.ndarray]:
    """The arrays ``names`` of an npz file whose hash is ``sha256``; missing arrays are left to the validation."""
    content = read_bytes(path, True, remedy)
    assert content is not None
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(f"{path}: not the arrays that {path.stem}.json describes; {remedy}")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            return {name: archive[name] for name in names if name in archive}
    except Exception as error:  # whatever the reader raises, the file is damaged
        raise InputError(f"{path}: damaged ({type(error).__name__}: {error}); {remedy}") from None
