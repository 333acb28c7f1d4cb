"""What is read of a result's files before it is a record: each thing that can be wrong with them is one line."""

import hashlib
import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from lensforge.errors import InputError, OutdatedResult


def reject_outdated(content: Mapping[str, object], schema: str, path: Path, remedy: str) -> None:
    """Raise :class:`InputError` unless ``content`` states ``schema``; :class:`OutdatedResult` for an earlier one."""
    found = content.get("schema")
    if found == schema:
        return
    what = "written before version 0.2.0" if found is None else f"schema = {json.dumps(found)[:60]}"
    of_this_kind = isinstance(found, str) and re.fullmatch(re.escape(schema.rstrip("0123456789")) + r"\d+", found)
    kind = OutdatedResult if found is None or of_this_kind else InputError
    raise kind(f"{path}: {what}, must be {schema!r}; {remedy}")


def lacking(whole: object, content: object) -> str:
    """The dotted name of the first field of ``whole`` that ``content`` has not; empty where it has all."""
    if isinstance(whole, dict) and isinstance(content, dict):
        for name, value in whole.items():
            if name not in content:
                return str(name)
            if deeper := lacking(value, content[name]):
                return f"{name}.{deeper}"
    elif isinstance(whole, list) and isinstance(content, list | tuple):
        for index, (value, given) in enumerate(zip(whole, content, strict=False)):
            if deeper := lacking(value, given):
                return f"{index}.{deeper}"
    return ""


def read_bytes(path: Path, required: bool, remedy: str) -> bytes | None:
    """What a file of its own holds; None for one that need not be there."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        if required:
            raise InputError(f"{path}: no such file; {remedy}") from None
        return None
    except OSError as error:
        raise InputError(f"{path}: not readable ({error.strerror}); {remedy}") from None


def read_arrays(path: Path, names: Sequence[str], sha256: object, remedy: str) -> dict[str, np.ndarray]:
    """The arrays ``names`` of an npz file whose hash is ``sha256``; absent ones are for the validation to name."""
    content = read_bytes(path, True, remedy)
    assert content is not None
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(f"{path}: not the arrays that {path.stem}.json describes; {remedy}")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            return {name: archive[name] for name in names if name in archive}
    except Exception as error:  # whatever the reader raises, the file is what is wrong
        raise InputError(f"{path}: damaged ({type(error).__name__}: {error}); {remedy}") from None
