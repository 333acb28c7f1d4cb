"""The JSON schema of a spec, by which editors complete and check a TOML file: ``lensforge schema``."""

from typing import Any

from lensforge.spec.design import Spec
from lensforge.spec.fields import all_sections, kind_of, summary_of, words_of

SCHEMA_FILE = "lensforge.schema.json"


def spec_schema() -> dict[str, Any]:
    """Schema of what a TOML file may hold: types, ranges, words and units of all fields."""
    schema = Spec.model_json_schema()
    objects = {**schema["$defs"], "Spec": schema}
    for section in all_sections(Spec):
        found = objects[section.__name__]
        found["description"] = summary_of(section)
        for name, field in found["properties"].items():
            field["description"] = words_of(section, name)
        if kind_of(section) is not None:  # it chooses among several, so a file has to name it
            found["required"] = ["kind", *(name for name in found.get("required", ()) if name != "kind")]
    return {"title": "lensforge spec", **_table(_plain(schema))}


def _plain(value: Any) -> Any:
    """The same without what only Python has: None, and the titles that pydantic makes of the names of fields."""
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    found = {key: _plain(entry) for key, entry in value.items() if not _is_of_python(key, entry)}
    kinds = [each for each in found.get("anyOf", ()) if each != {"type": "null"}]
    if len(kinds) == 1:
        return {**kinds[0], **{key: entry for key, entry in found.items() if key != "anyOf"}}
    return {**found, "anyOf": kinds} if kinds else found


def _is_of_python(key: str, entry: Any) -> bool:
    return (key == "title" and isinstance(entry, str)) or (key == "default" and entry is None)


def _table(value: Any) -> dict[str, Any]:
    assert isinstance(value, dict)
    return value
