"""A list of LEDs from files: ray files by name or pattern, a table of them, or the ``[[sources]]`` of a TOML file."""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.results.files import MIB, read_file
from lensforge.spec.source_sections import NamedSource, RayfileSource, SourceSpec
from lensforge.spec.spec_files import alike, read_toml
from lensforge.spec.spec_section import Section, section_of

_PATTERN = re.compile(r"[*?\[]")
_NUMBERS = ("share", "flux_lm", "flux_w", "luminous_efficacy_lm_per_w")
_COLUMNS = ("name", "file", *_NUMBERS)
_LONGEST_NAME, MOST_SOURCES = 32, 100
_MOST_BYTES = 4 * MIB
# Fields of a source that another LED in its place has, too.
_KEPT = ("flux_w", "flux_lm", "luminous_efficacy_lm_per_w", "rotate_z_deg", "tilt_deg", "position_mm")


class _SourceList(Section):
    """The sources of a file, whatever else is in it."""

    sources: tuple[NamedSource, ...]


def read_sources(given: Sequence[Path | str], own: SourceSpec) -> tuple[NamedSource, ...]:
    """The LEDs that ``given`` names, in their order.

    Each is a ray file, a pattern of such (``leds/*.ray``), a CSV table with a column file, and those of name, flux_lm,
    flux_w, luminous_efficacy_lm_per_w and share that are known, or a TOML file with ``[[sources]]``. A ray file takes
    the place of the spec's ``own`` source. Raises :class:`InputError`.
    """
    return tuple(led for each in given for led in _read(str(each), own))


def _read(given: str, own: SourceSpec) -> Iterator[NamedSource]:
    if _PATTERN.search(given) and not Path(given).exists():
        root = Path(given).anchor
        files = sorted(Path(root or ".").glob(given.removeprefix(root)))
        if not files:
            raise InputError(f"sources: {given}: no file of this pattern; give ray files, a .csv table or a .toml file")
        for file in files:
            yield _of_file(file, own)
    elif given.endswith(".toml"):
        yield from _of_toml(Path(given))
    elif given.endswith(".csv"):
        yield from _of_table(Path(given), own)
    else:
        yield _of_file(Path(given), own)


def source_with_file(own: SourceSpec, file: Path) -> SourceSpec:
    """The source ``own`` with ``file`` as its ray file.

    Another source is replaced by the file with its virtual focus at the origin, placed as the source was, and with the
    flux that the spec states.
    """
    if isinstance(own, RayfileSource):
        return own.model_copy(update={"file": file.absolute()})
    kept = {name: getattr(own, name) for name in _KEPT}
    return RayfileSource(file=file, origin="virtual_focus", **kept)


def _of_file(file: Path, own: SourceSpec) -> NamedSource:
    if not file.is_file():
        raise InputError(f"sources: {file}: no such file; give ray files, a .csv table or a .toml file")
    return NamedSource(name=_name(file.stem), source=source_with_file(own, file))


def _name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text).strip("_")[:_LONGEST_NAME] or "led"


def _of_toml(path: Path) -> tuple[NamedSource, ...]:
    content = {"sources": read_toml(path, missing="give a file with [[sources]]").get("sources")}
    if not content["sources"]:
        raise InputError(f"{path}: has no [[sources]]; give each LED a name and a source there")
    return section_of(_SourceList, content, str(path), path.parent).sources


def _of_table(path: Path, own: SourceSpec) -> Iterator[NamedSource]:
    """A row for each LED; its file counts from the folder of the table."""
    try:
        text = read_file(path, missing="give a table with a column file", most_bytes=_MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not readable as text; save the table as CSV in UTF-8") from None
    table = csv.DictReader(io.StringIO(text))
    columns = list(table.fieldnames or ())
    unknown = [name for name in columns if name not in _COLUMNS]
    if unknown or "file" not in columns:
        wrong = f"column {unknown[0]!r}" if unknown else "no column file"
        raise InputError(f"{path}: {wrong}; the columns are {', '.join(_COLUMNS)}, of which file is needed")
    for row in table:
        yield _of_row(path, table.line_num, row, own)


def _of_row(path: Path, line: int, row: Mapping[str, Any], own: SourceSpec) -> NamedSource:
    where = f"{path}, line {line}"
    if None in row or not row.get("file"):
        raise InputError(f"{where}: must have a file, and as many entries as there are columns")
    led = _of_file(path.parent / row["file"], own)
    try:
        numbers: dict[str, float | None] = {
            name: float(row[name]) for name in _COLUMNS if name not in ("name", "file") and row.get(name)
        }
    except ValueError:
        raise InputError(f"{where}: flux and share must be numbers") from None
    share = numbers.pop("share", 1.0)
    if "flux_lm" in numbers or "flux_w" in numbers:  # not half of what the spec states of its own LED
        numbers = {"flux_lm": None, "flux_w": None, **numbers}
    given = {name: getattr(led.source, name) for name in led.source.model_fields_set}
    try:
        source = type(led.source)(**{**given, **numbers})
        return NamedSource(name=row.get("name") or led.name, share=share, source=source)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def require_told_apart(sources: Sequence[NamedSource]) -> tuple[NamedSource, ...]:
    """The sources. Raises :class:`InputError` unless they are 2 to 100, each with its own name."""
    names = [led.name for led in sources]
    if not 2 <= len(names) <= MOST_SOURCES:
        given = ", ".join(names) if 0 < len(names) < 2 else len(names)
        raise InputError(f"sources: {given} given; a study of LEDs takes 2 to {MOST_SOURCES}")
    if (words := alike(names)) is not None:
        raise InputError(f"sources: {words}; give each its own, by a .csv table or a .toml file")
    return tuple(sources)
