"""Tables of records and of a spec: a row for every number, with its path, value and unit."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256

from lensforge.report.results import Results
from lensforge.results import Metric
from lensforge.results.numerals import NOTHING, anything, number, quantity, unit_of

_SHORT = 6  # up to so many numbers share a cell; more become a block
_METRIC = frozenset(Metric.model_fields)
_PACKED = frozenset(("shape", "float64"))  # an array of a spec, as spec/spec_section.py writes it


@dataclass(frozen=True)
class TableRow:
    """One line of a table; ``block`` for many numbers, which need the full width."""

    path: str
    value: str
    unit: str
    block: bool = False


def rows(content: Mapping[str, object], without: Sequence[str] = ()) -> list[TableRow]:
    """A row for each value in ``content``, in order, except the top-level keys in ``without``; a metric is one row."""
    kept = {key: value for key, value in content.items() if key not in without}
    return list(_walk(kept, ()))


def spec_tables(results: Results) -> dict[str, list[TableRow]]:
    """Rows of each section of the spec by name, top-level ones under ``""``; of target and receivers what is given."""
    spec = results.spec
    tables = {}
    content = {key: value for key, value in spec.model_dump().items() if value is not None and key != "receivers"}
    tables[""] = rows({key: value for key, value in content.items() if not isinstance(value, dict)})
    for key, value in content.items():
        if isinstance(value, dict):
            tables[key] = rows(value if key != "target" else {k: v for k, v in value.items() if v is not None})
    for receiver in spec.all_receivers if spec.receivers else ():
        tables[f"receivers.{receiver.name}"] = rows(receiver.model_dump(exclude_none=True))
    return tables


def number_tables(results: Results) -> dict[str, list[TableRow]]:
    """All values of each file, by its name; criteria, verdicts and the spec have their own tables."""
    records = {stem: result.plain() for stem, result in {**results.found, **results.others}.items()}
    tables: dict[str, Mapping[str, object]] = {"lens": results.lens.to_json(), **records}
    return {f"{stem}.json": rows(content, without=("criteria", "verdicts", "spec")) for stem, content in tables.items()}


def _walk(content: object, names: tuple[str, ...]) -> Iterator[TableRow]:
    if isinstance(content, dict) and content.keys() == _METRIC:
        yield _metric(content, names)
    elif isinstance(content, dict) and content.keys() == _PACKED:
        yield TableRow(_path(names), _packed(content), "")
    elif isinstance(content, dict):
        for key, value in content.items():
            yield from _walk(value, (*names, str(key)))
    elif isinstance(content, list | tuple) and any(isinstance(item, dict | list | tuple) for item in content):
        for index, item in enumerate(content):
            yield from _walk(item, (*names, f"[{index}]"))
    elif isinstance(content, list | tuple):
        text = "  ".join(map(anything, content)) or NOTHING
        yield TableRow(_path(names), text, _unit(content, names), len(content) > _SHORT)
    else:
        yield TableRow(_path(names), anything(content), _unit([content], names))


def _metric(content: Mapping[str, object], names: tuple[str, ...]) -> TableRow:
    """Value, standard error and unit in one row, with the digits that the error carries."""
    metric = Metric.model_validate(content)
    value = quantity(metric.value, "", metric.standard_error)
    return TableRow(_path(names), value, metric.unit or unit_of(names))


def _packed(content: Mapping[str, object]) -> str:
    """Shape of an array, and a short hash that identifies it."""
    shape = content["shape"]
    count = " × ".join(map(number, shape)) if isinstance(shape, list | tuple) else NOTHING
    return f"{count} numbers, SHA-256 {sha256(str(content['float64']).encode()).hexdigest()[:12]}…"


def _unit(values: Sequence[object], names: tuple[str, ...]) -> str:
    """Unit of a number; text, true or false, and a missing value have none."""
    numeric = any(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return unit_of(names) if numeric else ""


def _path(names: tuple[str, ...]) -> str:
    return ".".join(names).replace(".[", "[")
