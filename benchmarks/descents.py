"""Ways to descend a merit function, each from the same start, for as many seconds as it is given."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import torch

from lensforge.errors import InputError
from lensforge.search.merit import Evaluated
from lensforge.search.parameters import settled_symmetry
from lensforge.search.problem import Problem, Problems
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS

UNSEEN_RAYS, UNSEEN_SEED, ROUND = 2**20, 2**41, 10
RAYS = 2**16  # of a step
FALL = 0.65  # of the rate from a level to the next
sgd = torch.optim.SGD


@dataclass
class SearchInProgress:
    """A search in progress: parameters, the damping of Gauss-Newton, and a clock that is stopped during judgements."""

    problems: Problems
    source: Source
    unseen: RayBundle
    parameters: list[torch.Tensor] = field(default_factory=list)
    levels: tuple[int, ...] = ()
    draws: int = 0
    spent: float = 0.0
    damping: float = 1e-2
    undone_steps: int = 0

    @staticmethod
    def of(spec: Spec, levels: tuple[int, ...]) -> "SearchInProgress":
        source = build_source(spec.source, spec.lens.dispersion)
        problems = Problems(settled_symmetry(spec, source), source, PRESETS["standard"].nodes_per_sigma, None)
        run = SearchInProgress(problems, source, source.sample(UNSEEN_RAYS, UNSEEN_SEED))
        run.parameters = [torch.zeros(0, 2, dtype=torch.float64), torch.ones(2, dtype=torch.float64)]
        run.begin(levels[:1])
        return run

    @property
    def problem(self) -> Problem:
        return self.problems.of(self.levels)

    def begin(self, levels: tuple[int, ...]) -> None:
        """Add weights of 0 for the functions of one level more."""
        if levels != self.levels:
            before = self.problem if self.levels else None
            self.levels = levels
            more = torch.zeros(sum(levels) - len(self.parameters[0]), 2, dtype=torch.float64)
            self.parameters[0] = torch.cat([self.parameters[0], more])
            if before is not None:
                multipliers = self.problem.constraints.at_nearest(before.constraints, before.constraints.multipliers)
                self.problem.constraints.multipliers = multipliers

    def fresh_rays(self, count: int) -> RayBundle:
        self.draws += 1
        return self.source.sample(count, self.draws)

    def loss(self, parameters: list[torch.Tensor], rays: RayBundle) -> Evaluated:
        return self.problem.merit.evaluate(*parameters, rays, self.problem.constraints, False)

    def unseen_nmse(self) -> float:
        with torch.no_grad():
            return self.loss(self.parameters, self.unseen).nmse

    def undone(self, error: InputError, before: list[torch.Tensor]) -> None:
        """Go back from parameters that are no lens."""
        if not self.undone_steps:
            print(f"   undone: {error}"[:110])
        self.undone_steps += 1
        self.parameters = before


Method = Callable[[SearchInProgress, float, int], Iterator[None]]


def first_order(
    make: Callable[..., torch.optim.Optimizer], rate: float, *, by_level: float | None = None, rays: int = RAYS
) -> Method:
    """A method of gradients; ``by_level``: within a step, the rate of each level relative to that of the one before."""

    def level(run: SearchInProgress, seconds: float, number: int) -> Iterator[None]:
        scales = [1.0 if by_level is None else by_level ** (k - number) for k in range(number + 1)]
        begun, top = run.spent, rate * FALL**number
        stepper = _Stepper(run, make, scales, top)
        while run.spent < begun + seconds:
            start, progress = time.perf_counter(), (run.spent - begun) / seconds
            try:
                stepper.step(top * (0.05 + 0.95 * 0.5 * (1.0 + np.cos(np.pi * progress))), rays)
            except InputError as error:
                top *= 0.5
                run.undone(error, run.parameters)
                stepper = _Stepper(run, make, scales, top)
            run.spent += time.perf_counter() - start
            yield

    return level


class _Stepper:
    """An optimiser that has just begun at the present parameters; the run has those before its last step: a lens."""

    def __init__(
        self, run: SearchInProgress, make: Callable[..., torch.optim.Optimizer], scales: list[float], rate: float
    ) -> None:
        self.run, self.steps = run, 0
        self.parts = [part.clone().requires_grad_() for part in run.parameters[0].split(list(run.levels))]
        self.offsets = run.parameters[1].clone().requires_grad_()
        groups: list[dict[str, Any]] = [
            {"params": [part], "scale": scale} for part, scale in zip(self.parts, scales, strict=True)
        ]
        self.optimiser = make([*groups, {"params": [self.offsets], "scale": 1.0}], lr=rate)

    def step(self, rate: float, rays: int) -> None:
        run = self.run
        for group in self.optimiser.param_groups:
            group["lr"] = group["scale"] * rate
        result = run.loss([torch.cat(self.parts), self.offsets], run.fresh_rays(rays))
        run.parameters = [torch.cat(self.parts).detach(), self.offsets.detach().clone()]
        self.optimiser.zero_grad()
        result.loss.backward()
        self.optimiser.step()
        self.steps += 1
        if self.steps % ROUND == 0:
            run.problem.constraints.update(result.fields)


class adabelief(torch.optim.Optimizer):  # noqa: N801  # called as a function is
    """AdaBelief (Zhuang et al. 2020): each step relative to the noise of its gradient, not to its size."""

    def __init__(self, params: Any, lr: float) -> None:
        super().__init__(params, {"lr": lr})

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:
        for group in self.param_groups:
            for each in group["params"]:
                state = self.state[each]
                if not state:
                    state.update(count=0, mean=torch.zeros_like(each), variance=torch.zeros_like(each))
                state["count"] += 1
                state["mean"] += 0.1 * (each.grad - state["mean"])
                state["variance"] += 0.01 * ((each.grad - state["mean"]) ** 2 - state["variance"])
                mean = state["mean"] / (1.0 - 0.9 ** state["count"])
                variance = state["variance"] / (1.0 - 0.99 ** state["count"])
                each -= group["lr"] * mean / (variance.sqrt() + 1e-8)


def _restarts(once: Callable[[SearchInProgress, RayBundle], None], rays: int) -> Method:
    """A method that runs ``once`` on a new sample again and again; what leaves the domain of lenses is undone."""

    def level(run: SearchInProgress, seconds: float, number: int) -> Iterator[None]:
        begun = run.spent
        while run.spent < begun + seconds:
            start, before = time.perf_counter(), [part.clone() for part in run.parameters]
            try:
                once(run, run.fresh_rays(rays))
            except InputError as error:
                run.undone(error, before)
            run.spent += time.perf_counter() - start
            yield

    return level


def quasi_newton(iterations: int) -> Method:
    """L-BFGS of so many iterations for each sample."""

    def once(run: SearchInProgress, rays: RayBundle) -> None:
        parameters = [part.clone().requires_grad_() for part in run.parameters]
        optimiser = torch.optim.LBFGS(parameters, max_iter=iterations, history_size=20, line_search_fn="strong_wolfe")

        def closure() -> torch.Tensor:
            optimiser.zero_grad()
            loss = run.loss(parameters, rays).loss
            loss.backward()
            return loss

        optimiser.step(closure)
        run.parameters = [part.detach() for part in parameters]
        with torch.no_grad():
            run.problem.constraints.update(run.loss(run.parameters, rays).fields)

    return _restarts(once, RAYS)


def gauss_newton(iterations: int) -> Method:
    """Levenberg-Marquardt on the pixels and the sampled constraints of a frozen sample, solved by conjugate gradients.

    For scenes of one receiver. The image's derivative along a step is a central difference, its adjoint the gradient.
    """

    def once(run: SearchInProgress, rays: RayBundle) -> None:
        normal = _Normal(run, rays)
        before = normal.loss(run.parameters)
        for _ in range(4):
            step = _conjugate_gradients(partial(normal.times, run.damping), -normal.gradient, iterations)
            following = normal.moved(step)
            after = np.inf
            with suppress(InputError):
                after = normal.loss(following)
            if after < before:
                run.parameters, run.damping = following, max(run.damping / 3.0, 1e-6)
                with torch.no_grad():
                    run.problem.constraints.update(run.loss(following, rays).fields)
                return
            run.damping = min(4.0 * run.damping, 1e3)

    return _restarts(once, 2 * RAYS)


class _Normal:
    """Gauss-Newton matrix of the loss at the present parameters, as a product with a vector."""

    def __init__(self, run: SearchInProgress, rays: RayBundle) -> None:
        self.run, self.rays, self.at = run, rays, run.parameters
        self.varied = [part.clone().requires_grad_() for part in self.at]
        result = run.loss(self.varied, rays)
        self.gradient = _flat(torch.autograd.grad(result.loss, self.varied))
        self.residuals = self._residuals(self.varied)
        (terms,), constraints = run.problem.merit.terms, run.problem.constraints
        self.of_image = 2.0 / torch.sum(terms.wanted**2)
        active = constraints.multipliers - constraints.penalty * (result.fields.detach() - constraints._margin) > 0.0
        self.of_fields = constraints.penalty * constraints._area * active

    def loss(self, parameters: list[torch.Tensor]) -> float:
        with torch.no_grad():
            return float(self.run.loss(parameters, self.rays).loss)

    def moved(self, step: torch.Tensor) -> list[torch.Tensor]:
        count = self.at[0].numel()
        return [self.at[0] + step[:count].reshape(-1, 2), self.at[1] + step[count:]]

    def _residuals(self, parameters: list[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        problem = self.run.problem
        tables = problem.parametrisation.tables(*parameters)
        (terms,), (light,) = problem.merit.terms, problem.merit.light.collect(*tables, self.rays)
        return terms.image(light), problem.constraints.fields(*tables)

    def times(self, damping: float, vector: torch.Tensor) -> torch.Tensor:
        size = 1e-5 / max(float(vector.abs().max()), 1e-30)
        with torch.no_grad():
            ahead, behind = (self._residuals(self.moved(sign * size * vector)) for sign in (1.0, -1.0))
        along = [(a - b) / (2.0 * size) for a, b in zip(ahead, behind, strict=True)]
        factors = self.of_image, self.of_fields
        terms = [torch.sum(f * a * r) for f, a, r in zip(factors, along, self.residuals, strict=True)]
        return _flat(torch.autograd.grad(terms[0] + terms[1], self.varied, retain_graph=True)) + damping * vector


def _flat(parts: tuple[torch.Tensor, ...]) -> torch.Tensor:
    return torch.cat([part.reshape(-1) for part in parts])


def _conjugate_gradients(
    times: Callable[[torch.Tensor], torch.Tensor], right: torch.Tensor, iterations: int
) -> torch.Tensor:
    found, rest = torch.zeros_like(right), right.clone()
    direction, square = rest.clone(), float(rest @ rest)
    for _ in range(iterations):
        product = times(direction)
        share = square / float(direction @ product)
        found, rest = found + share * direction, rest - share * product
        square, before = float(rest @ rest), square
        if square < 1e-6 * float(right @ right):
            break
        direction = rest + square / before * direction
    return found
