"""Trees of tables, lists and values, as JSON and TOML hold them: changed anywhere, and written as no writer would."""

import json
import re
from collections.abc import Sequence
from typing import Any

from fuzzing.chance import Chance
from fuzzing.extremes import FLOATS, INTEGERS, NO_NUMBERS, SURROGATE, TEXTS
from fuzzing.noise import damaged

_STOP = 0.2  # chance to change a table or list itself and not what is in it
_RAW = "\ue000raw{}\ue000"  # stands for text that is written as it is
_RAW_QUOTED = re.compile('"\ue000raw(\\d+)\ue000"')
_DEPTHS = (3, 100, 1000, 100_000)
_LONG = 1000
# Written without quotes; no value of JSON or TOML, or one that only some readers take.
_RAW_TEXTS = (
    "1" * 5000, "-" + "9" * 400, "1e400", "-1e400", "1e-400", "0x1F", "0b101", "1_000", "+1", "01", "1.", ".5", "1e",
    "NaN", "nan", "inf", "-inf", "Infinity", "-Infinity", "undefined", "null", "None", "true", "True", f'"{SURROGATE}"',
    '"\\u0000"', '"\\x"', "1979-05-27T07:32:00Z", "1979-05-27", "07:32:00", "{}", "[]", "[[]]", '{"a": 1, "a": 2}',
    "[1,]",
    "'''x'''", '"""x"""', "", "}", "]", "#", "//", "\0", "\ud7ff", "0.1" + "0" * 10_000, "1" + "0" * 308, "-0", "-0.0",
)  # fmt: skip


def changed_tree(chance: Chance, tree: Any) -> tuple[Any, list[str]]:
    """``tree``, which is changed in a few places, and the raw texts that stand in it for :func:`as_json`."""
    raw: list[str] = []
    for _ in range(chance.few(4)):
        _change(chance, tree, raw)
    return tree, raw


def as_json(tree: Any, raw: Sequence[str]) -> str:
    """JSON, or what the raw texts make of it."""
    return _with_raw(json.dumps(tree, ensure_ascii=True), raw)


def as_toml(tree: dict[str, Any], raw: Sequence[str]) -> str:
    """TOML: a section for each table, all that is deeper on one line."""
    lines = [f"{_key(key)} = {_toml(value)}" for key, value in tree.items() if not isinstance(value, dict)]
    for name, section in tree.items():
        if isinstance(section, dict):
            lines += [f"[{_key(name)}]", *(f"{_key(key)} = {_toml(value)}" for key, value in section.items())]
    return _with_raw("\n".join(lines) + "\n", raw)


def damaged_text(chance: Chance, text: str, samples: Sequence[bytes]) -> bytes:
    """The text as bytes; in one case of eight with damage that knows nothing of its structure."""
    content = text.encode("utf-8", "surrogatepass")
    return damaged(chance, content, samples) if chance.share(0.125) else content


def _with_raw(text: str, raw: Sequence[str]) -> str:
    return _RAW_QUOTED.sub(lambda match: raw[int(match.group(1))], text.replace("\\ue000", "\ue000"))


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value)


def _change(chance: Chance, tree: Any, raw: list[str]) -> None:
    """One change somewhere below ``tree``."""
    holder, key = _place(chance, tree)
    if holder is None:
        return
    kind = chance.below(14)
    value = holder[key]
    if kind < 3:
        holder[key] = _extreme(chance, value)
    elif kind == 3:
        raw.append(chance.pick(_RAW_TEXTS))
        holder[key] = _RAW.format(len(raw) - 1)
    elif kind == 4:
        del holder[key]
    elif kind == 5:
        _add(chance, holder, value)
    elif kind == 6:
        holder[key] = [value] if chance.share(0.5) else {str(chance.pick(TEXTS)): value}
    elif kind == 7:
        other, at = _place(chance, tree)
        if other is not None and not isinstance(other[at], dict | list) and not isinstance(value, dict | list):
            holder[key], other[at] = other[at], value
    elif kind == 8:
        raw.append(_nested(chance))
        holder[key] = _RAW.format(len(raw) - 1)
    elif kind == 9:
        holder[key] = chance.pick(TEXTS)
    elif kind == 10:
        holder[key] = chance.pick((None, True, False, [], {}, "", 0, -1, 3.5, [[]], [None], {"a": 1}))
    else:
        holder[key] = _near(chance, value)


def _place(chance: Chance, tree: Any) -> tuple[Any, Any]:
    """A table or list, and one key of it; (None, None) where all is empty."""
    holder, key, found = None, None, tree
    while isinstance(found, dict | list) and found:
        if holder is not None and chance.share(_STOP):
            break
        holder = found
        key = chance.pick(list(found)) if isinstance(found, dict) else chance.below(len(found))
        found = found[key]
    return holder, key


def _extreme(chance: Chance, value: Any) -> Any:
    """A value at the bounds of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return chance.pick((*INTEGERS, *FLOATS[:4]))
    if isinstance(value, float):
        return chance.pick((*FLOATS, *FLOATS, *NO_NUMBERS, *INTEGERS))
    if isinstance(value, str):
        return chance.pick(TEXTS)
    if isinstance(value, list):
        return chance.pick(
            (value * 2, value[:-1], value[:1], [], value[::-1], value * _LONG if len(value) < 4 else value * 3)
        )
    return {} if value is None or chance.share(0.5) else {**value, "kind": chance.pick(TEXTS)}


def _near(chance: Chance, value: Any) -> Any:
    """A value that is a little or a thousandfold off."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _extreme(chance, value)
    factor = chance.pick((1.0 + 1e-9, 1.001, 0.999, 2.0, -1.0, 1e3, 1e-3, 1e6, 1e100))
    if isinstance(value, int):
        return value + chance.pick((-1, 1)) if chance.share(0.5) or value > 2**53 else int(value * factor)
    return value * factor


def _add(chance: Chance, holder: Any, value: Any) -> None:
    """One entry more: a field that is not known, or the same value again."""
    if isinstance(holder, list):
        holder.insert(chance.below(len(holder)), value)
    else:
        holder[chance.pick(("x", "kind", "file", "version", "schema", "", "__init__", "a" * 300, "\u202e", "lens"))] = (
            value
        )


def _nested(chance: Chance) -> str:
    depth = chance.pick(_DEPTHS)
    opening, closing = chance.pick((("[", "]"), ('{"a":', "}"), ("{a=", "}")))
    return opening * depth + "1" + closing * depth
