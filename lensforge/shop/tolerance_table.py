"""Table of tolerances on the drawing: of the lens, and of LED and mounting; each with the largest that may be."""

from collections.abc import Sequence
from dataclasses import dataclass

from lensforge.errors import InputError
from lensforge.results import Group
from lensforge.results.numerals import NOTHING
from lensforge.scene.lens import Lens
from lensforge.spec.tolerances_section import Factor, amount_words, factors_of

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


def tolerance_table(lens: Lens, studied: Sequence[Group] = ()) -> ToleranceTable:
    """The tolerances of the spec; ``studied``: facts of the yield under them, none where it has not been computed."""
    section = lens.spec.tolerances
    try:
        factors = factors_of(section)
    except InputError:  # all of them are 0
        factors = ()
    budget = {group.title: group for group in studied if group.key == "budget"}
    rows = {factor.name: _row(lens, factor, budget.get(factor.words)) for factor in factors}
    assembly = tuple(row for name, row in rows.items() if name.startswith(_OF_ASSEMBLY))
    own = tuple(row for name, row in rows.items() if not name.startswith(_OF_ASSEMBLY))
    passing = _passing(studied)
    sentence = _sentence(studied, passing) if rows else "The specification sets no tolerances."
    return ToleranceTable(sentence, passing, own, assembly)


def _row(lens: Lens, factor: Factor, budget: Group | None) -> ToleranceRow:
    section = lens.spec.tolerances
    given = getattr(section, factor.name) is not None
    words = amount_words(factor.name, factor.amount, factor.unit)
    if factor.name.endswith(_RMS):
        words = f"{words} rms"
    elif factor.name.endswith(_PEAK):
        words = f"{words} peak to valley"
    elif factor.kind == "spread":
        words = f"± {words}"
    at_most = ""
    if budget is not None:
        most = budget.fact("at_most").text
        at_most = budget.fact("interval").text if most == NOTHING else most
    return ToleranceRow(factor.words, words, "specification" if given else f"preset “{section.preset}”", at_most)


def _sentence(studied: Sequence[Group], passing: str) -> str:
    if not passing:
        return (
            "Amounts of the specification and of its preset. How many parts pass with them has not been computed; "
            "`lensforge yield` does."
        )
    wanted = [fact.text for group in studied for fact in group.select("wanted").facts]
    if not wanted:
        return f"{passing}."
    return f"{passing}. At most: the amount at which {wanted[0]} of them pass, the other tolerances as they are."


def _passing(studied: Sequence[Group]) -> str:
    found = next((group for group in studied if group.key == "yield"), None)
    if found is None:
        return ""
    return f"{found.fact('pass_rate').text} of {found.fact('parts').text} parts drawn from these amounts pass"
