"""The reference of a spec as a page: every section and field with unit, range, default and meaning (docs/spec.md)."""

import json
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel

from lensforge.spec.derived import WHY
from lensforge.spec.design import Spec
from lensforge.spec.fields import kind_of, sections_in, summary_of, unit_of, words_of
from lensforge.spec.json_schema import spec_schema
from lensforge.spec.ranges import allowed_words

_HEAD = """# The spec, field by field

Written by `lensforge schema --page`, from the same descriptions and ranges as the messages and the JSON schema that
`lensforge schema` prints. An editor with a TOML language server completes and checks a spec whose first line is
`#:schema ./lensforge.schema.json`, beside a file of that name; `lensforge new` writes both.

Sections stand in the order of the file. "needed": the section or field has no default;
"derived": left out, it follows from the sizes of source, target and lens, so that the shortest spec is a source, a
target and `constraints.max_radius_mm`. What formulas stand behind the
numbers: [definitions.md](definitions.md).
"""
_COLUMNS = "| field | unit | allowed | default | |\n|---|---|---|---|---|"


def reference_page() -> str:
    """The page as Markdown."""
    parts = [_HEAD, "## The file as a whole\n", _field_table(Spec, list(Spec.model_fields))]
    for title, sections in _tables(Spec, ""):
        parts += _section_words(title, sections)
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def _tables(section: type[BaseModel], path: str) -> Iterator[tuple[str, tuple[type[BaseModel], ...]]]:
    """Sections by their dotted names in a file, each once, where it first occurs."""
    waiting, seen = [(section, path)], set[type[BaseModel]]()
    while waiting:
        holder, place = waiting.pop(0)
        nested = []
        for name, field in holder.model_fields.items():
            inside = tuple(each for each in sections_in(field.annotation) if each not in seen)
            if inside:
                seen |= set(inside)
                title = f"{place}{name}"
                yield title, inside
                nested += [(each, f"{title}.") for each in inside]
        waiting = nested + waiting


def _section_words(title: str, sections: Sequence[type[BaseModel]]) -> Iterator[str]:
    """Heading, words and table of what the field ``title`` may hold: of one section, or of several kinds."""
    yield f"## `{title}`\n"
    if len(sections) == 1:
        yield summary_of(sections[0]) + "\n"
        yield _field_table(sections[0], list(sections[0].model_fields), title)
        return
    shared = [name for name in sections[0].model_fields if name != "kind" and _is_shared(name, sections)]
    yield f"One of the kinds {', '.join(f'`{kind_of(each)}`' for each in sections)}."
    if shared:
        yield f"Every kind has these fields:\n\n{_field_table(sections[0], shared, title)}"
    for each in sections:
        yield f'### `{title}`, `kind = "{kind_of(each)}"`\n\n{summary_of(each)}\n'
        own = [name for name in each.model_fields if name not in shared and name != "kind"]
        if own:
            yield _field_table(each, own)


def _is_shared(name: str, sections: Sequence[type[BaseModel]]) -> bool:
    """True for a field that means the same in all of ``sections``."""
    found = {words_of(each, name) for each in sections if name in each.model_fields}
    return len(found) == 1 and all(name in each.model_fields for each in sections)


def _field_table(section: type[BaseModel], names: Sequence[str], place: str = "") -> str:
    schema = _objects()[section.__name__]
    rows = [
        _row(section, name, schema["properties"][name], name in schema.get("required", ()), place) for name in names
    ]
    return "\n".join([_COLUMNS, *rows]) + "\n"


def _row(section: type[BaseModel], name: str, schema: dict[str, Any], needed: bool, place: str) -> str:
    unit = unit_of(name)
    default = f"`{json.dumps(schema['default'], ensure_ascii=False)}`" if "default" in schema else ""
    derived = WHY.get(f"{place}.{name}")
    default = f"derived: {derived}" if derived and not default else default
    words = words_of(section, name).removesuffix(f" [{unit}]")
    cells = (f"`{name}`", unit, allowed_words(schema), "needed" if needed else default, words)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


@cache
def _objects() -> dict[str, Any]:
    schema = spec_schema()
    return {**schema["$defs"], "Spec": schema}
