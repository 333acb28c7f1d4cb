"""Files of a spec: its TOML, and the files it names, found and hashed.

Its tables are changed by dotted names, and made plain enough for TOML. Named files are hashed so that a result can name
its inputs.
"""

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationInfo

from lensforge.errors import InputError, refused
from lensforge.results.files import MIB, read_file, require_regular_file
from lensforge.results.validation import its_type
from lensforge.spec.toml_slips import tables_of

_MOST_BYTES = 32 * MIB  # 400,000 rays as a text, parsed in 5 seconds; more belong into a ray file


def read_toml(path: Path, missing: str) -> dict[str, Any]:
    """The tables of a TOML file in UTF-8, with or without a byte-order mark; ``missing``: the remedy where it is not.

    Raises :class:`InputError`, one line, for anything else, and for a file that no spec needs: too large, or nested too
    deep.
    """
    return tables_of(toml_text(path, missing), path)


def toml_text(path: Path, missing: str) -> str:
    """The text of a TOML file, which :func:`read_toml` reads."""
    return _decoded(read_file(path, missing=missing, most_bytes=_MOST_BYTES), path)


_OTHER_FILES = {
    b"ISO-10303-21": "a STEP file",
    b"solid ": "an STL file",
    b"ply\n": "a PLY file",
    b"%PDF": "a PDF",
    b"\x89PNG": "a picture",
    b"<": "a page or XML",
    b"{": "a record in JSON",
    b"IES": "photometry of LM-63",
    b"TM25": "a ray file",
}


def _require_toml(content: bytes, path: Path) -> None:
    """Raise :class:`InputError` for a file that begins as another kind of file does."""
    start = content[:64].removeprefix(b"\xef\xbb\xbf").lstrip()
    kind_of_file = next((description for mark, description in _OTHER_FILES.items() if start.startswith(mark)), None)
    if kind_of_file is not None:
        raise InputError(f"{path}: this is {kind_of_file}; give the spec, a TOML file such as that of `lensforge new`")


