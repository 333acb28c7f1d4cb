"""The search: from a spec to the lens that lights its target best, with its record."""

from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import torch

from lensforge.accuracy import PRESETS, Preset
from lensforge.lens import Lens
from lensforge.optimisation.automatic import AutomaticSchedule
from lensforge.optimisation.automatic_stages import AutomaticStages
from lensforge.optimisation.checkpoint import delete_checkpoint, fingerprint
from lensforge.optimisation.descent import Descent, Stopwatch
from lensforge.optimisation.design import Design, Margins, Observer
from lensforge.optimisation.feasibility import feasible_lens, require_feasible_start
from lensforge.optimisation.held_rays import HeldRays
from lensforge.optimisation.levels import UsefulLevels
from lensforge.optimisation.limits import constraint_criteria
from lensforge.optimisation.problem import Problems
from lensforge.optimisation.scene_check import SceneCheck
from lensforge.optimisation.schedule import Schedule, fixed_schedule, stages_of
from lensforge.optimisation.search_state import SearchState, level_of, restored
from lensforge.optimisation.symmetry import settled_symmetry
from lensforge.sources.build import summarise
from lensforge.sources.bundle import Source
from lensforge.sources.measured_rays import searched
from lensforge.spec import Accuracy, Spec
from lensforge.spec.files import input_hashes, section_sha256
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.symmetry import first_images, group

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
    anyway: bool = False,
) -> Design:
    """Search for the lens of ``spec``; its rays are traced by the CPU's kernels, or by torch on ``device``.

    ``start``: a lens to begin from instead of two hemispheres; then given levels all move from the first step on, and
    automatic ones begin with as many as it has, the broad ones first. ``checkpoint`` is written every few seconds and
    at an interrupt; with ``resume`` the search goes on from it and ends with the same bits as an uninterrupted one,
    unless ``optimise.seconds`` makes it depend on time. ``progress`` is called after every gradient step; where it
    returns False, the search raises :class:`Cancelled`. Raises :class:`InputError` for a scene without light in the
    lens, or a target of which no lens can light half, unless ``anyway``.
    """
    clock, scene = Stopwatch(), SceneCheck.of(spec, source, start)
    scene.require_light(anyway=anyway)
    preset, spec = PRESETS[accuracy], settled_symmetry(spec, source)
    schedule = _schedule(spec, source, preset, start)
    problems = Problems(spec, source, preset.nodes_per_sigma, device)
    key = fingerprint(spec, seed, accuracy, start, device)
    if resume and checkpoint is not None:
        state = restored(checkpoint, key, schedule, problems)
        clock.earlier_s = state.seconds
    else:
        state = _fresh_state(schedule, problems, start)
    if checkpoint is not None and not resume:
        delete_checkpoint(checkpoint)  # of an earlier search: an interrupt before the first step leaves none
    held, of_steps = None, searched(source)
    if spec.lens.levels == "auto":
        held, of_steps = HeldRays.of(of_steps, preset.effort.held_rays, seed)
    descent = Descent(of_steps, problems, schedule, held, seed, accuracy, progress or (lambda _: None), state, clock)
    descent.run(checkpoint, key)
    state = descent.state
    last = stages_of(schedule, state.outcomes)[-1]
    problem = problems.of(_levels_of(last.levels, len(state.weights)))
    lens, margins = feasible_lens(problem, state, seed, accuracy)
    why = schedule.turn(state.outcomes).why or None
    state = replace(state, seconds=clock.seconds())
    return _design(lens, margins, source, state, last.rays, why, scene.warnings())


def _schedule(spec: Spec, source: Source, preset: Preset, start: Lens | None) -> Schedule:
    if spec.lens.levels != "auto":
        return fixed_schedule(spec, preset, last_only=start is not None)
    effort, settings = preset.effort.with_rays_of(searched(source).ray_count), spec.optimise
    levels = UsefulLevels.of(spec, source, effort.finest)
    first = 0 if start is None else levels.resolving(start.detail_rad, spec.lens.sigma_c)
    # parts of a robust search have no symmetry: the spread of their light is not averaged over mirror images
    uniform, images = spec.has_uniform_region, 1 if settings.robust else len(group(spec.lens.symmetry))
    stages = AutomaticStages(levels, effort, settings.learning_rate, images, first)
    return AutomaticSchedule(stages, uniform, settings.seconds)


def _levels_of(levels: tuple[int, ...], weights: int) -> tuple[int, ...]:
    """The first of ``levels`` that have so many weights: the last one may have been left out at the very end."""
    return levels[: list(accumulate(levels)).index(weights) + 1]


def _design(
    lens: Lens,
    margins: Margins,
    source: Source,
    state: SearchState,
    rays_per_step: int,
    why: str | None,
    warnings: tuple[str, ...],
) -> Design:
    """The record of a finished search; ``warnings`` on its scene go with those on its source."""
    summary = summarise(source, lens.spec.source)
    directions = fibonacci_hemisphere(_SIZE_DIRECTIONS)
    directions = directions[first_images(directions, lens.symmetry)]
    radius = lens.outer.radius(directions)
    return Design(
        inputs={"lens": lens.sha256, "spec": section_sha256(lens.spec), **input_hashes(lens.spec)},
        lens=lens,
        steps=state.steps_done,
        forward_evaluations=state.steps_done,
        rays_per_step=rays_per_step,
        seconds=state.seconds,
        max_radius_mm=float(radius.max()),
        height_mm=float((radius * directions[:, 2]).max()),
        constraints=margins,
        source=summary.model_copy(update={"warnings": (*summary.warnings, *warnings)}),
        source_outline_mm=tuple((float(x), float(y), float(z)) for x, y, z in source.outline()),
        ended=why,
        history=tuple(level_of(level) for level in state.history),
        criteria=constraint_criteria(lens.spec, margins),
    )


def _fresh_state(schedule: Schedule, problems: Problems, start: Lens | None) -> SearchState:
    """The state before the first step. Raises :class:`InputError` where no lens is found that keeps the limits."""
    first = schedule.turn(()).stage
    assert first is not None, "a spec has levels"
    problem = problems.of(first.levels)
    multipliers = problem.constraints.multipliers
    if start is not None:
        return SearchState(*problem.parametrisation.parameters_of(start), multipliers)
    finest = schedule.stages.levels.counts if isinstance(schedule, AutomaticSchedule) else first.levels
    require_feasible_start(map(problems.of, dict.fromkeys((first.levels, finest))))
    weights = torch.zeros(problem.parametrisation.basis.size, 2, dtype=torch.float64)
    return SearchState(weights, torch.ones(2, dtype=torch.float64), multipliers)
