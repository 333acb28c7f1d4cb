"""State of a search, all that decides its end: saved as a checkpoint, and restored to the same bits.

Adam (Kingma and Ba, ICLR 2015) has the bits of torch's, without what torch loads for it: torch's own optimisers load
the compiler of torch when the first one is made, over a second before a search begins.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.search.checkpoint import CheckpointHead, load_checkpoint, save_checkpoint
from lensforge.search.design_result import Level
from lensforge.search.schedule import Outcome
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
        self.parameters, self.steps = (weights, offsets), steps
        self._betas, self._least_gradient = betas, least_gradient
        fresh = (torch.zeros_like(each).detach() for each in (weights, weights, offsets, offsets))
        self._moments = Moments(*(fresh if moments is None else (each.clone() for each in moments)))

    @property
    def moments(self) -> Moments:
        """A copy of the moments."""
        return Moments(*(moment.clone() for moment in self._moments))

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
        pairs = self._moments[:2], self._moments[2:]
        for each, (mean, square) in zip(self.parameters, pairs, strict=True):
            if each.grad is None:
                continue
            mean.lerp_(each.grad, 1.0 - first)
            square.mul_(second).addcmul_(each.grad, each.grad, value=1.0 - second)
            each.addcdiv_(mean, (square.sqrt() / spread).add_(self._least_gradient), value=-length)


class Parameters(NamedTuple):
    """Relative weights and offsets of the faces, a column for each."""

    weights: Float[Tensor, "m f"]
    offsets: Float[Tensor, " f"]


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
    def load(path: Path, key: str) -> "SearchState":
        """The state saved at ``path``. Raises :class:`InputError` for none, a damaged one, and another design's."""
        head, arrays = load_checkpoint(path, key)
        parts: dict[str, Any] = {name: torch.from_numpy(array) for name, array in arrays.items()}
        for name, kind in _KEPT.items():
            kept = [parts.pop(f"{name}.{part}", None) for part in kind._fields]
            parts[name] = None if kept[0] is None else kind(*kept)
        return SearchState(**parts, **{name: getattr(head, name) for name in _IN_HEAD})


_IN_HEAD = ("outcomes", "step", "steps_of_moments", "seconds", "history")
_KEPT: dict[str, Any] = {"moments": Moments, "best": Parameters, "accepted": Parameters}
