"""Files that a spec names: resolved against its folder, and hashed so that a result can name its inputs."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from lensforge.errors import InputError
from lensforge.spec.section import Section


def resolve_files(table: object, folder: Path) -> None:
    """Make every ``file`` in ``table``, however deep, relative to ``folder``."""
    if isinstance(table, list):
        for entry in table:
            resolve_files(entry, folder)
    elif isinstance(table, dict):
        for key, value in table.items():
            if key == "file" and isinstance(value, str):
                table[key] = str((folder / value).resolve())
            else:
                resolve_files(value, folder)


def input_hashes(section: Section) -> dict[str, str]:
    """SHA-256 of each file that ``section`` names, as ``file:NAME``.

    Raises :class:`InputError` for a file that is not there.
    """
    return {f"file:{path.name}": _file_sha256(path) for path in sorted(set(_paths(section)))}


def section_sha256(section: Section) -> str:
    """SHA-256 of the fields of a section and of the files that it names, whatever their folders."""
    content = section.model_dump_json()
    for path in set(_paths(section)):
        content = content.replace(json.dumps(str(path), ensure_ascii=False), json.dumps(path.name, ensure_ascii=False))
    digest = hashlib.sha256(content.encode())
    for name, found in input_hashes(section).items():
        digest.update(f"{name}={found}".encode())
    return digest.hexdigest()


def _paths(value: object) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif isinstance(value, Section):
        for name in type(value).model_fields:
            yield from _paths(getattr(value, name))
    elif isinstance(value, Mapping):
        for entry in value.values():
            yield from _paths(entry)
    elif isinstance(value, tuple | list):
        for entry in value:
            yield from _paths(entry)


def _file_sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); the spec names it") from None
