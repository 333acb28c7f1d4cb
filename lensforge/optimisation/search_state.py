"""State of a search, all of it that decides its end: saved as a checkpoint, and restored only where it fits the scene.

Layout of a checkpoint's numbers: weights (m, 2), offsets (2), multipliers (c, k); within a stage the first and second
moments of Adam of its weights and of the offsets; then a row for each quantity of the history, stage by stage.
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
from lensforge.optimisation.checkpoint import CheckpointHead, load_checkpoint, made_by, save_checkpoint
from lensforge.optimisation.design import Level
from lensforge.optimisation.schedule import Stage
from lensforge.records.stored import validated

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


@dataclass(frozen=True)
class SearchState:
    """Everything that a resumed run needs to end with the same bits; never changed in place.

    An interrupt may come between any two instructions: it finds either the old state or the new one. ``moments``: None
    before the first step of a stage. ``history``: a table for each level, with a list for each quantity.
    """

    weights: Float[Tensor, "m 2"]
    offsets: Float[Tensor, "2"]
    multipliers: Float[Tensor, "c k"]
    stage: int = 0
    step: int = 0
    moments: Moments | None = None
    history: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0

    def save(self, path: Path, key: str) -> None:
        """Write the checkpoint of the search with the fingerprint ``key``."""
        head = CheckpointHead(key=key, made_by=made_by(), stage=self.stage, step=self.step, seconds=self.seconds)
        parts = [part.detach().cpu().numpy() for part in (self.weights, self.offsets, self.multipliers)]
        parts += [part.numpy() for part in self.moments or ()]
        parts += [np.array(values) for level in self.history for values in _quantities(level)]
        save_checkpoint(path, head, np.concatenate([part.ravel() for part in parts]))


def moments_of(optimiser: torch.optim.Adam) -> Moments:
    """Copies of the moments of ``optimiser``, whose parameters are the weights and the offsets."""
    parameters = optimiser.param_groups[0]["params"]
    states = ((each, optimiser.state.get(each, {})) for each in parameters)  # none where nothing depends on it
    return Moments(
        *(
            state[name].clone() if name in state else torch.zeros_like(each, requires_grad=False)
            for each, state in states
            for name in ("exp_avg", "exp_avg_sq")
        )
    )


def resume_adam(optimiser: torch.optim.Adam, step: int, moments: Moments) -> None:
    """Put a new ``optimiser`` into the state that it had after ``step`` steps."""
    parts = (moments.weights, moments.weights_squared), (moments.offsets, moments.offsets_squared)
    state = {
        index: {"step": torch.tensor(float(step)), "exp_avg": mean.clone(), "exp_avg_sq": square.clone()}
        for index, (mean, square) in enumerate(parts)
    }
    optimiser.load_state_dict({**optimiser.state_dict(), "state": state})


def restored(
    path: Path, key: str, fresh: SearchState, stages: Sequence[Stage], constraints: Sequence[str]
) -> SearchState:
    """The state saved at ``path`` of the search that begins with ``fresh``; ``constraints``: names in its history.

    Raises :class:`InputError` for none, a damaged one, and one that does not fit: another design or other ``stages``.
    """
    head, numbers = load_checkpoint(path, key)
    stage, step = head.stage, head.step
    if stage > len(stages) or step > (stages[stage].steps if stage < len(stages) else 0):
        raise InputError(f"{path}: stage {stage}, step {step}, {_ANOTHER}")
    done = [(each, each.steps) for each in stages[:stage]] + [(each, step) for each in stages[stage : stage + 1]]
    moved = stages[stage].functions if step else 0
    shapes = [tuple(part.shape) for part in (fresh.weights, fresh.offsets, fresh.multipliers)]
    shapes += [(moved, 2), (moved, 2), (2,), (2,)] if step else []
    shapes += [(count,) for _, count in done if count for _ in (*_FITTING, *constraints)]
    if sum(int(np.prod(shape)) for shape in shapes) != len(numbers):
        raise InputError(f"{path}: {len(numbers)} numbers, {_ANOTHER}")
    if not (np.abs(numbers) <= _MOST).all():  # nor is one that is no number
        raise InputError(f"{path}: a number beyond {_MOST:g}; {_ANEW}")
    parts = _parts(numbers, shapes)
    weights, offsets, multipliers = (torch.from_numpy(next(parts)) for _ in range(3))
    moments = Moments(*(torch.from_numpy(next(parts)) for _ in range(4))) if step else None
    history = [
        {"level": each.level, "functions": each.functions, **{name: next(parts).tolist() for name in names}}
        for each, count in done
        if count
        for names in [(*_FITTING, *constraints)]
    ]
    for each in history:
        validated(Level, _fields(each), path, _ANEW)
    return SearchState(weights, offsets, multipliers, stage, step, moments, history, head.seconds)


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
