"""Numbers of whole records and of the spec that the report must list, by their paths, with the units of their names."""

import re
from pathlib import Path

from shown_numbers import shown

_UNITS = {
    "lm_per_w": "lm/W", "per_mm": "1/mm", "seconds": "s", "pixel2": "pixel²", "mrad": "mrad", "w_m2": "W/m²",
    "mm3": "mm³", "mm2": "mm²", "rad": "rad", "deg": "°", "mm": "mm", "um": "µm", "nm": "nm", "lm": "lm", "cd": "cd",
    "px": "pixel", "w": "W",
}  # fmt: skip
_NAMED = {"seconds": "s", "bytes": "B", "filter_variance": "pixel²", "rate": "1/s", "lumens": "lm", "watts": "W"}
_NAMED["lumens_per_watt"] = "lm/W"
_RATIO = re.compile("fraction|share|count|nmse|efficiency")
_METRIC, _BLOCK = {"value", "unit", "standard_error"}, 6


def record_numbers(results):
    """Entries of the tables of the spec and of every record."""
    again = "Reproduce this design"
    for section, content in _sections(results.spec).items():
        yield from _entries(" / ".join([again, "Specification", *([f"[{section}]"] if section else [])]), content)
    records = {stem: each.plain() for stem, each in {**results.found, **results.others}.items()}
    for stem, content in {"lens": results.lens.to_json(), **records}.items():
        kept = {key: value for key, value in content.items() if key not in ("criteria", "verdicts", "spec")}
        yield shown("heading", f"{stem}.json")
        yield from _entries(f"{again} / All numbers / {stem}.json", kept)


def _sections(spec):
    given = {key: value for key, value in spec.model_dump().items() if value is not None and key != "receivers"}
    found = {"": {key: value for key, value in given.items() if not isinstance(value, dict)}}
    found |= {key: value for key, value in given.items() if isinstance(value, dict)}
    if "target" in found:
        found["target"] = {key: value for key, value in found["target"].items() if value is not None}
    for receiver in spec.all_receivers if spec.receivers else ():
        found[f"receivers.{receiver.name}"] = receiver.model_dump(exclude_none=True)
    return found


def _entries(table, content):
    for path, words, numbers, unit, many in entries_of(content):
        label = f"{table} / {path}"
        if many > _BLOCK:
            yield shown(f"{label} / note", words, *numbers)
            if unit:
                yield shown(label, unit)
        else:
            yield shown(label, f"{words} {unit}".rstrip(), *numbers)


def entries_of(content):
    """Path, words, numbers and unit of every entry, and how many values it has."""
    for names, values in _leaves(content, ()):
        path = ".".join(names).replace(".[", "[")
        if isinstance(values, dict):
            known = [values["value"], *filter(None, [values["standard_error"]])]
            yield path, " ± ".join("{}" for _ in known), known, values["unit"] or _unit(names), 1
            continue
        many = values if isinstance(values, list | tuple) else [values]
        words, numbers = " ".join(map(_words, many)) if many else "–", [each for each in many if _is_number(each)]
        yield path, words, numbers, _unit(names) if numbers else "", len(many)


def _leaves(content, names):
    """Each value with the names that lead to it; a metric, and a list of numbers or texts, is one."""
    if isinstance(content, dict) and content.keys() != _METRIC:
        for key, value in content.items():
            yield from _leaves(value, (*names, str(key)))
    elif isinstance(content, list | tuple) and any(isinstance(each, dict | list | tuple) for each in content):
        for index, value in enumerate(content):
            yield from _leaves(value, (*names, f"[{index}]"))
    else:
        yield names, content


def _is_number(value):
    return isinstance(value, int | float) and not isinstance(value, bool)


def _words(value):
    if _is_number(value):
        return "{}"
    if value is None or isinstance(value, bool):
        return {None: "–", True: "yes", False: "no"}[value]
    text = value.name if isinstance(value, Path) else str(value)
    return re.sub(r"[ \n\t]+", " ", text)


def _unit(names):
    """Unit that the innermost name states; none of a ratio."""
    for name in reversed(names):
        if name in _NAMED:
            return _NAMED[name]
        ends = [ending for ending in _UNITS if name.endswith(f"_{ending}")]
        if ends:
            return _UNITS[max(ends, key=len)]
        if _RATIO.search(name):
            return ""
    return ""
