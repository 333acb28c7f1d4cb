"""A record of any kind on the screen: a line for each number, with its unit, under its name in words."""

from collections.abc import Iterator, Mapping, Sequence

from lensforge.cli.rounded import count, figure, measured
from lensforge.cli.screen import Row
from lensforge.report.numerals import unit_of
from lensforge.results import Metric

_METRIC = {"value", "unit", "standard_error"}
_DIGITS = 6  # of a file's own numbers
_MOST_ENTRIES = 3  # of a list; a longer one is counted


def record_rows(content: Mapping[str, object], *path: str) -> Iterator[Row]:
    """Lines for ``content``, the plain form of a record, whose own name is ``path``."""
    for key, value in content.items():
        names = (*path, key)
        if isinstance(value, Mapping) and set(value) == _METRIC:
            yield _label(names), measured(Metric.model_validate(value))
        elif isinstance(value, Mapping):
            yield from record_rows(value, *names)
        elif value is not None and value != []:
            yield _label(names), _text(value, unit_of(names))


def _label(names: Sequence[str]) -> str:
    """The path in words, its unit left out."""
    unit = unit_of(names)
    ends = {"mm": "_mm", "W": "_w", "lm": "_lm", "cd": "_cd", "°": "_deg", "nm": "_nm", "lm/W": "_lm_per_w"}
    return " ".join(name.removesuffix(ends.get(unit, "")).replace("_", " ") for name in names)


def _text(value: object, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{count(value)} {unit}".rstrip()
    if isinstance(value, float):
        return figure(value, unit, _DIGITS)
    if isinstance(value, list) and len(value) > _MOST_ENTRIES:
        return f"{len(value)} entries"
    if isinstance(value, list):
        return ", ".join(_text(each, "") for each in value) + (f" {unit}" if unit else "")
    return str(value)
