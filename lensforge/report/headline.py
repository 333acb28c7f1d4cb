"""What a reader wants first: are light, files and cutting as they should be, which gates fail, and what to try."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from lensforge.gates import Gate
from lensforge.records import State
from lensforge.report.numerals import number
from lensforge.results import Results

Shown = Literal["pass", "fail", "open"]  # the style in which a verdict is set

_SHOWN: dict[State, Shown] = {"pass": "pass", "fail": "fail", "undecided": "open"}
_STEMS = {
    "stray": "stray light",
    "compare": "photograph",
    "compare_inner": "inner surface",
    "compare_outer": "outer surface",
}

_REMARKS = {
    "design": "There is no design.json, so how the lens was found is not known; run lensforge design.",
    "evaluate": "There is no evaluate.json: the finished lens has not been simulated; run lensforge evaluate.",
    "export": "There is no export.json: no file for a shop has been written; run lensforge export.",
    "check": "There is no check.json: the lens has not been checked for manufacture; run lensforge check.",
    "verify": "There is no verify.json: the exported part has not been verified; run lensforge verify.",
}


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
class Judgement:
    """The verdict on light, on files or on cutting: its name, the word for its state, its style, and its reasons."""

    name: str
    word: str
    shown: Shown
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Headline:
    """The top of a page: the three verdicts, and a sentence on the gates with its style."""

    parts: tuple[Judgement, ...]
    shown: Shown
    sentence: str


def headline(results: Results) -> Headline:
    """The verdict, and whether all gates hold, some fail, or there is more to be run first."""
    verdict = results.verdict
    states: dict[str, State] = {"light": verdict.light, "files": verdict.files, "cutting": verdict.cutting}
    parts = tuple(
        Judgement(name.capitalize(), state, _SHOWN[state], verdict.reasons_of(name)) for name, state in states.items()
    )
    shown, sentence = _on_gates(results)
    return Headline(parts, shown, sentence)


def _on_gates(results: Results) -> tuple[Shown, str]:
    gates = [gate for _, gate in results.gates()]
    failed = [gate for gate in gates if not gate.passed]
    waiting = _waiting(results)
    if failed:
        names = ", ".join(gate.name.replace("_", " ") for gate in failed)
        return "fail", f"{len(failed)} of {len(gates)} gates fail: {names}.{waiting}"
    if not gates:
        return "open", f"Nothing has been judged.{waiting}"
    return "open" if results.missing else "pass", f"All {len(gates)} gates hold.{waiting}"


def _waiting(results: Results) -> str:
    """Which stages of a whole run have yet to run, or to run again."""
    never = [stage for stage in results.missing if stage not in results.outdated]
    again = [stage_name(stem) for stem in results.outdated]
    return "".join(
        f" {words}: {', '.join(names)}." for words, names in (("Not run yet", never), ("Out of date", again)) if names
    )


def outdated(results: Results) -> list[str]:
    """A sentence for each file that belongs to another lens, part or version: which, and why it does not count."""
    return [
        f"{stem}.json does not count: {why.rpartition(f'{stem}.json: ')[2]}." for stem, why in results.outdated.items()
    ]


def missing(results: Results) -> dict[str, str]:
    """A sentence for each stage of a whole run that has not run, by its name."""
    never = (stage for stage in results.missing if stage not in results.outdated)
    return {stage: _REMARKS[stage] for stage in never}


def stage_name(stem: str) -> str:
    """What the result in ``stem``.json is called on a page."""
    return _STEMS.get(stem, stem)


def gate_rows(results: Results) -> list[GateRow]:
    """Every gate of every stage that has run."""
    return [_gate_row(stage_name(stem), gate) for stem, gate in results.gates()]


def _gate_row(stage: str, gate: Gate) -> GateRow:
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


def gates_state(gates: Iterable[Gate], *names: str) -> Literal["pass", "fail", ""]:
    """What those of ``gates`` that are called ``names`` say together; ``""`` where none of them was judged."""
    judged = [gate.passed for gate in gates if gate.name in names]
    return ("pass" if all(judged) else "fail") if judged else ""
