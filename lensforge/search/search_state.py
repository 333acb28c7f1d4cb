"""State of a search, all that decides its end: saved as a checkpoint, and restored only where it fits the scene.

Layout of a checkpoint's numbers: weights (m, 2), offsets (2), multipliers (c, k); where the optimiser has moments, the
first and second of its weights and of the offsets; the best and the accepted parameters, as far as there are any; then
a row for each quantity of the history, level by level.

Adam (Kingma and Ba, ICLR 2015) has the bits of torch's, without what torch loads for it: torch's own optimisers load
the compiler of torch when the first one is made, over a second before a search begins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import InputError
from lensforge.results.stage_result import validated
from lensforge.search.checkpoint import CheckpointHead, load_checkpoint, made_by, save_checkpoint
from lensforge.search.design_result import Level
from lensforge.search.merit import Problems
from lensforge.search.schedule import Outcome, Schedule, Stage


class Adam:
    """Steps along the gradients of ``parameters``; ``moments``: mean and mean square of the gradient of each.

    A parameter without a gradient stays where it is.
    """

    def __init__(self, parameters: Sequence[Tensor], betas: tuple[float, float], least_gradient: float) -> None:
        self.parameters, self.steps = tuple(parameters), 0
        self._betas, self._least_gradient = betas, least_gradient
        self.moments = [(torch.zeros_like(each).detach(), torch.zeros_like(each).detach()) for each in self.parameters]

    def resume(self, steps: int, moments: Sequence[tuple[Float[Tensor, "..."], Float[Tensor, "..."]]]) -> None:
        """Go on with the ``moments`` after that many ``steps``."""
        self.steps, self.moments = steps, [(mean.clone(), square.clone()) for mean, square in moments]

    def zero_grad(self) -> None:
        """Forget the gradients of the step before."""
        for each in self.parameters:
            each.grad = None

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """Take a step of the learning rate ``rate``; means, which begin at 0, are divided by the weights in them."""
        self.steps += 1
        first, second = self._betas
        length, spread = rate / (1.0 - first**self.steps), (1.0 - second**self.steps) ** 0.5
        for each, (mean, square) in zip(self.parameters, self.moments, strict=True):
            if each.grad is None:
                continue
            mean.lerp_(each.grad, 1.0 - first)
            square.mul_(second).addcmul_(each.grad, each.grad, value=1.0 - second)
            each.addcdiv_(mean, (square.sqrt() / spread).add_(self._least_gradient), value=-length)


_FITTING = ("loss", "nmse", "efficiency")  # in the history of every step, before its constraints
_ANEW = "delete it, or start anew without resume"
_ANOTHER = f"of another shape than this search's; {_ANEW}"
_MOST = 1e12  # no number of a search comes near it: weights are relative to the offset, offsets are about 1


class Moments(NamedTuple):
    """Moments of Adam: running means of the gradient and of its square, by weights and by offsets."""

    weights: Float[Tensor, "f 2"]
    weights_squared: Float[Tensor, "f 2"]
    offsets: Float[Tensor, "2"]
    offsets_squared: Float[Tensor, "2"]


class Parameters(NamedTuple):
    """Relative weights and offsets of both surfaces."""

    weights: Float[Tensor, "m 2"]
    offsets: Float[Tensor, "2"]


@dataclass(frozen=True)
class SearchState:
    """Everything that a resumed run needs to end with the same bits; never changed in place.

    An interrupt may come between any two instructions: it finds either the old state or the new one. ``outcomes``: of
    the stages that have ended. ``moments``: None before the first step with them, ``steps_of_moments`` since then.
    ``best``, ``accepted``: parameters of the best lens of this level, and of the levels that were accepted.
    ``history``: a table for each level, with a list for each quantity.
    """

    weights: Float[Tensor, "m 2"]
    offsets: Float[Tensor, "2"]
    multipliers: Float[Tensor, "c k"]
    outcomes: tuple[Outcome, ...] = ()
    step: int = 0
    moments: Moments | None = None
    steps_of_moments: int = 0
    best: Parameters | None = None
    accepted: Parameters | None = None
    history: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def steps_done(self) -> int:
        """Gradient steps of the whole search so far."""
        return sum(len(level["nmse"]) for level in self.history)

    def save(self, path: Path, key: str) -> None:
        """Write the checkpoint of the search with the fingerprint ``key``."""
        head = CheckpointHead(
            key=key,
            made_by=made_by(),
            outcomes=self.outcomes,
            step=self.step,
            steps_of_moments=self.steps_of_moments,
            seconds=self.seconds,
        )
        parts: list[Any] = [self.weights, self.offsets, self.multipliers, *(self.moments or ())]
        parts += [*(self.best or ()), *(self.accepted or ())]
        parts += [values for level in self.history for values in _quantities(level)]
        save_checkpoint(path, head, np.concatenate([np.asarray(part, dtype=np.float64).ravel() for part in parts]))


def moments_of(optimiser: Adam) -> Moments:
    """Copies of the moments of ``optimiser``, whose parameters are the weights and the offsets."""
    return Moments(*(moment.clone() for pair in optimiser.moments for moment in pair))


def resume_adam(optimiser: Adam, step: int, moments: Moments) -> None:
    """Put a new ``optimiser`` into the state that it had after ``step`` steps."""
    parts = (moments.weights, moments.weights_squared), (moments.offsets, moments.offsets_squared)
    optimiser.resume(step, parts)


def restored(path: Path, key: str, schedule: Schedule, problems: Problems) -> SearchState:
    """The state saved at ``path`` of a search with this ``schedule``.

    Raises :class:`InputError` for none, a damaged one, and one that does not fit: another design, or other stages.
    """
    head, numbers = load_checkpoint(path, key)
    past = _Past.of(schedule, head.outcomes, head.step, path)
    problem = problems.of(past.stage.levels)
    names = (*_FITTING, *problem.constraints.keys)
    shapes: list[tuple[int, ...]] = [(past.size, 2), (2,), tuple(problem.constraints.multipliers.shape)]
    moved = past.stage.functions
    shapes += [(moved, 2), (moved, 2), (2,), (2,)] if head.steps_of_moments else []
    shapes += [shape for count in (past.best, past.accepted) if count for shape in ((count, 2), (2,))]
    shapes += [(steps,) for _, _, steps in past.levels for _ in names]
    if sum(int(np.prod(shape)) for shape in shapes) != len(numbers):
        raise InputError(f"{path}: {len(numbers)} numbers, {_ANOTHER}")
    if not (np.abs(numbers) <= _MOST).all():  # nor is one that is no number
        raise InputError(f"{path}: a number beyond {_MOST:g}; {_ANEW}")
    parts = map(torch.from_numpy, _parts(numbers, shapes))
    weights, offsets, multipliers = (next(parts) for _ in range(3))
    moments = Moments(*(next(parts) for _ in range(4))) if head.steps_of_moments else None
    best, accepted = (Parameters(next(parts), next(parts)) if count else None for count in (past.best, past.accepted))
    history = [
        {"level": level, "functions": functions, **{name: next(parts).tolist() for name in names}}
        for level, functions, _ in past.levels
    ]
    for each in history:
        validated(Level, _fields(each), path, _ANEW)
    return SearchState(
        weights, offsets, multipliers, head.outcomes, head.step, moments, head.steps_of_moments, best, accepted,
        history, head.seconds,
    )  # fmt: skip


@dataclass(frozen=True)
class _Past:
    """Consequences of the outcomes of a search: the stage at hand, or the last one, and functions of what is kept.

    ``size``: of the present lens; ``levels``: level, functions and steps of each part of the history.
    """

    stage: Stage
    size: int
    best: int
    accepted: int
    levels: tuple[tuple[int, int, int], ...]

    @staticmethod
    def of(schedule: Schedule, outcomes: tuple[Outcome, ...], step: int, path: Path) -> "_Past":
        stage = schedule.next_stage(()).stage
        assert stage is not None, "a spec has levels"
        if not all(map(schedule.accepts, outcomes)):
            raise InputError(f"{path}: stages with judgements that are {_ANOTHER}")
        size, best, accepted, levels = sum(stage.levels), 0, 0, list[tuple[int, int, int]]()
        for count, following in enumerate(schedule.next_stages(outcomes)):
            best = size if following.improved else best
            accepted = best if following.accepted else accepted
            if following.begin != "current":
                size = best = best if following.begin == "best" else accepted
            if following.stage is not None and sum(following.stage.levels) != size:
                size = best = sum(following.stage.levels)
            stage = following.stage or stage
            at_hand, most = count == len(outcomes), 0 if following.stage is None else following.stage.steps
            steps = step if at_hand else outcomes[count].steps
            if steps > most or (following.stage is None and not at_hand):
                raise InputError(f"{path}: stage {len(outcomes)}, step {step}, {_ANOTHER}")
            if steps and levels and levels[-1][0] == stage.level:
                levels[-1] = (*levels[-1][:2], levels[-1][2] + steps)
            elif steps:
                levels.append((stage.level, stage.functions, steps))
        return _Past(stage, size, best, accepted, tuple(levels))


def level_of(history: dict[str, Any]) -> Level:
    """A level's table in a state's history as the record of a design."""
    return Level.model_validate(_fields(history))


def _fields(history: dict[str, Any]) -> dict[str, Any]:
    """Fields of a :class:`Level`: all names that are not its own are those of constraints."""
    own = ("level", "functions", *_FITTING)
    margins = {name: tuple(values) for name, values in history.items() if name not in own}
    return {name: history[name] for name in own} | {"constraints": margins}


def _parts(numbers: Float[np.ndarray, " n"], shapes: Sequence[tuple[int, ...]]) -> Iterator[np.ndarray]:
    """Copies of consecutive parts of ``numbers``, each of its shape."""
    start = 0
    for shape in shapes:
        size = int(np.prod(shape))
        yield numbers[start : start + size].reshape(shape).copy()
        start += size


def _quantities(level: dict[str, Any]) -> Iterator[list[float]]:
    yield from (values for name, values in level.items() if name not in ("level", "functions"))
