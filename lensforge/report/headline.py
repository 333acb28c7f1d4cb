"""The top of a page: the task in words, the verdict on light, files and cutting, and the criteria with remedies."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from lensforge.criteria import Criterion
from lensforge.records import State
from lensforge.report.numerals import number
from lensforge.results import Results
from lensforge.spec import CrossTarget, FlatTopTarget, Spec, TextTarget
from lensforge.spec.target import ArrayTarget

Shown = Literal["pass", "fail", "open"]  # the style of a verdict on the page

_SHOWN: dict[State, Shown] = {"pass": "pass", "fail": "fail", "undecided": "open"}
_STEMS = {
    "stray": "stray light",
    "compare": "photograph",
    "compare_inner": "inner surface",
    "compare_outer": "outer surface",
}

_REMARKS = {
    "design": "There is no design.json, so the search is not documented; run lensforge design.",
    "evaluate": "There is no evaluate.json: the finished lens has not been simulated; run lensforge evaluate.",
    "export": "There is no export.json: no file for a shop has been written; run lensforge export.",
    "check": "There is no check.json: the lens has not been checked for manufacture; run lensforge check.",
    "verify": "There is no verify.json: the exported part has not been verified; run lensforge verify.",
}


@dataclass(frozen=True)
class CriterionRow:
    """One line of the table of criteria."""

    stage: str
    name: str
    value: str
    limit: str
    unit: str
    passed: bool
    remedy: str


@dataclass(frozen=True)
class VerdictBadge:
    """The verdict on light, on files or on cutting: its name, the word for its state, its style, and its reasons."""

    name: str
    word: str
    shown: Shown
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Headline:
    """The top of a page: the three verdicts, and a sentence on the criteria with its style."""

    parts: tuple[VerdictBadge, ...]
    shown: Shown
    sentence: str


def headline(results: Results) -> Headline:
    """The verdicts, and the state of the criteria: all met, some missed, or stages still to run."""
    verdict = results.verdict
    states: dict[str, State] = {"light": verdict.light, "files": verdict.files, "cutting": verdict.cutting}
    parts = tuple(
        VerdictBadge(name.capitalize(), state, _SHOWN[state], verdict.reasons_of(name))
        for name, state in states.items()
    )
    shown, sentence = _on_criteria(results)
    return Headline(parts, shown, sentence)


def task(spec: Spec) -> str:
    """Source, lens and target in one line."""
    lens = spec.lens
    body = f"double-freeform lens, {lens.material}, n = {lens.refractive_index:g}"
    return f"{spec.source.title} · {body} · {_target(spec)} at {spec.target.distance_mm:g} mm"


def _target(spec: Spec) -> str:
    target = spec.target
    if isinstance(target, FlatTopTarget):
        return f"square flat top, {2.0 * target.half_width_mm:g} mm wide"
    if isinstance(target, CrossTarget):
        return f"cross, {target.length_mm:g} mm long"
    if isinstance(target, TextTarget):
        return f"“{target.text}”, {target.width_mm:g} mm wide"
    if isinstance(target, ArrayTarget):
        return f"given pattern, {target.width_mm:g} mm wide"
    return f"{target.file.name}, {target.width_mm:g} mm wide"


def _on_criteria(results: Results) -> tuple[Shown, str]:
    criteria = [criterion for _, criterion in results.criteria()]
    failed = [criterion for criterion in criteria if not criterion.passed]
    waiting = _waiting(results)
    if failed:
        names = ", ".join(criterion.name.replace("_", " ") for criterion in failed)
        noun, verb = "criterion" if len(criteria) == 1 else "criteria", "is" if len(failed) == 1 else "are"
        return "fail", f"{len(failed)} of {len(criteria)} {noun} {verb} not met: {names}.{waiting}"
    if not criteria:
        return "open", f"No criterion has been evaluated.{waiting}"
    all_met = "The only criterion is met." if len(criteria) == 1 else f"All {len(criteria)} criteria are met."
    return "open" if results.missing else "pass", f"{all_met}{waiting}"


def _waiting(results: Results) -> str:
    """Stages of a whole run that have yet to run, or to run again, as a sentence."""
    never = [stage for stage in results.missing if stage not in results.outdated]
    again = [stage_name(stem) for stem in results.outdated]
    return "".join(
        f" {words}: {', '.join(names)}." for words, names in (("Not run yet", never), ("Out of date", again)) if names
    )


def outdated(results: Results) -> list[str]:
    """A sentence for each file that belongs to another lens, part or version: its name, and the reason."""
    return [
        f"{stem}.json does not count: {why.rpartition(f'{stem}.json: ')[2]}." for stem, why in results.outdated.items()
    ]


def missing(results: Results) -> dict[str, str]:
    """A sentence for each stage of a whole run that has not run, by its name."""
    never = (stage for stage in results.missing if stage not in results.outdated)
    return {stage: _REMARKS[stage] for stage in never}


def stage_name(stem: str) -> str:
    """Name on the page of the result in ``stem``.json."""
    return _STEMS.get(stem, stem)


def criterion_rows(results: Results) -> list[CriterionRow]:
    """A row for every criterion of every stage that has run."""
    return [_criterion_row(stage_name(stem), criterion) for stem, criterion in results.criteria()]


def _criterion_row(stage: str, criterion: Criterion) -> CriterionRow:
    sense = {"<=": "≤", ">=": "≥"}[criterion.sense]
    return CriterionRow(
        stage=stage,
        name=criterion.name.replace("_", " "),
        value=number(criterion.value, 4),
        limit=f"{sense} {number(criterion.limit, 4)}",
        unit=criterion.unit,
        passed=criterion.passed,
        remedy=criterion.remedy,
    )


def missed_rows(results: Results) -> list[CriterionRow]:
    """Rows of the missed criteria, for the top of the page."""
    return [row for row in criterion_rows(results) if not row.passed]


def criteria_state(criteria: Iterable[Criterion], *names: str) -> Literal["pass", "fail", ""]:
    """``pass`` if all of ``criteria`` called ``names`` are met, else ``fail``; ``""`` where there is none of them."""
    met = [criterion.passed for criterion in criteria if criterion.name in names]
    return ("pass" if all(met) else "fail") if met else ""
