"""Reading of records from files; every error is one line with its remedy."""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from lensforge.errors import InputError, OutdatedResult
from lensforge.files import MIB, read_file, read_json
from lensforge.npz_file import arrays_in
from lensforge.records.record import Record
from lensforge.records.validation import input_error, its_type

CHECKSUM = "content_sha256"  # the key of the hash of all other entries
# Three maps of 2048 x 2048 pixels take 100 MiB, ten million measured points 300 MiB; there are up to three copies.
_MOST_ARRAY_BYTES = 512 * MIB

_Record = TypeVar("_Record", bound=Record)


def with_checksum(content: Mapping[str, Any]) -> dict[str, Any]:
    """``content`` of a JSON file with the hash of all its entries, which :func:`require_checksum` compares."""
    plain = {key: value for key, value in content.items() if key != CHECKSUM}
    head = {"schema": plain.pop("schema")} if "schema" in plain else {}
    return {**head, CHECKSUM: _checksum({**head, **plain}), **plain}


def require_checksum(content: Mapping[str, Any], path: Path, remedy: str) -> dict[str, Any]:
    """``content`` of ``path`` without the hash of its entries. Raises :class:`InputError` where that is of others."""
    plain = {key: value for key, value in content.items() if key != CHECKSUM}
    if content.get(CHECKSUM) != _checksum(plain):
        raise InputError(f"{path}: {CHECKSUM}: of other content: the file is damaged or was edited; {remedy}")
    return plain


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of ``content`` in one form of text, however a file lays it out."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


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


def validated(kind: type[_Record], content: Mapping[str, object], path: Path, remedy: str) -> _Record:
    """``content`` of a file as a record. Raises :class:`InputError`, which names the wrong field."""
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise input_error(error, str(path), remedy=remedy, unions=kind.unions) from None


def read_bytes(path: Path, required: bool, most_bytes: int, remedy: str) -> bytes | None:
    """Content of a file; None where it is missing and not ``required``. Raises :class:`InputError`."""
    if not required and not path.is_symlink() and not path.exists():
        return None
    return read_file(path, missing=remedy, most_bytes=most_bytes)


def read_arrays(path: Path, names: Sequence[str], sha256: object, remedy: str) -> dict[str, np.ndarray]:
    """The arrays ``names`` of an npz file whose hash is ``sha256``; missing arrays are left to the validation."""
    content = read_file(path, missing=remedy, most_bytes=_MOST_ARRAY_BYTES)
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(f"{path}: not the arrays that {path.stem}.json describes; {remedy}")
    try:
        return arrays_in(content, names, _MOST_ARRAY_BYTES)
    except ValueError as error:
        raise InputError(f"{path}: damaged ({error}); {remedy}") from None
