"""Rows of the table of manufacturing and alignment errors: the change of the light by each, with its standard error."""

from dataclasses import dataclass

from lensforge.made.tolerance_result import ErrorRow, Sensitivity
from lensforge.report.numerals import number, number_with_error
from lensforge.runs.results import Results

_DIGITS = 4  # at most; the standard error leaves fewer


@dataclass(frozen=True)
class ChangeRow:
    """One error, its amount with its unit, and the change of each metric by it."""

    name: str
    amount: str
    nmse: str
    uniformity: str
    rsd: str
    efficiency: str


def change_rows(results: Results) -> list[ChangeRow]:
    """A row for each error of the study; none without one."""
    found = results.find(Sensitivity)
    return [] if found is None else [_row(each) for each in found.rows]


def _row(row: ErrorRow) -> ChangeRow:
    changes = {name: number_with_error(metric, _DIGITS) for name, metric in row.change}
    return ChangeRow(row.name, f"{number(row.amount, 3)} {row.unit}".rstrip(), **changes)
