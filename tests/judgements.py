"""Judgements of lenses by hand, for searches whose decisions a test wants to know beforehand."""

from typing import Any

import numpy as np
import pytest

from lensforge.search.problem import ValidationRays
from lensforge.search.schedule import SLICES, Judgement


def judged(merit: float, noise: float = 0.0, seed: int = 0) -> Judgement:
    """A judgement whose merit has the standard error ``noise``, to some 30 %."""
    without = merit + noise / np.sqrt(SLICES - 1) * np.random.default_rng(seed).normal(size=SLICES)
    return Judgement(merit=merit, image=merit, without=tuple(without.tolist()))


def judge_as(monkeypatch: pytest.MonkeyPatch, *merits: float) -> None:
    """Let the lenses of all searches from here on have ``merits``, one after another; the last of them for all more."""
    coming = iter(merits)

    def judge(self: ValidationRays, *given: Any) -> tuple[Judgement, Judgement | None]:
        judgement = judged(next(coming, merits[-1]))
        return judgement, judgement if given[-1] else None

    monkeypatch.setattr(ValidationRays, "judge", judge)
