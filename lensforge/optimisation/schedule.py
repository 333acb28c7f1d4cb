"""Coarse to fine: which SRBF levels move, for how many steps and how far; and the fresh rays of every step."""

import math
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from lensforge.accuracy import Preset
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec

# Step sizes relative to the starting offset: large while the functions are few and broad, small at the end.
_FINEST_RATE_SHARE = 0.2
_FLOOR = 0.05


@dataclass(frozen=True)
class Stage:
    """Stage of one level: the first ``functions`` weights move for ``steps`` steps of ``rays`` rays."""

    level: int
    functions: int
    steps: int
    rays: int
    learning_rate: float
    uniformity_from: int  # the step from which the uniformity loss is added; ``steps`` for never

    def rate(self, step: int) -> float:
        """Learning rate at ``step``: cosine decay over the stage to a twentieth."""
        return self.learning_rate * (_FLOOR + (1.0 - _FLOOR) * 0.5 * (1.0 + math.cos(math.pi * step / self.steps)))


def plan(spec: Spec, preset: Preset) -> list[Stage]:
    """The stages for a spec; what the spec leaves open comes from the preset."""
    levels, settings = spec.lens.levels, spec.optimise
    last = len(levels) - 1
    steps = settings.steps_per_level or (preset.coarse_steps,) * last + (preset.fine_steps,)
    stages, functions = [], 0
    for level, count in enumerate(levels):
        functions += count
        share = _FINEST_RATE_SHARE ** (level / max(1, last))
        uniform = min(settings.uniformity_steps, steps[level]) if level == last else 0
        stages.append(
            Stage(
                level, functions, steps[level], settings.rays or preset.design_rays,
                settings.learning_rate * share, steps[level] - uniform,
            )
        )  # fmt: skip
    return stages


def rays_ahead(source: Source, count: int, seeds: Iterable[int]) -> Iterator[RayBundle]:
    """A sample of ``count`` rays for each of ``seeds``, in their order; the next is drawn while one is in use."""
    with ThreadPoolExecutor(1) as pool:
        following = None
        for seed in seeds:
            current, following = following, pool.submit(source.sample, count, seed)
            if current is not None:
                yield current.result()
        if following is not None:
            yield following.result()
