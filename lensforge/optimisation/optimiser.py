"""The search: Adam, coarse to fine, with multiplier updates between rounds; resumable at any step."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from lensforge import seeds
from lensforge.accuracy import PRESETS
from lensforge.errors import Cancelled, remedy
from lensforge.lens import Lens
from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.checkpoint import delete_checkpoint, fingerprint
from lensforge.optimisation.design import Design, Observer, Progress
from lensforge.optimisation.feasibility import measure_constraints, project_to_feasible, require_feasible_start
from lensforge.optimisation.limits import constraint_criteria
from lensforge.optimisation.merit import Evaluated, MeritFunction
from lensforge.optimisation.parameters import Parametrisation
from lensforge.optimisation.scene_check import SceneCheck
from lensforge.optimisation.schedule import Stage, plan, rays_ahead
from lensforge.optimisation.search_state import SearchState, level_of, moments_of, restored, resume_adam
from lensforge.optimisation.symmetry import settled_symmetry
from lensforge.sources.build import summarise
from lensforge.sources.bundle import Source
from lensforge.spec import Accuracy, Spec
from lensforge.spec.files import input_hashes, section_sha256
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.symmetry import first_images

_ROUND = 10  # steps between multiplier updates
_CHECKPOINT_SECONDS = 2.0
_SIZE_DIRECTIONS = 20_000  # over the hemisphere, at which radius and height are sampled


def search(
    spec: Spec,
    source: Source,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    device: torch.device | None = None,
    start: Lens | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Observer | None = None,
) -> Design:
    """Search for the lens of ``spec``; its rays are traced by the CPU's kernels, or by torch on ``device``.

    ``start``: a lens to begin from instead of two hemispheres; then all functions move from the first step on.
    ``checkpoint`` is written every few seconds and at an interrupt; with ``resume`` the search goes on from it and ends
    with the same bits as an uninterrupted one. ``progress`` is called after every gradient step; where it returns
    False, the search raises :class:`Cancelled`. Raises :class:`InputError` for a scene without light in the lens, or a
    target that no lens can light.
    """
    scene = SceneCheck.of(spec, source, start)
    scene.require_light()
    preset, spec = PRESETS[accuracy], settled_symmetry(spec, source)
    stages = plan(spec, preset) if start is None else plan(spec, preset)[-1:]
    parametrisation = Parametrisation.of(spec, preset.nodes_per_sigma)
    merit = MeritFunction.of(spec, source, parametrisation, device)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    key = fingerprint(spec, seed, accuracy, start, device)
    state = _fresh_state(parametrisation, constraints, start)
    if resume and checkpoint is not None:
        state = restored(checkpoint, key, state, stages, constraints.keys)
    elif start is None:
        require_feasible_start(spec, parametrisation, constraints)
    if checkpoint is not None and not resume:
        delete_checkpoint(checkpoint)  # of an earlier search: an interrupt before the first step leaves none
    run = _Search(source, merit, constraints, stages, seed, accuracy, progress or (lambda _: None), state)
    run.run(checkpoint, key)
    state = run.state
    weights, offsets = project_to_feasible(parametrisation, constraints, state.weights, state.offsets)
    lens = parametrisation.lens(weights, offsets, spec, seed, accuracy)
    return _design(lens, source, state, stages[-1].rays, scene.warnings())


def _design(lens: Lens, source: Source, state: SearchState, rays_per_step: int, warnings: tuple[str, ...]) -> Design:
    """The record of a finished search; ``warnings`` on its scene go with those on its source."""
    summary = summarise(source, lens.spec.source)
    directions = fibonacci_hemisphere(_SIZE_DIRECTIONS)
    directions = directions[first_images(directions, lens.symmetry)]
    radius, margins = lens.outer.radius(directions), measure_constraints(lens)
    steps = sum(len(level["nmse"]) for level in state.history)
    return Design(
        inputs={"lens": lens.sha256, "spec": section_sha256(lens.spec), **input_hashes(lens.spec)},
        lens=lens,
        steps=steps,
        forward_evaluations=steps,
        rays_per_step=rays_per_step,
        seconds=state.seconds,
        max_radius_mm=float(radius.max()),
        height_mm=float((radius * directions[:, 2]).max()),
        constraints=margins,
        source=summary.model_copy(update={"warnings": (*summary.warnings, *warnings)}),
        source_outline_mm=tuple((float(x), float(y), float(z)) for x, y, z in source.outline()),
        history=tuple(level_of(level) for level in state.history),
        criteria=constraint_criteria(lens.spec, margins),
    )


def _fresh_state(parametrisation: Parametrisation, constraints: AugmentedLagrangian, start: Lens | None) -> SearchState:
    if start is not None:
        return SearchState(*parametrisation.parameters_of(start), constraints.multipliers)
    weights = torch.zeros(parametrisation.basis.size, 2, dtype=torch.float64)
    return SearchState(weights, torch.ones(2, dtype=torch.float64), constraints.multipliers)


@dataclass
class _Search:
    source: Source
    merit: MeritFunction
    constraints: AugmentedLagrangian
    stages: list[Stage]
    seed: int
    accuracy: Accuracy
    observer: Observer
    state: SearchState

    def run(self, checkpoint: Path | None, key: str) -> None:
        """Run all remaining stages; keep the checkpoint fresh, also at an interrupt."""
        saved = time.monotonic()
        try:
            while self.state.stage < len(self.stages):
                for _ in self._stage_steps(self.stages[self.state.stage]):
                    if checkpoint is not None and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                        self.state.save(checkpoint, key)
                        saved = time.monotonic()
                self.state = replace(self.state, stage=self.state.stage + 1, step=0, moments=None)
        finally:
            if checkpoint is not None:
                self.state.save(checkpoint, key)

    def _stage_steps(self, stage: Stage) -> Iterator[None]:
        """Take the stage's remaining steps, one for each item; the state is replaced before every yield."""
        weights = self.state.weights[: stage.functions].clone().requires_grad_()
        offsets = self.state.offsets.clone().requires_grad_()
        optimiser = torch.optim.Adam([weights, offsets], betas=(0.9, 0.99))
        if self.state.moments is not None:
            resume_adam(optimiser, self.state.step, self.state.moments)
        self.constraints.multipliers = self.state.multipliers
        earlier = sum(before.steps for before in self.stages[: self.state.stage])
        steps = range(self.state.step, stage.steps)
        own_seeds = (seeds.of_step(self.seed, earlier + step) for step in steps)
        started = time.perf_counter()
        for step, rays in zip(steps, rays_ahead(self.source, stage.rays, own_seeds), strict=True):
            for group in optimiser.param_groups:
                group["lr"] = stage.rate(step)
            with remedy("lower optimise.learning_rate, or raise lens.inner_offset_mm or lens.outer_offset_mm"):
                result = self.merit.evaluate(weights, offsets, rays, self.constraints, step >= stage.uniformity_from)
            optimiser.zero_grad()
            result.loss.backward()
            optimiser.step()
            if step % _ROUND == _ROUND - 1:
                self.constraints.update(result.fields)
            every_weight = self.state.weights.clone()
            every_weight[: stage.functions] = weights.detach()
            following = replace(
                self.state,
                weights=every_weight,
                offsets=offsets.detach().clone(),
                multipliers=self.constraints.multipliers,
                step=step + 1,
                moments=moments_of(optimiser),
                history=_extended(self.state.history, stage, step, self._values(result)),
                seconds=self.state.seconds + time.perf_counter() - started,
            )
            proceed = self.observer(self._progress(following, stage, earlier, result))
            self.state = following  # not earlier: where the observer is interrupted, a resumed search calls it again
            if proceed is False:
                raise Cancelled(f"{self.merit.spec.name}: cancelled after step {earlier + self.state.step}")
            yield
            started = time.perf_counter()

    def _progress(self, state: SearchState, stage: Stage, earlier: int, result: Evaluated) -> Progress:
        merit = self.merit

        def lens() -> Lens:
            make = merit.parametrisation.lens
            return make(state.weights, state.offsets, merit.spec, self.seed, self.accuracy)

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
        """History of one step."""
        least = self.constraints.least(result.fields)
        return {"loss": result.loss.item(), "nmse": result.nmse, "efficiency": result.efficiency, **least}


def _extended(history: list[dict[str, Any]], stage: Stage, step: int, values: dict[str, float]) -> list[dict[str, Any]]:
    """``history`` with one more step, in new lists: the state before it must not change."""
    if step == 0:
        history = [*history, {"level": stage.level, "functions": stage.functions, **{name: [] for name in values}}]
    last = history[-1]
    return [*history[:-1], last | {name: [*last[name], value] for name, value in values.items()}]
