"""The problem that a stage of a search solves, its merit and constraints, and the rays that judge its lenses.

The rays are two samples, so that their noise does not count as error. No step sees them; those of a limited number are
the rays of the steps, turned anew. A lens that fits the noise of a file looks too good by them, but what a stage gains
is known, as it is not by the few rays that could be held apart: of 30,000 rays of led_rayfile a stage that lowers the
error by a third gained -8 to 31 +- 37 % by 6,000 of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge import seeds
from lensforge.kernels.bicubic import surface_bounds
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.drawn_profiles import DrawnParameters
from lensforge.search.kinds import KindsParameters, spec_of_each_kind
from lensforge.search.light_path import SearchParts
from lensforge.search.merit import Merit, MeritFunction, MeritParts
from lensforge.search.merit_of_sources import MeritOfSources
from lensforge.search.parameters import Parametrisation, SphereParameters
from lensforge.search.profiles import ProfileParameters
from lensforge.search.room_for_parts import require_feasible_tolerances
from lensforge.search.schedule import LEAST_IMAGE, SLICES, Judgement
from lensforge.sources.measured_rays import smoothed
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.sources.several_sources import SeveralSources
from lensforge.spec import Spec


@dataclass(frozen=True)
class Problem:
    """Merit function and constraints for the levels of ``spec``, numbers here; ``sparse``: the latter at few points.

    ``parts``: of a robust search.
    """

    spec: Spec
    merit: Merit[Any]
    constraints: AugmentedLagrangian
    sparse: bool = False
    parts: SearchParts | None = None

    @property
    def parametrisation(self) -> Parametrisation:
        """Parameters and tables of its lenses."""
        return self.merit.parametrisation

    def require_room_for_parts(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> None:
        """Raise :class:`InputError` for a tolerance that the lens from which a robust search begins cannot bear."""
        if self.parts is not None:
            lens = self.parametrisation.lens(weights, offsets, self.spec, 0, "draft")
            require_feasible_tolerances(lens, self.parts.factors)

    @torch.no_grad()
    def can_be_traced(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> bool:
        """True where every face stays away from the origin: what else is wrong with a lens, its constraints tell."""
        tables = self.parametrisation.tables(weights, offsets)
        grid = self.parametrisation.grid
        return all(surface_bounds(table.numpy(), grid.origin, grid.step).least > 0.0 for table in tables)

    def in_full(self) -> tuple[Parametrisation, AugmentedLagrangian]:
        """Parametrisation and constraints of the end of a search: where its steps look at few points, at many.

        Those between the nodes, too: there led_colours exceeds its radius by 9 um in a draft.
        """
        if not self.sparse:
            return self.parametrisation, self.constraints
        finer = self.parametrisation.refined()
        return finer, AugmentedLagrangian.of(self.spec, finer.grid)


PARAMETRISATIONS: dict[str, Callable[[Spec, float], Parametrisation]] = {
    "spheres": SphereParameters.of,
    "profiles": ProfileParameters.of,
    "drawn": DrawnParameters.of,
}


def parameters_of(spec: Spec, nodes_per_sigma: float) -> Parametrisation:
    """The parametrisation of the faces of ``spec``, as its lens names it; of lenses by place, of all of them."""
    if spec.all_lamps.kinds:
        specs = spec_of_each_kind(spec).items()
        return KindsParameters.of(
            {name: parameters_of(kind_spec.of_one_lamp, nodes_per_sigma) for name, kind_spec in specs}
        )
    return PARAMETRISATIONS[spec.lens.parametrisation](spec, nodes_per_sigma)


def merit_of(
    spec: Spec, source: Source, parametrisation: Parametrisation, device: torch.device | None, single: bool
) -> Merit[Any]:
    """The merit of lenses for ``source``, one LED or several."""
    if isinstance(source, SeveralSources):
        return MeritOfSources.of(spec, source, parametrisation, device, single)
    return MeritFunction.of(spec, source, parametrisation, device, single)


@dataclass
class Problems:
    """The problems of one search, of which the last is kept; constraints of automatic levels hold at fewer points.

    ``single``: rays are traced in single precision.
    """

    spec: Spec
    source: Source
    nodes_per_sigma: float
    device: torch.device | None
    single: bool = False
    _last: Problem | None = None

    def of(self, levels: tuple[int, ...]) -> Problem:
        """The problem of lenses with ``levels``."""
        if self._last is None or self._last.spec.lens.levels != levels:
            spec = self.spec.with_levels(levels)
            automatic = self.spec.lens.levels == "auto"
            parametrisation = parameters_of(spec, self.nodes_per_sigma)
            merit = merit_of(spec, self.source, parametrisation, self.device, self.single)
            constraints = AugmentedLagrangian.of(spec, parametrisation.grid, sparse=automatic)
            parts = SearchParts.of(spec, parametrisation) if spec.optimise.robust else None
            self._last = Problem(spec, merit, constraints, automatic, parts)
        return self._last


@dataclass(frozen=True)
class ValidationRays:
    """Two independent samples, the same for every judgement: a gain has less noise than an error.

    ``seed``: of the search, whose parts judge a robust one, two for each slice of the rays.
    """

    samples: tuple[RayBundle, RayBundle]
    seed: int = 0

    @staticmethod
    def of(source: Source, rays: int, seed: int) -> tuple["ValidationRays", Source]:
        """Two samples of ``rays`` rays, from seeds that no step has, and the source of the steps."""
        steps = smoothed(source)
        numbers = (seeds.of_validation(seed, number) for number in (0, 1))
        first, second = (steps.sample(rays, number) for number in numbers)
        if source.ray_count is not None:  # a file may be sorted, the slices of its rays must not be
            order = np.random.default_rng(seeds.of_validation(seed, 0)).permutation(rays)
            first = first.take(order)
            second = second.take(order)
        return ValidationRays((first, second), seed), steps

    def judge(
        self, problem: Problem, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"], even: bool
    ) -> tuple[Judgement, Judgement | None]:
        """Judge a lens by its light, constraints included; and with the uniformity first, if ``even``."""
        merit = problem.merit
        constraints = problem.constraints
        with torch.no_grad():
            tables = merit.parametrisation.tables(weights, offsets)
            missing = float(constraints.penalty_alone(constraints.fields(tables)))
            parts = problem.parts  # of a robust search; the same for both samples
            pairs = [()] * SLICES if parts is None else [(pair,) for pair in parts.of_validation(self.seed, SLICES)]
            lights = [
                [merit.light_of(tables, part, pair) for part, pair in zip(sample.divided(SLICES), pairs, strict=True)]
                for sample in self.samples
            ]
            judged = [_judgement(merit, lights, missing, uniform) for uniform in ([False, True] if even else [False])]
        return judged[0], judged[1] if even else None


def _judgement(merit: Merit[Any], lights: list[list[Any]], missing: float, uniform: bool) -> Judgement:
    flux_w = [sum(part.emitted_w for part in parts) for parts in lights]

    def judged(left_out: int | None) -> MeritParts:
        kept = ([part for k, part in enumerate(parts) if k != left_out] for parts in lights)
        first, second = (merit.joined(parts, emitted_w) for parts, emitted_w in zip(kept, flux_w, strict=True))
        return merit.unbiased_merit(first, second, uniform)

    whole = judged(None)
    without = [judged(k) for k in range(SLICES)]
    samples = [merit.joined([part], flux) for parts, flux in zip(lights, flux_w, strict=True) for part in parts]
    return Judgement(
        merit=missing + whole.all,
        image=max(whole.image, LEAST_IMAGE),
        without=tuple(missing + parts.all for parts in without),
        limits=whole.limits,
        limits_without=tuple(parts.limits for parts in without),
        limits_missed=merit.limits_missed(samples),
    )
