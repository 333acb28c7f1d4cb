"""The search: Adam, coarse to fine, with multiplier updates between rounds; resumable at any step."""

import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.accuracy import PRESETS
from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.checkpoint import fingerprint, load_checkpoint, save_checkpoint
from lensforge.optimisation.feasibility import constraint_gates, measure_constraints
from lensforge.optimisation.objective import Evaluated, Objective
from lensforge.optimisation.parameters import Parametrisation
from lensforge.optimisation.polish import nearest_feasible
from lensforge.optimisation.rays_ahead import rays_ahead
from lensforge.optimisation.schedule import Stage, plan
from lensforge.optimisation.symmetry import settled_symmetry
from lensforge.gates import Gate
from lensforge.lens import Lens
from lensforge.sources.bundle import Source
from lensforge.spec import Accuracy, Spec

_ROUND = 10  # steps between multiplier updates
_CHECKPOINT_SECONDS = 2.0
_SEED_STRIDE = 1_000_003  # a scramble of its own for every step, whatever step the run was resumed at


@dataclass(frozen=True)
class Progress:
    """What an observer sees after every gradient step; ``lens`` makes the lens as it is now, for those who ask."""

    level: int
    step: int
    steps_done: int
    steps_total: int
    nmse: float
    efficiency: float
    functions: int
    level_done: bool
    accuracy: Accuracy
    lens: Callable[[], Lens]


@dataclass
class Design:
    """A finished search: the lens, its history, and what it cost."""

    lens: Lens
    history: list[dict[str, Any]]
    constraints: dict[str, float]
    gates: list[Gate]
    seconds: float
    rays_per_step: int

    def to_json(self) -> dict[str, Any]:
        """The content of ``design.json``."""
        steps = sum(len(stage["nmse"]) for stage in self.history)
        return {
            "steps": steps,
            "forward_evaluations": steps,
            "rays_per_step": self.rays_per_step,
            "seconds": self.seconds,
            "history": self.history,
            "constraints": self.constraints,
            "gates": [gate.to_json() for gate in self.gates],
        }


@dataclass(frozen=True)
class _State:
    """Everything that a resumed run needs to go on to the same bits; never changed in place.

    An interrupt may come between any two instructions: it finds either the old state or the new one.
    """

    weights: Float[Tensor, "m 2"]
    offsets: Float[Tensor, "2"]
    multipliers: Float[Tensor, "c k"]
    stage: int = 0
    step: int = 0
    optimiser: dict[str, Any] | None = None
    history: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0


def design(
    spec: Spec,
    source: Source,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    rays: int | None = None,
    device: torch.device | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    observer: Callable[[Progress], None] = lambda _: None,
) -> Design:
    """Search for the lens of ``spec``; its rays are traced by the CPU's kernels, or by their twin on ``device``.

    ``checkpoint`` is written every few seconds and at an interrupt; with ``resume`` the search goes on from it and
    ends with the same bits as an uninterrupted one. ``observer`` is called after every gradient step.
    """
    preset, spec = PRESETS[accuracy], settled_symmetry(spec, source)
    stages = plan(spec, preset, rays)
    parametrisation = Parametrisation.of(spec, preset.nodes_per_sigma)
    objective = Objective.of(spec, source, parametrisation, device)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    key = fingerprint(spec, seed, accuracy, rays, device)
    state = _fresh_state(parametrisation, constraints)
    if resume and checkpoint is not None:
        state = _State(**load_checkpoint(checkpoint, key))
    search = _Search(source, objective, constraints, stages, seed, accuracy, observer, state)
    search.run(checkpoint, key)
    state = search.state
    weights, offsets = nearest_feasible(parametrisation, constraints, state.weights, state.offsets)
    lens = parametrisation.lens(weights, offsets, spec, seed, accuracy)
    measured = measure_constraints(lens)
    return Design(lens, state.history, measured, constraint_gates(spec, measured), state.seconds, stages[-1].rays)


def _fresh_state(parametrisation: Parametrisation, constraints: AugmentedLagrangian) -> _State:
    weights = torch.zeros(parametrisation.basis.size, 2, dtype=torch.float64)
    return _State(weights, torch.ones(2, dtype=torch.float64), constraints.multipliers)


