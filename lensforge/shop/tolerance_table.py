"""Table of tolerances on the drawing: of the lens, and of LED and mounting; each with the largest that may be."""

from dataclasses import dataclass

from lensforge.errors import InputError
from lensforge.made.tolerance_result import BudgetRow, Yield
from lensforge.report.numerals import percent
from lensforge.report.yield_rows import amount, budget_line
from lensforge.scene.lens import Lens
from lensforge.scene.tolerance_factors import Factor, factors_of

_OF_ASSEMBLY = ("source_", "lens_")
_RMS, _PEAK = ("_form_um", "_waviness_um"), ("_ripple_um",)


@dataclass(frozen=True)
class ToleranceRow:
    """One tolerance: its amount, where that comes from, and the largest at which enough parts pass ("" if unknown)."""

    name: str
    amount: str
    source: str
    at_most: str


@dataclass(frozen=True)
class ToleranceTable:
    """Tolerances of the ``lens``, which its maker keeps, and of the ``assembly``: LED, and the lens on its board.

    ``passing``: share of the parts that pass with them, "" where that has not been computed.
    """

    sentence: str
    passing: str
    lens: tuple[ToleranceRow, ...]
    assembly: tuple[ToleranceRow, ...]

    @property
    def groups(self) -> dict[str, tuple[ToleranceRow, ...]]:
        """Rows by their heading, those groups that have any."""
        named = {"The lens": self.lens, "LED and mounting": self.assembly}
        return {title: rows for title, rows in named.items() if rows}


def tolerance_table(lens: Lens, found: Yield | None) -> ToleranceTable:
    """The tolerances of the spec; ``found``: the yield study under them, None where it has not run."""
    section = lens.spec.tolerances
    try:
        factors = factors_of(section)
    except InputError:  # all of them are 0
        factors = ()
    budget = {} if found is None or found.budget is None else {row.tolerance: row for row in found.budget.alone}
    rows = {factor.name: _row(lens, factor, budget.get(factor.name)) for factor in factors}
    assembly = tuple(row for name, row in rows.items() if name.startswith(_OF_ASSEMBLY))
    own = tuple(row for name, row in rows.items() if not name.startswith(_OF_ASSEMBLY))
    sentence = _sentence(found) if rows else "The specification sets no tolerances."
    return ToleranceTable(sentence, "" if found is None else _passing(found), own, assembly)


def _row(lens: Lens, factor: Factor, budget: BudgetRow | None) -> ToleranceRow:
    section = lens.spec.tolerances
    given = getattr(section, factor.name) is not None
    words = amount(factor.name, factor.amount, factor.unit)
    if factor.name.endswith(_RMS):
        words = f"{words} rms"
    elif factor.name.endswith(_PEAK):
        words = f"{words} peak to valley"
    elif factor.kind == "spread":
        words = f"± {words}"
    at_most = ""
    if budget is not None:
        line = budget_line(budget)
        at_most = line.at_most if budget.at_most is not None or budget.unlimited else line.interval
    return ToleranceRow(factor.words, words, "specification" if given else f"preset “{section.preset}”", at_most)


def _sentence(found: Yield | None) -> str:
    if found is None:
        return (
            "Amounts of the specification and of its preset. How many parts pass with them has not been computed; "
            "`lensforge yield` does."
        )
    passing = _passing(found)
    if found.budget is None:
        return f"{passing}."
    wanted = percent(found.budget.pass_rate, 0)
    return f"{passing}. At most: the amount at which {wanted} of them pass, the other tolerances as they are."


def _passing(found: Yield) -> str:
    return f"{percent(found.pass_rate.value)} of {found.parts} parts drawn from these amounts pass"