def _decoded(content: bytes, path: Path) -> str:
    _require_toml(content, path)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in content[:4]:
        raise InputError(f"{path}: it is in UTF-16 or UTF-32; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        fault = f"line {line}: the byte 0x{byte:02x} is no UTF-8"
        raise InputError(f"{path}: not readable as TOML ({fault}); save it as UTF-8") from None


def short(value: object) -> str:
    """The first characters of ``value`` as a text for a message."""
    return repr(str(value)[:60])


def changed(content: dict[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """A copy of ``content`` in which dotted names have new values; a table of changes goes into a table."""
    result = dict(content)
    for name, value in changes.items():
        if not isinstance(name, str):
            raise InputError(
                f"replace: the name {short(name)} is {its_type(name)}, must be text such as 'target.distance_mm'"
            )
        section, _, rest = name.partition(".")
        before = result.get(section)
        if rest and isinstance(before, list | tuple):
            result[section] = _entry_changed(before, section, rest, value)
        elif rest:
            result[section] = changed(dict(before) if isinstance(before, Mapping) else {}, {rest: value})
        elif isinstance(value, Mapping) and isinstance(before, Mapping):
            result[section] = changed(dict(before), value)
        else:
            result[section] = value
    return result


def _entry_changed(entries: Sequence[object], section: str, rest: str, value: object) -> list[object]:
    """A copy of a list in which one entry, ``rest`` begins with its number from 0, has another value."""
    number, _, name = rest.partition(".")
    if number not in map(str, range(len(entries))):
        raise InputError(f"replace: {section}.{rest}: {section} has {len(entries)} entries, by their numbers from 0")
    before = entries[int(number)]
    place = int(number)
    after = changed(dict(before), {name: value}) if name and isinstance(before, Mapping) else value
    return [*entries[:place], after, *entries[place + 1 :]]


def plain(value: Any) -> Any:
    """Convert to what TOML can hold: no None, paths as text."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value


_LONGEST_NAME = 64
_LONGEST_END = 32


def joined_name(name: str, end: str) -> str:
    """A spec's ``name`` with an ``end``, in characters that a spec's name may have."""
    ending = re.sub(r"[^A-Za-z0-9_-]+", "_", end)[:_LONGEST_END]
    return f"{name[: _LONGEST_NAME - 1 - len(ending)]}-{ending}"


def alike(names: Iterable[str]) -> str | None:
    """Words for the first two of ``names`` that are one folder somewhere, where letter case does not count; or None."""
    known: dict[str, str] = {}
    for name in names:
        before = known.get(name.casefold())
        if before is not None:
            same = f"two have the name {name!r}"
            return same if before == name else f"{before!r} and {name!r} differ by letter case alone"
        known[name.casefold()] = name
    return None


_NAMED = "the spec names it"
_MOST_PATH_CHARACTERS = 4096  # of Linux; other systems take fewer


@dataclass(frozen=True)
class NamedFrom:
    """The ``folder`` from which files in a table count; ``there``: all of them must be there, as in a file to be used.

    A record may outlive the files that it names.
    """

    folder: Path
    there: bool


def full_path(path: Path, info: ValidationInfo) -> Path:
    """The whole path of a field: one that is relative counts as ``info`` says, else from the current folder.

    Raises ``ValueError`` for a name that no file can have, and for a file that must be there and is not.
    """
    name = str(path)
    if len(name) > _MOST_PATH_CHARACTERS:
        raise ValueError(f"{len(name)} characters, a path has {_MOST_PATH_CHARACTERS} at most")
    if not name.isprintable():
        escape = "in double quotes \\t and \\n are none of a path: write / or single quotes; else "
        tab = escape if re.search("[\a\b\t\n\f\r]", name) else ""
        raise ValueError(f"holds a character that cannot be printed, such as a line break; {tab}rename the file")
    if name.startswith("~"):
        raise ValueError("~ does not stand for the home folder here, which differs by user; write the whole path")
    named: NamedFrom | None = info.context
    if named is None:
        return path.absolute()
    try:
        full = Path(named.folder, path).resolve()
        lacks = named.there and not full.exists()
    except (OSError, RuntimeError) as error:  # links in a circle
        raise ValueError(f"{error}; name the file itself") from None
    if lacks:
        raise ValueError(f"no such file in {full.parent}")
    return full


def input_hashes(section: BaseModel) -> dict[str, str]:
    """SHA-256 of each file that ``section`` names, as ``file:NAME``.

    Another file of the same name is ``file:NAME (2)``, and so on, in the order of the section: no folder is part of
    it. Raises :class:`InputError` for a file that is not there.
    """
    digests: dict[str, list[str]] = {}
    for path in dict.fromkeys(_paths(section)):
        digest = _file_sha256(path)
        contents = digests.setdefault(path.name, [])
        if digest not in contents:
            contents.append(digest)
    return {
        f"file:{name}" if number == 1 else f"file:{name} ({number})": digest
        for name, contents in sorted(digests.items())
        for number, digest in enumerate(contents, start=1)
    }


def section_sha256(section: BaseModel, *, without: Collection[str] = ()) -> str:
    """SHA-256 of the fields of a section, in which a file counts by its name and content, whatever its folder.

    ``without``: dotted names of fields that do not count. Raises :class:`InputError` for a file that is not there.
    """
    left_out: dict[str, Any] = {}
    for name in without:
        *holders, last = name.split(".")
        table = left_out
        for holder in holders:
            table = table.setdefault(holder, {})
        table[last] = True
    content = _by_content(section.model_dump(exclude=left_out))
    return hashlib.sha256(json.dumps(content, allow_nan=False).encode()).hexdigest()


def _by_content(value: object) -> object:
    """``value`` with the name and hash of each file in place of its path."""
    if isinstance(value, Path):
        return {"name": value.name, "sha256": _file_sha256(value)}
    if isinstance(value, Mapping):
        return {key: _by_content(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_by_content(entry) for entry in value]
    return value


def _paths(value: object) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _paths(getattr(value, name))
    elif isinstance(value, Mapping):
        for entry in value.values():
            yield from _paths(entry)
    elif isinstance(value, tuple | list):
        for entry in value:
            yield from _paths(entry)


def _file_sha256(path: Path) -> str:
    require_regular_file(path, missing=_NAMED)
    with refused(path, f"cannot be read (…); {_NAMED}", OSError), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
