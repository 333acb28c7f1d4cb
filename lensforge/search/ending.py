"""The end of a search: its lens, or the start where that is the better one, judged alike.

Both are feasible, and judged by the same rays and the merit of the search. A stage that loses is taken back by its
schedule; what is left here is the projection to the feasible set, which may cost more than the search has gained.
"""

from dataclasses import dataclass, replace

import torch

from lensforge.scene.lens import Lens
from lensforge.search.design_result import Margins
from lensforge.search.feasibility import feasible_lens
from lensforge.search.problem import Problem, ValidationRays
from lensforge.search.schedule import Judgement, Outcome
from lensforge.search.search_state import Parameters
from lensforge.spec import AnyAccuracy

_NOT_BETTER = "the search did not improve on its start, which is kept"
_TRY = "try more steps or rays (optimise.steps_per_level, optimise.rays), other lens.*.offset_mm, or lens.start"


@dataclass(frozen=True)
class SearchEnd:
    """A feasible ``lens`` with its ``margins`` and ``merits``; ``why``: words on it, where it is the start.

    ``merits``: by the light, and with the uniformity first where the search has sought that.
    """

    lens: Lens
    margins: Margins
    merits: tuple[float, ...]
    why: str = ""

    def is_no_worse(self, merits: tuple[float, ...]) -> bool:
        """True where any of its merits is as low: what is traded for evenness is no loss."""
        return any(merit <= bound for merit, bound in zip(self.merits, merits, strict=True))


@dataclass(frozen=True)
class Candidates:
    """Judge of lenses by ``validation`` rays; ``even``: the search has sought even light. Lenses have ``seed``."""

    validation: ValidationRays
    even: bool
    seed: int
    accuracy: AnyAccuracy

    def better(self, begun: Outcome, start: tuple[Problem, Parameters], end: tuple[Problem, Parameters]) -> SearchEnd:
        """The feasible lens of ``end``, or of the ``start``, judged in ``begun``, where that one is the better."""
        feasible = self._feasible(*end)
        if _same(start[1], end[1]):
            return replace(feasible, why=f"{_NOT_BETTER}, of merit {feasible.merits[-1]:.4g}; {_TRY}")
        if feasible.is_no_worse(self._merits(begun.light, begun.even)):
            return feasible
        kept = self._feasible(*start)
        reason = f"{_NOT_BETTER}, of merit {kept.merits[-1]:.4g}: the end has {feasible.merits[-1]:.4g}; {_TRY}"
        return feasible if feasible.is_no_worse(kept.merits) else replace(kept, why=reason)

    def _feasible(self, problem: Problem, parameters: Parameters) -> SearchEnd:
        lens, margins, moved = feasible_lens(problem, parameters, self.seed, self.accuracy)
        light, even = self.validation.judge(problem, *moved, self.even)
        return SearchEnd(lens, margins, self._merits(light, even))

    def _merits(self, light: Judgement, even: Judgement | None) -> tuple[float, ...]:
        return (light.merit,) if even is None or not self.even else (light.merit, even.merit)


def _same(first: Parameters, second: Parameters) -> bool:
    return len(first.weights) == len(second.weights) and all(map(torch.equal, first, second))
