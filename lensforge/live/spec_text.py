"""The text of a spec that is being written: read, judged line by line, changed by a form, and begun from an example."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.live.page_frames import Fields
from lensforge.live.toml_edit import Place, edited
from lensforge.spec import Spec
from lensforge.spec.shipped_specs import named_files, shipped_specs
from lensforge.spec.spec_files import NamedFrom
from lensforge.spec.spec_section import section_of
from lensforge.spec.toml_bounds import bounded_tables
from lensforge.spec.toml_slips import tables_of

_FIELD = re.compile(r"([A-Za-z_][\w-]*(?:\.[\w-]+)*)(?: = |: )")


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
            words = [each.removeprefix(f"{path}: ") for each in str(error).splitlines()]
            fields = [_FIELD.match(each) for each in words]
            lines = tuple((field[1] if field else "", each) for field, each in zip(fields, words, strict=True))
            return SpecText(text, path, tables, lines=lines)

    def required(self) -> Spec:
        """The spec. Raises :class:`InputError` with the lines on what is wrong with it."""
        if self.spec is None:
            raise InputError("\n".join(words for _, words in self.lines))
        return self.spec

    def with_text(self, text: str) -> "SpecText":
        """Another text in the same place."""
        return SpecText.of(text, self.path, self.tables)

    def edited(self, place: Place, given: object) -> "SpecText":
        """The text with a value of the form at ``place``; None leaves it out.

        A text in ``{"toml": ...}`` is read as TOML, where it is some. With another kind the fields that it does not
        have leave their table. Raises :class:`InputError` for a text that is no TOML.
        """
        found = self.with_text(edited(self.text, place, _value(given)))
        for name, words in found.lines if place[-1] == "kind" else ():
            table, _, field = name.rpartition(".")
            if table == ".".join(map(str, place[:-1])) and ": unknown" in words:
                found = found.with_text(edited(found.text, (*place[:-1], field), None))
        return found

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


def _value(given: object) -> object:
    if not isinstance(given, Mapping) or "toml" not in given:
        return given
    words = str(given["toml"]).strip()
    try:
        return bounded_tables(f"v = {words}")["v"]
    except ValueError:
        return words  # the spec says what is wrong with it
