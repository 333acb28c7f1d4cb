"""State of a search, all that decides its end: saved as a checkpoint, and restored to the same bits.

Adam (Kingma and Ba, ICLR 2015) has the bits of torch's, without what torch loads for it: torch's own optimisers load
the compiler of torch when the first one is made, over a second before a search begins.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.results.json_npz import Form, require_forms
from lensforge.search.checkpoint import ANEW, CheckpointError, CheckpointHead, load_checkpoint, save_checkpoint
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.design_result import Level
from lensforge.search.problem import Problems
from lensforge.search.schedule import NextStage, Outcome, Schedule, Stage
from lensforge.version import made_by


class Moments(NamedTuple):
    """Moments of Adam: running means of the gradient and of its square, by weights and by offsets."""

    weights: Float[Tensor, "m f"]
    weights_squared: Float[Tensor, "m f"]
    offsets: Float[Tensor, " f"]
    offsets_squared: Float[Tensor, " f"]


class Adam:
    """Steps along the gradients of ``weights`` and ``offsets``; a parameter without a gradient stays where it is.

    ``moments``: those after ``steps`` steps; by default none has been taken.
    """

    def __init__(
        self,
        weights: Tensor,
        offsets: Tensor,
        betas: tuple[float, float],
        least_gradient: float,
        steps: int = 0,
        moments: Moments | None = None,
    ) -> None:
        self.parameters = (weights, offsets)
        self.steps = steps
        self._betas = betas
        self._least_gradient = least_gradient
        fresh = (torch.zeros_like(parameter).detach() for parameter in (weights, weights, offsets, offsets))
        self._moments = Moments(*(fresh if moments is None else (moment.clone() for moment in moments)))

    @property
    def moments(self) -> Moments:
        """A copy of the moments."""
        return Moments(*(moment.clone() for moment in self._moments))

    def zero_grad(self) -> None:
        """Forget the gradients of the step before."""
        for parameter in self.parameters:
            parameter.grad = None

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """Take a step of the learning rate ``rate``; means, which begin at 0, are divided by the weights in them."""
        self.steps += 1
        first, second = self._betas
        length = rate / (1.0 - first**self.steps)
        spread = (1.0 - second**self.steps) ** 0.5
        pairs = self._moments[:2], self._moments[2:]
        for parameter, (mean, square) in zip(self.parameters, pairs, strict=True):
            if parameter.grad is None:
                continue
            mean.lerp_(parameter.grad, 1.0 - first)
            square.mul_(second).addcmul_(parameter.grad, parameter.grad, value=1.0 - second)
            parameter.addcdiv_(mean, (square.sqrt() / spread).add_(self._least_gradient), value=-length)


class Parameters(NamedTuple):
    """Relative weights and offsets of the faces, a column for each."""

    weights: Float[Tensor, "m f"]
    offsets: Float[Tensor, " f"]


Arrays = Mapping[str, np.ndarray]
FormsOf = Callable[[CheckpointHead, Arrays], Mapping[str, Form]]


@dataclass(frozen=True)
class SearchState:
    """Everything that a resumed run needs to end with the same bits; never changed in place.

    An interrupt may come between any two instructions: it finds either the old state or the new one. ``outcomes``: of
    the stages that have ended. ``moments``: None before the first step with them, ``steps_of_moments`` since then.
    ``best``, ``accepted``: parameters of the best lens of this level, and of the levels that were accepted.
    """

    weights: Float[Tensor, "m f"]
    offsets: Float[Tensor, " f"]
    multipliers: Float[Tensor, "c k"]
    outcomes: tuple[Outcome, ...] = ()
    step: int = 0
    moments: Moments | None = None
    steps_of_moments: int = 0
    best: Parameters | None = None
    accepted: Parameters | None = None
    history: tuple[Level, ...] = ()
    seconds: float = 0.0

    @property
    def steps_done(self) -> int:
        """Gradient steps of the whole search so far."""
        return sum(len(level.nmse) for level in self.history)

    def save(self, path: Path, key: str) -> None:
        """Write the checkpoint of the search with the fingerprint ``key``."""
        head = CheckpointHead(key=key, made_by=made_by(), **{name: getattr(self, name) for name in _IN_HEAD})
        arrays = {"weights": self.weights, "offsets": self.offsets, "multipliers": self.multipliers}
        for name in _KEPT:
            kept = getattr(self, name)
            arrays |= {} if kept is None else {f"{name}.{part}": value for part, value in kept._asdict().items()}
        save_checkpoint(path, head, {name: np.asarray(array) for name, array in arrays.items()})

    @staticmethod
    def load(path: Path, key: str, forms: FormsOf) -> "SearchState":
        """The state saved at ``path``, whose arrays must have the ``forms`` that follow from its head and their names.

        Raises :class:`CheckpointError` for none, a damaged one, another design's, and one that no search can have.
        """
        head, arrays = load_checkpoint(path, key)
        try:
            require_forms(arrays, forms(head, arrays))
            _require_moments(arrays)
        except ValueError as error:
            raise CheckpointError(f"{path}: no state of this search: {error}; {ANEW}") from None
        parts: dict[str, Any] = {name: torch.from_numpy(array) for name, array in arrays.items()}
        for name, kind in _KEPT.items():
            kept = [parts.pop(f"{name}.{part}", None) for part in kind._fields]
            parts[name] = None if kept[0] is None else kind(*kept)
        return SearchState(**parts, **{name: getattr(head, name) for name in _IN_HEAD})


_IN_HEAD = ("outcomes", "step", "steps_of_moments", "seconds", "history")
_KEPT: dict[str, Any] = {"moments": Moments, "best": Parameters, "accepted": Parameters}


def _require_moments(arrays: Arrays) -> None:
    """Raise :class:`ValueError` for means that no gradients with these means of their squares have.

    By Cauchy and Schwarz, 5.5 for the weights of Adam: what lies above would move a parameter by any length.
    """
    for name in ("weights", "offsets"):
        mean, square = (arrays.get(f"moments.{name}{end}", np.zeros(1)) for end in ("", "_squared"))
        if (mean**2 > 5.51 * square + np.finfo(float).tiny).any():
            raise ValueError(f"moments.{name}: larger than their squares allow")


def forms_of_search(schedule: Schedule, problems: Problems) -> FormsOf:
    """The arrays of a search for ``problems`` by ``schedule``, by the head of its checkpoint.

    They raise :class:`ValueError` for a head that no such search can have.
    """
    return lambda head, arrays: ResumePoint.of(head, schedule, problems).forms(head, arrays, problems)


_LARGEST = 1e6  # of parameters, which are relative to the start: in sound searches they are a few
_Steps = tuple[tuple[int, int, int], ...]  # of a history: level, its functions, and how many


@dataclass(frozen=True)
class ResumePoint:
    """Metadata of a checkpoint before the ``following`` stage, without its arrays.

    ``last``: the stage at hand, at the end the one before. ``steps``: by level, with the functions that began it.
    ``steps_of_moments``: without those of the stage at hand. ``best``, ``accepted``: True where they are kept.
    """

    following: NextStage
    last: Stage
    steps: _Steps
    steps_of_moments: int = 0
    best: bool = False
    accepted: bool = False

    @staticmethod
    def of(head: CheckpointHead, schedule: Schedule, problems: Problems) -> "ResumePoint":
        """The course of a search that has come as far as ``head``. Raises :class:`ValueError` where none has."""
        phases = schedule.phases()
        following = next(phases)
        wanted = {"light", "even"} if problems.spec.has_uniform_region else {"light"}
        assert following.stage is not None, "a spec has levels"
        course = ResumePoint(following, following.stage, ())
        for number, outcome in enumerate(head.outcomes):
            stage = course.following.stage
            if stage is None:
                raise ValueError(f"outcomes of {len(head.outcomes)} stages, the search has {number}")
            cut = outcome.seconds >= schedule.most_seconds(head.outcomes[:number])
            if not (outcome.steps == stage.steps or (cut and outcome.steps < stage.steps)):
                raise ValueError(f"outcomes.{number}.steps = {outcome.steps}, the stage has {stage.steps}")
            judged = {name for name in ("light", "even") if getattr(outcome, name) is not None}
            if judged != wanted:
                raise ValueError(f"outcomes.{number}: other judgements than those of the search")
            course = course._after(stage, outcome, phases.send(outcome))
        return course

    def _after(self, stage: Stage, outcome: Outcome, following: NextStage) -> "ResumePoint":
        coming = following.stage
        best = self.best or following.improved
        new = coming is not None and coming.levels != stage.levels
        moved = None if coming is None else (coming.functions, coming.uniform)
        goes_on = following.begin == "current" and moved == (stage.functions, stage.uniform)
        return ResumePoint(
            following,
            coming or stage,
            _with_steps(self.steps, stage, outcome.steps),
            self.steps_of_moments + outcome.steps if goes_on else 0,
            best or new or following.begin != "current",
            best if following.accepted else self.accepted,
        )

    def forms(self, head: CheckpointHead, arrays: Arrays, problems: Problems) -> dict[str, Form]:
        """The arrays that the search has. Raises :class:`ValueError` where ``head`` is not of this course."""
        problem = problems.of(self.last.levels)
        stage = self.following.stage
        parametrisation = problem.parametrisation
        constraints = problem.constraints
        self._require(head, constraints)
        (size, faces) = parametrisation.start()[0].shape
        sizes = tuple(accumulate(parametrisation.levels))
        rows = {"": size if stage is not None else _rows(arrays, "weights", sizes)}  # at the end without a last level
        rows |= {"moments.": self.last.functions} if head.steps_of_moments else {}
        rows |= {"best.": rows[""]} if self.best else {}
        rows |= {"accepted.": _rows(arrays, "accepted.weights", sizes)} if self.accepted else {}
        forms = {"multipliers": Form(tuple(constraints.multipliers.shape), least=0.0)}
        for begin, count in rows.items():
            for name in Moments._fields if begin == "moments." else Parameters._fields:
                axes = (count, faces) if name.startswith("weights") else (faces,)
                moments = Form(axes, least=0.0) if name.endswith("squared") else Form(axes)
                forms[begin + name] = moments if begin == "moments." else Form(axes, least=-_LARGEST, most=_LARGEST)
        return forms

    def _require(self, head: CheckpointHead, constraints: AugmentedLagrangian) -> None:
        """Raise :class:`ValueError` where steps and history of ``head`` are not those of this course."""
        most = 0 if self.following.stage is None else self.following.stage.steps
        if head.step > most:
            raise ValueError(f"step = {head.step}, the stage has {most}")
        steps = self.steps_of_moments + head.step
        if head.steps_of_moments != steps:
            raise ValueError(f"steps_of_moments = {head.steps_of_moments}, must be {steps}")
        stages = tuple((level.level, level.functions, len(level.loss)) for level in head.history)
        if stages != _with_steps(self.steps, self.last, head.step):
            raise ValueError("its history is not that of its stages")
        for level in head.history:
            counts = {len(series) for series in (level.loss, level.nmse, level.efficiency, *level.constraints.values())}
            if len(counts) != 1 or set(level.constraints) != set(constraints.keys):
                raise ValueError(f"the history of level {level.level} lacks values, or has other constraints")


def _with_steps(before: _Steps, stage: Stage, steps: int) -> _Steps:
    """Levels, functions and steps of a history after so many more ``steps`` of ``stage``."""
    if steps and before and before[-1][0] == stage.level:
        level, functions, count = before[-1]
        return (*before[:-1], (level, functions, count + steps))
    return (*before, (stage.level, stage.functions, steps)) if steps else before


def _rows(arrays: Arrays, name: str, sizes: Sequence[int]) -> int:
    """Rows of an array where they are one of ``sizes``; else the last of these."""
    rows = arrays[name].shape[:1] if name in arrays else ()
    return rows[0] if rows and rows[0] in sizes else sizes[-1]
