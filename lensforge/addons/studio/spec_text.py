"""The text of a spec that is being written: read, judged line by line, changed by a form, and begun from an example."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lensforge.addons.studio.page_frames import Fields
from lensforge.addons.studio.toml_edit import Place, edited
from lensforge.errors import InputError, LensforgeError
from lensforge.spec import Spec
from lensforge.spec.shipped_specs import named_files, shipped_specs
from lensforge.spec.spec_files import NamedFrom
from lensforge.spec.spec_section import section_of
from lensforge.spec.toml_bounds import bounded_tables
from lensforge.spec.toml_slips import tables_of

_DOS = "\r\n"
_FIELD = re.compile(r"([A-Za-z_][\w-]*(?:\.[\w-]+)*)( = |: )")
_WITHIN = re.compile(r"(?!missing|unknown)([a-z][a-z0-9_]*)(?: = |: )")  # a field of the table that a line begins with


@dataclass(frozen=True)
class SpecText:
    """A text of a spec in the place of ``path``: its tables, its spec, or the lines on what is wrong with it.

    ``tables``: the last that could be read. ``lines``: each with the dotted name of its field, "" for none.
    """

    text: str
    path: Path
    tables: Mapping[str, Any]
    spec: Spec | None = None
    lines: tuple[tuple[str, str], ...] = ()

    @staticmethod
    def of(text: str, path: Path, before: Mapping[str, Any] | None = None) -> "SpecText":
        """Read a text; ``before``: tables of the one before it, where this one is no TOML."""
        tables = before or {}
        try:
            tables = tables_of(text, path)
            spec = section_of(Spec, {"name": path.stem, **tables}, str(path), NamedFrom(path.parent, there=True))
            return SpecText(text, path, tables, spec)
        except InputError as error:
            return SpecText(text, path, tables, lines=lines_of(error, path))

    def required(self) -> Spec:
        """The spec. Raises :class:`InputError` with the lines on what is wrong with it."""
        if self.spec is None:
            raise InputError("\n".join(line for _, line in self.lines))
        return self.spec

    def with_text(self, text: str) -> "SpecText":
        """Another text in the same place; line ends of DOS, which a browser leaves out, stay."""
        of_dos = _DOS in self.text and _DOS not in text
        return SpecText.of(text.replace("\n", _DOS) if of_dos else text, self.path, self.tables)

    def moved(self, path: Path) -> "SpecText":
        """The same text, to be written to another ``path`` in the same folder."""
        return replace(self, path=path)

    def edited(self, place: Place, given: object) -> "SpecText":
        """The text with a value of the form at ``place``; None leaves it out.

        The text of ``{"toml": ...}`` is read as TOML. A change of ``kind`` removes the fields that the new kind does
        not have. Raises :class:`InputError` for a text that is no TOML.
        """
        changed = self.with_text(edited(self._plain, place, _value(given)))
        for name, problem in changed.lines if place[-1] == "kind" else ():
            table, _, field = name.rpartition(".")
            if table == ".".join(map(str, place[:-1])) and ": unknown" in problem:
                changed = changed.with_text(edited(changed._plain, (*place[:-1], field), None))
        return changed

    def with_table(self, name: str, table: Mapping[str, object]) -> "SpecText":
        """The text with another ``table``, "source" or "target", in place of that or of its list."""
        text = self._plain
        for gone in {name, {"source": "sources", "target": "receivers"}[name]} & set(self.tables):
            text = edited(text, (gone,), None)
        return self.with_text(edited(text, (name,), table))

    @property
    def _plain(self) -> str:
        return self.text.replace(_DOS, "\n")

    def from_example(self, name: str) -> "SpecText":
        """The text of a shipped spec, which names its files by their whole paths. Raises :class:`InputError`."""
        specs = shipped_specs()
        if name not in specs:
            raise InputError(f"examples {name}: not found; known: {', '.join(specs)}")
        text = specs[name].read_text(encoding="utf-8")
        for file in named_files(specs[name]):
            text = text.replace(f'"{file.name}"', json.dumps(str(file), ensure_ascii=False))
        return self.with_text(text)

    def shown(self) -> Fields:
        """Text, tables, lines and, of a spec that holds, all of its values: for the page."""
        values = None if self.spec is None else self.spec.model_dump(mode="json")
        return {"text": self.text, "tables": self.tables, "lines": self.lines, "values": values}


def lines_of(error: LensforgeError, path: Path | None = None) -> tuple[tuple[str, str], ...]:
    """Lines of an ``error``, each with the dotted name of its field, "" for none; without the ``path`` of the text."""
    lines = [line if path is None else line.removeprefix(f"{path}: ") for line in str(error).splitlines()]
    return tuple((_field_of(line), line) for line in lines)


def _field_of(line: str) -> str:
    """The dotted name of the field that a line is about: "target.width_mm" of "target: width_mm: missing"."""
    table = _FIELD.match(line)
    if table is None:
        return ""
    field = _WITHIN.match(line, table.end())
    return table[1] if field is None or table[2] != ": " else f"{table[1]}.{field[1]}"


def _value(given: object) -> object:
    if not isinstance(given, Mapping) or "toml" not in given:
        return given
    value = str(given["toml"]).strip()
    try:
        return bounded_tables(f"v = {value}")["v"]
    except ValueError:
        return value  # the spec says what is wrong with it
