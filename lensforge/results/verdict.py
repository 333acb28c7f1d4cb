"""The one judgement of values by limits, and the verdict on a lens: its light, its files, and whether it can be made.

Stages give the reasons: a state and a sentence for each figure that does not pass.
"""

from collections.abc import Iterable, Mapping, Sequence

from lensforge.errors import CriterionMissed
from lensforge.public import public
from lensforge.results.record import Record, Sense, State, Text

TITLES = {"light": "Photometry", "files": "CAD files", "cutting": "Manufacture"}  # of the parts of a verdict
CERTAIN = 2.0  # standard errors; within them of a limit, nothing is decided

Reason = tuple[State, str]
_WORST_FIRST: tuple[State, ...] = ("fail", "undecided", "none", "pass")


def within(value: float | None, sense: Sense, limit: float | None, tolerance: float = 0.0) -> bool:
    """True if ``value`` (None, not measured: False) is ``sense`` ``limit`` (None: no limit).

    ``tolerance``: error of measurement, by which a value may lie beyond its limit.
    """
    if value is None:
        return False
    if limit is None:
        return True
    return value <= limit + tolerance if sense == "<=" else value >= limit - tolerance


def judge(
    value: float | None, sense: Sense, limit: float | None, error: float | None = 0.0, tolerance: float = 0.0
) -> State:
    """State of a ``value`` that must be ``sense`` ``limit``: the judgement behind every verdict.

    ``error``: standard error; 0 for an exact value, None if it is not known, and then nothing is decided. A value
    within two standard errors of its limit is undecided. ``tolerance``: as in :func:`within`.
    """
    if error is None or (error > 0.0 and None not in (value, limit) and abs(value - limit) <= CERTAIN * error):  # type: ignore[operator]
        return "undecided"
    return "pass" if within(value, sense, limit, tolerance) else "fail"


def state_label(state: State) -> str:
    """Display text of a state."""
    return "not judged" if state == "none" else state


def worst(states: Iterable[State]) -> State:
    """The joint state of several: a failure outweighs a doubt."""
    present = set(states)
    return next((state for state in _WORST_FIRST if state in present), "pass")


class Reasons(Record):
    """Reasons why light, files or cutting do not pass; empty if they do."""

    light: tuple[Text, ...]
    files: tuple[Text, ...]
    cutting: tuple[Text, ...]


@public
class Verdict(Record):
    """Verdict on a run: each "pass", "fail" or "undecided".

    ``light``: by the limits of the spec, else by NMSE and efficiency. ``files``: by constraints, export and
    verification. ``cutting``: by the manufacturing check; "none" of a study of light, of which nothing is made.
    ``reasons``: for each of the three.
    """

    light: State
    files: State
    cutting: State
    reasons: Reasons

    @staticmethod
    def of(light: Sequence[Reason], files: Sequence[Reason], cutting: Sequence[Reason]) -> "Verdict":
        """The verdict by the reasons against each of the three: the worst of their states."""
        reasons_by_name = {"light": light, "files": files, "cutting": cutting}
        states = {name: worst(state for state, _ in reasons) for name, reasons in reasons_by_name.items()}
        sentences = {name: tuple(sentence for _, sentence in reasons) for name, reasons in reasons_by_name.items()}
        return Verdict(**states, reasons=Reasons(**sentences))

    def with_parts(self, parts: "Mapping[str, Verdict]") -> "Verdict":
        """The verdict on several parts with one light: files and cutting are the worst of all, by part."""
        reasons = {
            name: [(state, sentence) for sentence in self.reasons_of(name)] for name, state in self.states.items()
        }
        for part, verdict in parts.items():
            for name in ("files", "cutting"):
                reasons[name] += [
                    (verdict.states[name], f"{part}: {sentence}") for sentence in verdict.reasons_of(name)
                ]
        return Verdict.of(**reasons)

    @property
    def states(self) -> dict[str, State]:
        """The three states by name."""
        return {"light": self.light, "files": self.files, "cutting": self.cutting}

    def reasons_of(self, name: str) -> tuple[str, ...]:
        """Reasons why ``name``, one of the three, does not pass."""
        return getattr(self.reasons, name)

    def require(self, *, cutting: bool, parts: Sequence[str] = ()) -> None:
        """Raise :class:`CriterionMissed` where light, files or a required ``cutting`` fails; ``parts``: only these."""
        counted = ["light", "files", *(["cutting"] if cutting else [])]
        failed = [name for name in counted if name in (parts or counted) and self.states[name] == "fail"]
        if failed:
            reasons = "; ".join(reason for name in failed for reason in self.reasons_of(name))
            raise CriterionMissed(f"{', '.join(TITLES[name] for name in failed)}: {reasons}")
