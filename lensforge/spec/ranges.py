"""Words for what a field may hold, from its part of the JSON schema."""

from collections.abc import Mapping
from typing import Any


def allowed_words(schema: Mapping[str, Any]) -> str:
    """Words for the values that ``schema`` allows: ``0 to 4``, ``"part" or "insert"``, ``list of ...``."""
    if "const" in schema:
        return f'"{schema["const"]}"'
    if "enum" in schema:
        return _either([f'"{each}"' for each in schema["enum"]])
    kinds = schema.get("anyOf") or schema.get("oneOf")
    if kinds:
        found = list(dict.fromkeys(allowed_words(each) for each in kinds))
        return "table of its kind" if len(found) == 1 and found[0] == "table" and len(kinds) > 1 else _either(found)
    match schema.get("type"):
        case "number" | "integer":
            return _number_words(schema)
        case "boolean":
            return "true or false"
        case "string":
            return "file" if schema.get("format") == "path" else "text"
        case "array":
            return _list_words(schema)
    return "table"


def _number_words(schema: Mapping[str, Any]) -> str:
    kind = "whole number" if schema["type"] == "integer" else "number"
    low, high = (schema.get(name) for name in ("minimum", "maximum"))
    above, below = (schema.get(name) for name in ("exclusiveMinimum", "exclusiveMaximum"))
    start = f"above {above:g}" if above is not None else _short(low)
    end = f"below {below:g}" if below is not None else _short(high)
    reach = f"{start} to {end}" if start and end else f"at least {start}" if low is not None else start or end
    whole = "whole number " if kind == "whole number" else ""
    return f"{whole}{reach}" if reach else kind


def _short(value: float | None) -> str:
    return "" if value is None else str(value) if isinstance(value, int) else f"{value:g}"


def _list_words(schema: Mapping[str, Any]) -> str:
    entries = [allowed_words(each) for each in schema.get("prefixItems", ())]
    if entries:
        alike = len(set(entries)) == 1
        return f"[{', '.join(entries)}]" if not alike else f"list of {len(entries)}, each {entries[0]}"
    most = f" up to {schema['maxItems']}" if "maxItems" in schema else ""
    return f"list of{most}: {allowed_words(schema.get('items', {}))}"


def _either(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
