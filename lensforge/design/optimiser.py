"""The search: Adam, coarse to fine, with multiplier updates between rounds; resumable at any step."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.accuracy import PRESETS
from lensforge.design.checkpoint import fingerprint, load_checkpoint, save_checkpoint
from lensforge.design.constraints import AugmentedLagrangian, constraint_gates, measure_constraints
from lensforge.design.objective import Objective
from lensforge.design.parameters import Parametrisation
from lensforge.design.schedule import Stage, plan
from lensforge.gates import Gate
from lensforge.lens import Lens
from lensforge.sources.bundle import Source
from lensforge.spec import Accuracy, Spec

_ROUND = 10  # steps between multiplier updates
_CHECKPOINT_SECONDS = 5.0
_SEED_STRIDE = 1_000_003  # a scramble of its own for every step, whatever step the run was resumed at


@dataclass(frozen=True)
class Progress:
    """What an observer sees after every gradient step."""

    level: int
    step: int
    steps_done: int
    steps_total: int
    nmse: float
    efficiency: float


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


@dataclass
class _State:
    """Everything that a resumed run needs to go on to the same bits."""

    weights: Float[Tensor, "m 2"]
    offsets: Float[Tensor, "2"]
    multipliers: Float[Tensor, "3 k"]
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
    checkpoint: Path | None = None,
    resume: bool = False,
    observer: Callable[[Progress], None] = lambda _: None,
) -> Design:
    """Search for the lens of ``spec``.

    ``checkpoint`` is written every few seconds and at an interrupt; with ``resume`` the search goes on from it and
    ends with the same bits as an uninterrupted one. ``observer`` is called after every gradient step.
    """
    preset = PRESETS[accuracy]
    stages = plan(spec, preset, rays)
    parametrisation = Parametrisation.of(spec, preset.nodes_per_sigma)
    objective = Objective.of(spec, source, parametrisation)
    constraints = AugmentedLagrangian(spec.constraints, parametrisation.grid)
    key = fingerprint(spec, seed, accuracy, rays)
    state = _fresh_state(parametrisation, constraints)
    if resume and checkpoint is not None:
        state = _State(**load_checkpoint(checkpoint, key))
    constraints.multipliers = state.multipliers
    search = _Search(spec, source, objective, constraints, stages, seed, observer)
    search.run(state, checkpoint, key)
    lens = parametrisation.lens(state.weights, state.offsets, spec, seed, accuracy)
    measured = measure_constraints(lens)
    return Design(lens, state.history, measured, constraint_gates(measured), state.seconds, stages[-1].rays)


def _fresh_state(parametrisation: Parametrisation, constraints: AugmentedLagrangian) -> _State:
    weights = torch.zeros(parametrisation.basis.size, 2, dtype=torch.float64)
    return _State(weights, torch.ones(2, dtype=torch.float64), constraints.multipliers)


@dataclass
class _Search:
    spec: Spec
    source: Source
    objective: Objective
    constraints: AugmentedLagrangian
    stages: list[Stage]
    seed: int
    observer: Callable[[Progress], None]

    def run(self, state: _State, checkpoint: Path | None, key: str) -> None:
        """Run all remaining stages on ``state``; keep the checkpoint fresh."""
        saved = time.monotonic()

        def save(force: bool = False) -> None:
            nonlocal saved
            if checkpoint is not None and (force or time.monotonic() - saved > _CHECKPOINT_SECONDS):
                save_checkpoint(checkpoint, key, vars(state))
                saved = time.monotonic()

        try:
            while state.stage < len(self.stages):
                self._run_stage(state, self.stages[state.stage], save)
                state.stage, state.step, state.optimiser = state.stage + 1, 0, None
        except KeyboardInterrupt:
            save(force=True)
            raise
        save(force=True)

    def _run_stage(self, state: _State, stage: Stage, save: Callable[[], None]) -> None:
        weights = state.weights[: stage.functions].clone().requires_grad_()
        offsets = state.offsets.clone().requires_grad_()
        optimiser = torch.optim.Adam([weights, offsets], betas=(0.9, 0.99))
        if state.optimiser is not None:
            optimiser.load_state_dict(state.optimiser)
        if state.step == 0:
            state.history.append({"level": stage.level, "functions": stage.functions, "nmse": [], "efficiency": []})
        for step in range(state.step, stage.steps):
            started = time.perf_counter()
            self._descend(weights, offsets, optimiser, stage, step, state)
            state.weights[: stage.functions] = weights.detach()
            state.offsets = offsets.detach().clone()
            state.multipliers, state.step = self.constraints.multipliers, step + 1
            state.optimiser = optimiser.state_dict()
            state.seconds += time.perf_counter() - started
            save()

    def _descend(
        self, weights: Tensor, offsets: Tensor, optimiser: torch.optim.Adam, stage: Stage, step: int, state: _State
    ) -> None:
        for group in optimiser.param_groups:
            group["lr"] = stage.rate(step)
        done = sum(earlier.steps for earlier in self.stages[: state.stage]) + step
        rays = self.source.sample(stage.rays, self.seed * _SEED_STRIDE + done)
        result = self.objective.evaluate(weights, offsets, rays, self.constraints, step >= stage.uniformity_from)
        optimiser.zero_grad()
        result.loss.backward()
        optimiser.step()
        if step % _ROUND == _ROUND - 1:
            self.constraints.update(result.fields)
        state.history[-1]["nmse"].append(result.nmse)
        state.history[-1]["efficiency"].append(result.efficiency)
        total = sum(stage.steps for stage in self.stages)
        self.observer(Progress(stage.level, step + 1, done + 1, total, result.nmse, result.efficiency))
