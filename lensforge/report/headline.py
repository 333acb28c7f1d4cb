"""What a reader wants first: does it hold, and if not, what fails and what to try."""

from dataclasses import dataclass

from lensforge.report.numerals import number
from lensforge.report.records import GateRecord
from lensforge.report.results import Results


@dataclass(frozen=True)
class GateRow:
    """One line of the table of gates."""

    stage: str
    name: str
    value: str
    limit: str
    unit: str
    passed: bool
    remedy: str


@dataclass(frozen=True)
class Verdict:
    """The sentence at the top; ``state`` is "pass", "fail" or "open"."""

    state: str
    sentence: str


def verdict(results: Results) -> Verdict:
    """All gates hold, some fail, or there is more to be run first."""
    gates = [gate for _, gate in results.gates()]
    failed = [gate for gate in gates if not gate.passed]
    missing = f" Not run yet: {', '.join(results.missing)}." if results.missing else ""
    if failed:
        names = ", ".join(gate.name.replace("_", " ") for gate in failed)
        return Verdict("fail", f"{len(failed)} of {len(gates)} gates fail: {names}.{missing}")
    if not gates:
        return Verdict("open", f"Nothing has been judged.{missing}")
    return Verdict("open" if missing else "pass", f"All {len(gates)} gates hold.{missing}")


def gate_rows(results: Results) -> list[GateRow]:
    """Every gate of every stage that has run."""
    return [_gate_row(stage, gate) for stage, gate in results.gates()]


def _gate_row(stage: str, gate: GateRecord) -> GateRow:
    sense = {"<=": "≤", ">=": "≥"}[gate.sense]
    return GateRow(
        stage=stage,
        name=gate.name.replace("_", " "),
        value=number(gate.value, 4),
        limit=f"{sense} {number(gate.limit, 4)}",
        unit=gate.unit,
        passed=gate.passed,
        remedy=gate.remedy,
    )


def failed_rows(results: Results) -> list[GateRow]:
    """The gates that do not hold: what a reader must see first."""
    return [row for row in gate_rows(results) if not row.passed]
