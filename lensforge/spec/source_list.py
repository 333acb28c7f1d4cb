"""A list of LEDs from files: ray files by name or pattern, a table of them, or the ``[[sources]]`` of a TOML file."""

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

from lensforge.errors import InputError
from lensforge.results.files import MIB, require_regular_file
from lensforge.results.table_names import Column
from lensforge.results.text_table import Entry, read_list
from lensforge.spec.emitter_section import EmitterSection, FluxSection
from lensforge.spec.source_sections import NamedSource, RayfileSource
from lensforge.spec.spec_files import NamedFrom, alike, read_toml
from lensforge.spec.spec_section import Section, section_of

_PATTERN = re.compile(r"[*?\[]")
_REPEATED = re.compile(r"(?<![^/])(?:\*\*/)+(?=\*\*/)")
_MOST_DEPTHS = 2  # of **: each goes through all folders below each of the one before
_NUMBERS = ("share", *FluxSection.model_fields, "luminous_efficacy_lm_per_w")
_COLUMNS = (
    Column(("file",), is_text=True),
    Column(("name",), needed=False, is_text=True),
    *(Column((name,), needed=False) for name in _NUMBERS),
)
_LONGEST_NAME = 32
MOST_SOURCES = 100
_MOST_BYTES = 4 * MIB
_SHOWN = 100  # characters of a name in a message
_ADVICE = "give ray files, a .csv table or a .toml file"
# Fields of a source that another LED in its place has, too: how much light it gives, and where it sits.
_KEPT = tuple(name for name in EmitterSection.model_fields if name != "spectrum")


class _SourceList(Section):
    sources: tuple[NamedSource, ...]


def read_sources(given: Sequence[Path | str], settings: EmitterSection) -> tuple[NamedSource, ...]:
    """The LEDs that ``given`` names, in their order.

    Each is a ray file, a pattern of such (``leds/*.ray``), a CSV table with a column file, and those of name, flux_lm,
    flux_w, luminous_efficacy_lm_per_w and share that are known, or a TOML file with ``[[sources]]``. A ray file takes
    the place of the spec's ``settings`` source. Raises :class:`InputError`.
    """
    return tuple(led for name in given for led in _read(str(name), settings))


def _read(given: str, settings: EmitterSection) -> Iterator[NamedSource]:
    if not given.isprintable():
        raise InputError(f"sources: {_shown(given)}: holds a character that cannot be printed; rename the file")
    if _PATTERN.search(given) and not _is_there(given):
        yield from (_of_file(file, settings) for file in _files_of(given))
    elif given.lower().endswith(".toml"):
        yield from _of_toml(Path(given))
    elif given.lower().endswith(".csv"):
        entries = read_list(Path(given), _COLUMNS, missing="give a table with a column file", most_bytes=_MOST_BYTES)
        yield from (_of_entry(entry, Path(given).parent, settings) for entry in entries)
    else:
        yield _of_file(Path(given), settings)


def _is_there(name: str) -> bool:
    try:
        return Path(name).exists()
    except OSError:  # longer than any name
        return False


def _shown(name: str) -> str:
    return name if name.isprintable() and len(name) <= _SHOWN else f"{name[:_SHOWN]!r} ..."


def _files_of(pattern: str) -> list[Path]:
    """Files of a pattern, sorted. Raises :class:`InputError` for none, and for more than a study takes."""
    root = Path(pattern).anchor
    shorter = _REPEATED.sub("", pattern)
    if Path(shorter).parts.count("**") > _MOST_DEPTHS:
        raise InputError(f"sources: {_shown(pattern)}: ** may stand {_MOST_DEPTHS} times; name the folders")
    try:
        matches = Path(root or ".").glob(shorter.removeprefix(root))
        files = sorted(islice(filter(Path.is_file, matches), MOST_SOURCES + 1))
    except (OSError, ValueError, RecursionError) as error:
        reason = "it has too many parts" if isinstance(error, RecursionError) else error
        raise InputError(f"sources: {_shown(pattern)}: not usable as a pattern ({reason}); {_ADVICE}") from None
    if not files:
        raise InputError(f"sources: {_shown(pattern)}: no file of this pattern; {_ADVICE}")
    if len(files) > MOST_SOURCES:
        raise InputError(f"sources: {_shown(pattern)}: more than {MOST_SOURCES} files; narrow the pattern")
    return files


def source_with_file(settings: EmitterSection, file: Path, **changes: object) -> EmitterSection:
    """The source ``settings`` with ``file`` as its ray file, and with the fields of ``changes``.

    Another source is replaced by the file with its virtual focus at the origin, placed as the source was, and with the
    flux that the spec states. Raises :class:`InputError` for fields that do not fit.
    """
    placed = isinstance(settings, RayfileSource)
    kept: dict[str, object] = {} if placed else {"origin": "virtual_focus"}
    kept |= {name: getattr(settings, name) for name in (settings.model_fields_set if placed else _KEPT)}
    return RayfileSource(**{**kept, "file": file, **changes})


def _of_file(file: Path, settings: EmitterSection) -> NamedSource:
    source = source_with_file(settings, file)
    require_regular_file(file, missing=_ADVICE)
    return NamedSource(name=_name(file), source=source)


def _name(file: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem).strip("_")[:_LONGEST_NAME] or "led"


def _of_toml(path: Path) -> tuple[NamedSource, ...]:
    content = {"sources": read_toml(path, missing="give a file with [[sources]]").get("sources")}
    if not content["sources"]:
        raise InputError(f"{path}: has no [[sources]]; give each LED a name and a source there")
    return section_of(_SourceList, content, str(path), NamedFrom(path.parent, there=True)).sources


def _of_entry(entry: Entry, folder: Path, settings: EmitterSection) -> NamedSource:
    """The LED in a row of a table; its file counts from the ``folder`` of the table."""
    if "file" not in entry.cells:
        raise InputError(f"{entry.where}: must have a file")
    file = folder / entry.cells["file"]
    numbers = {name: number for name in _NUMBERS if (number := entry.number(name)) is not None}
    share = numbers.pop("share", 1.0)
    stated = dict.fromkeys(FluxSection.model_fields) if numbers.keys() & FluxSection.model_fields.keys() else {}
    try:  # of what the spec states of its own LED not half
        source = source_with_file(settings, file, **{**stated, **numbers})
        require_regular_file(file, missing="its name counts from the folder of the table")
        return NamedSource(name=entry.cells.get("name", _name(file)), share=share, source=source)
    except InputError as error:
        raise InputError(f"{entry.where}: {'; '.join(str(error).splitlines())}") from None


def require_told_apart(sources: Sequence[NamedSource]) -> tuple[NamedSource, ...]:
    """The sources. Raises :class:`InputError` unless they are 2 to 100, each with its own name."""
    names = [led.name for led in sources]
    if not 2 <= len(names) <= MOST_SOURCES:
        given = ", ".join(names) if 0 < len(names) < 2 else len(names)
        raise InputError(f"sources: {given} given; a study of LEDs takes 2 to {MOST_SOURCES}")
    if (duplicate := alike(names)) is not None:
        raise InputError(f"sources: {duplicate}; give each its own, by a .csv table or a .toml file")
    return tuple(sources)
