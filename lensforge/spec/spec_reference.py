"""The reference of a spec: its JSON schema, and a page of every section and field (docs/spec.md).

By the schema editors complete and check a TOML file. The page has unit, range, default and meaning of each field.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel

from lensforge.results.numerals import unit_in
from lensforge.results.registered_kinds import kind_of
from lensforge.spec.derived_values import WHY
from lensforge.spec.design_spec import Spec
from lensforge.spec.spec_fields import all_sections, field_description, range_words, sections_in, summary_of

SCHEMA_FILE = "lensforge.schema.json"


def spec_schema() -> dict[str, Any]:
    """Schema of what a TOML file may hold: types, ranges, words and units of all fields."""
    schema = Spec.model_json_schema()
    objects = {**schema["$defs"], "Spec": schema}
    for section in all_sections(Spec):
        table = objects[section.__name__]
        table["description"] = summary_of(section)
        for name, field in table["properties"].items():
            field["description"] = field_description(section, name)
        usual = getattr(section, "usual_kind", None)
        if kind_of(section) not in (None, usual):  # it chooses among several, so a file has to name it
            table["required"] = ["kind", *(name for name in table.get("required", ()) if name != "kind")]
    table = _table(_plain(schema))
    required = [name for name in table["required"] if name != "source"]  # or sources, states
    either = [{"required": [name]} for name in ("source", "sources", "states")]
    return {"title": "lensforge spec", **table, "required": required, "anyOf": either}


def _plain(value: Any) -> Any:
    """The schema ``value`` without what only Python has: None, and the titles that pydantic makes of field names."""
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    kept = {key: _plain(entry) for key, entry in value.items() if not _is_of_python(key, entry)}
    kinds = [kind for kind in kept.get("anyOf", ()) if kind != {"type": "null"}]
    if len(kinds) == 1:
        return {**kinds[0], **{key: entry for key, entry in kept.items() if key != "anyOf"}}
    return {**kept, "anyOf": kinds} if kinds else kept


def _is_of_python(key: str, entry: Any) -> bool:
    return (key == "title" and isinstance(entry, str)) or (key == "default" and entry is None)


def _table(value: Any) -> dict[str, Any]:
    assert isinstance(value, dict)
    return value


def allowed_words(schema: Mapping[str, Any]) -> str:
    """Words for the values that ``schema`` allows: ``0 to 4``, ``"part" or "insert"``, ``list of ...``."""
    if "const" in schema:
        return f'"{schema["const"]}"'
    if "enum" in schema:
        return _either([f'"{choice}"' for choice in schema["enum"]])
    kinds = schema.get("anyOf") or schema.get("oneOf")
    if kinds:
        alternatives = list(dict.fromkeys(allowed_words(kind) for kind in kinds))
        return (
            "table of its kind"
            if len(alternatives) == 1 and alternatives[0] == "table" and len(kinds) > 1
            else _either(alternatives)
        )
    match schema.get("type"):
        case "number":
            return range_words(schema) or "number"
        case "integer":
            return f"whole number {range_words(schema)}".rstrip()
        case "boolean":
            return "true or false"
        case "string":
            return "file" if schema.get("format") == "path" else "text"
        case "array":
            return _list_words(schema)
    return "table"


def _list_words(schema: Mapping[str, Any]) -> str:
    entries = [allowed_words(entry) for entry in schema.get("prefixItems", ())]
    if entries:
        alike = len(set(entries)) == 1
        return f"[{', '.join(entries)}]" if not alike else f"list of {len(entries)}, each {entries[0]}"
    most = f" up to {schema['maxItems']}" if "maxItems" in schema else ""
    return f"list of{most}: {allowed_words(schema.get('items', {}))}"


def _either(alternatives: list[str]) -> str:
    return alternatives[0] if len(alternatives) == 1 else f"{', '.join(alternatives[:-1])} or {alternatives[-1]}"


_HEAD = """# The spec, field by field