@dataclass
class _Search:
    source: Source
    objective: Objective
    constraints: AugmentedLagrangian
    stages: list[Stage]
    seed: int
    accuracy: Accuracy
    observer: Callable[[Progress], None]
    state: _State

    def run(self, checkpoint: Path | None, key: str) -> None:
        """Run all remaining stages; keep the checkpoint fresh, also at an interrupt."""
        saved = time.monotonic()
        try:
            while self.state.stage < len(self.stages):
                for _ in self._stage_steps(self.stages[self.state.stage]):
                    if checkpoint is not None and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                        save_checkpoint(checkpoint, key, vars(self.state))
                        saved = time.monotonic()
                self.state = replace(self.state, stage=self.state.stage + 1, step=0, optimiser=None)
        finally:
            if checkpoint is not None:
                save_checkpoint(checkpoint, key, vars(self.state))

    def _stage_steps(self, stage: Stage) -> Iterator[None]:
        """Take the stage's remaining steps, one for each item; the state is renewed before every yield."""
        weights = self.state.weights[: stage.functions].clone().requires_grad_()
        offsets = self.state.offsets.clone().requires_grad_()
        optimiser = torch.optim.Adam([weights, offsets], betas=(0.9, 0.99))
        if self.state.optimiser is not None:
            optimiser.load_state_dict(deepcopy(self.state.optimiser))
        self.constraints.multipliers = self.state.multipliers
        earlier = sum(before.steps for before in self.stages[: stage.level])
        steps = range(self.state.step, stage.steps)
        seeds = (self.seed * _SEED_STRIDE + earlier + step for step in steps)
        started = time.perf_counter()
        for step, rays in zip(steps, rays_ahead(self.source, stage.rays, seeds), strict=True):
            for group in optimiser.param_groups:
                group["lr"] = stage.rate(step)
            result = self.objective.evaluate(weights, offsets, rays, self.constraints, step >= stage.uniformity_from)
            optimiser.zero_grad()
            result.loss.backward()
            optimiser.step()
            if step % _ROUND == _ROUND - 1:
                self.constraints.update(result.fields)
            every_weight = self.state.weights.clone()
            every_weight[: stage.functions] = weights.detach()
            self.state = replace(
                self.state,
                weights=every_weight,
                offsets=offsets.detach().clone(),
                multipliers=self.constraints.multipliers,
                step=step + 1,
                optimiser=deepcopy(optimiser.state_dict()),
                history=_grown(self.state.history, stage, step, self._values(result)),
                seconds=self.state.seconds + time.perf_counter() - started,
            )
            self.observer(self._progress(stage, earlier, result))
            yield
            started = time.perf_counter()

    def _progress(self, stage: Stage, earlier: int, result: Evaluated) -> Progress:
        state, objective = self.state, self.objective

        def lens() -> Lens:
            make = objective.parametrisation.lens
            return make(state.weights, state.offsets, objective.spec, self.seed, self.accuracy)

        return Progress(
            level=stage.level,
            step=state.step,
            steps_done=earlier + state.step,
            steps_total=sum(each.steps for each in self.stages),
            nmse=result.nmse,
            efficiency=result.efficiency,
            functions=stage.functions,
            level_done=state.step == stage.steps,
            accuracy=self.accuracy,
            lens=lens,
        )

    def _values(self, result: Evaluated) -> dict[str, float]:
        """What the history keeps of a step."""
        least = self.constraints.least(result.fields)
        return {"loss": result.loss.item(), "nmse": result.nmse, "efficiency": result.efficiency, **least}


def _grown(history: list[dict[str, Any]], stage: Stage, step: int, values: dict[str, float]) -> list[dict[str, Any]]:
    """``history`` with one step more, in lists of its own: the state before it must not change."""
    if step == 0:
        history = [*history, {"level": stage.level, "functions": stage.functions, **{name: [] for name in values}}]
    last = history[-1]
    return [*history[:-1], last | {name: [*last[name], value] for name, value in values.items()}]
