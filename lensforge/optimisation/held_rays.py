"""Held rays judge a search that never sees them: two samples, so that their noise does not count as error.

Of a source with a limited number of rays a fifth is kept from the search: a lens that fits the noise of the others
shows it there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.optimisation.judgement import SLICES, Judgement
from lensforge.optimisation.merit import MeritFunction, SampledLight
from lensforge.optimisation.problem import Problem
from lensforge.optimisation.search_parts import Pair
from lensforge.sources.bundle import RayBundle, Source
from lensforge.sources.measured_rays import divided, smoothed

_LEAST_IMAGE = 1e-4  # NMSE below which nothing is left to gain: an evaluation is no more certain than a fifth of that
_OF_FILE = 0.2  # of measured rays: with as many, two halves of 10,000 judge a file of 100,000


@dataclass(frozen=True)
class HeldRays:
    """Two independent samples, the same for every judgement: a gain has less noise than an error.

    ``seed``: of the search, whose parts judge a robust one, two for each slice of the rays.
    """

    samples: tuple[RayBundle, RayBundle]
    seed: int = 0

    @staticmethod
    def of(source: Source, rays: int, seed: int) -> tuple["HeldRays", Source]:
        """Two samples of ``rays`` rays at most, and the source of the steps, which has none of them.

        They come from seeds that no step has; those of measured rays are a part of the file that no step has. Raises
        :class:`InputError` for a file of so few rays that none would be left for a part.
        """
        steps, held = divided(source, 1.0 - _OF_FILE, seeds.of_held(seed, 0))
        if held.ray_count is None:
            samples = held.sample(rays, seeds.of_held(seed, 0)), held.sample(rays, seeds.of_held(seed, 1))
            return HeldRays(samples, seed), steps
        if held.ray_count < 2 * SLICES:
            raise InputError(
                f"{source.ray_count} rays: too few to judge a search by a fifth of them, at least "
                f"{round(2 * SLICES / _OF_FILE)}; give lens.levels as numbers, or take a larger file"
            )
        halves = divided(held, 0.5, seeds.of_held(seed, 1))
        first, second = (half.sample(min(rays, half.ray_count or rays), seeds.of_held(seed, 0)) for half in halves)
        order = np.random.default_rng(seeds.of_held(seed, 1))  # a file may be sorted, its slices must not be
        shuffled = first.take(order.permutation(len(first))), second.take(order.permutation(len(second)))
        return HeldRays(shuffled, seed), smoothed(steps)

    def judge(
        self, problem: Problem, weights: Float[Tensor, "k 2"], offsets: Float[Tensor, "2"], even: bool
    ) -> tuple[Judgement, Judgement | None]:
        """Judge a lens by its light, constraints included; and with the uniformity first, if ``even``."""
        merit, constraints = problem.merit, problem.constraints
        with torch.no_grad():
            tables = merit.parametrisation.tables(weights, offsets)
            missing = float(constraints.penalty_alone(constraints.fields(*tables)))
            pairs = _pairs(problem, self.seed)
            lights = [
                [merit.light_of(*tables, part, pair) for part, pair in zip(sample.divided(SLICES), pairs, strict=True)]
                for sample in self.samples
            ]
            judged = [_judgement(merit, lights, missing, uniform) for uniform in ([False, True] if even else [False])]
        return judged[0], judged[1] if even else None


def _pairs(problem: Problem, seed: int) -> Sequence[Pair | None]:
    """The pair of parts for each slice in a robust search, the same for both samples."""
    if problem.parts is None:
        return [None] * SLICES
    return problem.parts.held(seed, SLICES)


def _judgement(merit: MeritFunction, lights: list[list[SampledLight]], missing: float, uniform: bool) -> Judgement:
    """The judgement of the light of both samples' slices, and of what is missing of the constraints' margins."""
    flux_w = [sum(part.emitted_w for part in parts) for parts in lights]

    def judged(left_out: int | None) -> tuple[float, float]:
        kept = ([part for k, part in enumerate(parts) if k != left_out] for parts in lights)
        first, second = (SampledLight.joined(parts, emitted_w) for parts, emitted_w in zip(kept, flux_w, strict=True))
        return merit.judge(first, second, uniform)

    value, image = judged(None)
    without = tuple(missing + judged(k)[0] for k in range(SLICES))
    return Judgement(merit=missing + value, image=max(image, _LEAST_IMAGE), without=without)