Every field of a spec: its unit, what is allowed, its default and what it does. `lensforge schema --page` prints this
page, `lensforge schema` the same as a JSON schema. An editor with a TOML language server completes and checks a spec
whose first line is `#:schema ./lensforge.schema.json`, beside a file of that name; `lensforge new` writes both.

Sections stand in the order of the file. "needed": the section or field has no default;
"derived": left out, it follows from the sizes of source, target and lens, so that the shortest spec is a source, a
target and `constraints.max_radius_mm`. The name of a file counts from the folder of the file that has it, a spec or a
table of LEDs; on the command line and in a script from the folder in which that runs. What formulas stand behind the
numbers: [definitions.md](definitions.md).
"""
_AND = "`, `"  # between tables that have the same fields
_COLUMNS = "| field | unit | allowed | default | |\n|---|---|---|---|---|"


def reference_page() -> str:
    """The page as Markdown."""
    parts = [_HEAD, "## The file as a whole\n", _field_table(Spec, list(Spec.model_fields))]
    for title, sections in _tables(Spec, ""):
        parts += _section_words(title, sections)
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def _tables(section: type[BaseModel], path: str) -> Iterator[tuple[str, tuple[type[BaseModel], ...]]]:
    """Sections by their dotted names in a file, each once, where it first occurs; tables of one kind go together."""
    waiting = [(section, path)]
    seen = set[type[BaseModel]]()
    while waiting:
        holder, place = waiting.pop(0)
        nested = []
        for name, field in holder.model_fields.items():
            inside = tuple(inner for inner in sections_in(field.annotation) if inner not in seen)
            if inside:
                seen |= set(inside)
                alike = [key for key, field in holder.model_fields.items() if field.default_factory is inside[0]]
                yield _AND.join(f"{place}{key}" for key in alike or [name]), inside
                nested += [(inner, f"{place}{name}.") for inner in inside]
        waiting = nested + waiting


def _section_words(title: str, sections: Sequence[type[BaseModel]]) -> Iterator[str]:
    """Heading, words and table of what the field ``title`` may hold: of one section, or of several kinds."""
    yield f"## `{title}`\n"
    if len(sections) == 1:
        yield summary_of(sections[0]) + "\n"
        yield _field_table(sections[0], list(sections[0].model_fields), title)
        return
    shared = [name for name in sections[0].model_fields if name != "kind" and _is_shared(name, sections)]
    yield f"One of the kinds {', '.join(f'`{kind_of(section)}`' for section in sections)}."
    if shared:
        yield f"Every kind has these fields:\n\n{_field_table(sections[0], shared, title)}"
    for section in sections:
        yield f'### `{title}`, `kind = "{kind_of(section)}"`\n\n{summary_of(section)}\n'
        names = [name for name in section.model_fields if name not in shared and name != "kind"]
        if names:
            yield _field_table(section, names)


def _is_shared(name: str, sections: Sequence[type[BaseModel]]) -> bool:
    texts = {field_description(section, name) for section in sections if name in section.model_fields}
    return len(texts) == 1 and all(name in section.model_fields for section in sections)


def _field_table(section: type[BaseModel], names: Sequence[str], place: str = "") -> str:
    schema = _objects()[section.__name__]
    rows = [
        _row(section, name, schema["properties"][name], name in schema.get("required", ()), place) for name in names
    ]
    return "\n".join([_COLUMNS, *rows]) + "\n"


def _row(section: type[BaseModel], name: str, schema: dict[str, Any], needed: bool, place: str) -> str:
    unit = unit_in(name)
    default = f"`{json.dumps(schema['default'], ensure_ascii=False)}`" if "default" in schema else ""
    derived = "; ".join(WHY[key] for table in place.split(_AND) if (key := f"{table}.{name}") in WHY)
    default = f"derived: {derived}" if derived and not default else default
    description = field_description(section, name).removesuffix(f" [{unit}]")
    cells = (f"`{name}`", unit, allowed_words(schema), "needed" if needed else default, description)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


@cache
def _objects() -> dict[str, Any]:
    schema = spec_schema()
    return {**schema["$defs"], "Spec": schema}
