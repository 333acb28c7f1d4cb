"""The sensitivity study: NMSE, uniformity, RSD and efficiency of the lens as designed, and with each error."""

import time
from collections.abc import Callable
from dataclasses import replace

import torch

from lensforge.accuracy import Preset
from lensforge.evaluation.replicate_metrics import TracedLight, traced_light
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.sources.bundle import Source
from lensforge.tolerancing.perturbations import Perturbation, Radius, ShiftedSource, perturbations
from lensforge.tolerancing.sensitivity_table import Amounts, ErrorRow, Sensitivity

RAYS = 2**19


def measure_sensitivity(
    lens: Lens,
    source: Source,
    preset: Preset,
    *,
    rays: int,
    amounts: Amounts | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sensitivity:
    """Trace the lens with each error of ``amounts``, always with the same rays.

    Changes are from the lens as designed, replicate by replicate: the noise that both have in common cancels, and the
    standard error of a change is that of what is left. ``progress`` is called after each lens with the number of lenses
    traced and of all.
    """
    started = time.perf_counter()
    amounts = amounts or Amounts()
    nominal = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    errors = perturbations(lens, amounts, lens.seed)
    announce = progress or (lambda done, total: None)
    designed = traced_light(nominal, lens.spec, source, rays, lens.seed)
    announce(1, len(errors) + 1)
    rows = []
    for done, error in enumerate(errors, start=2):
        shifted = ShiftedSource(source, error.source_mm, error.index) if any(error.source_mm) or error.index else source
        found = traced_light(perturbed(nominal, error), lens.spec, shifted, rays, lens.seed)
        rows.append(_row(error, found, designed, rays))
        announce(done, len(errors) + 1)
    return Sensitivity(
        inputs={"lens": lens.sha256},
        nominal=designed.metrics,
        rows=tuple(rows),
        amounts=amounts,
        rays=rays,
        seconds=time.perf_counter() - started,
    )


def perturbed(nominal: TracedLens, error: Perturbation) -> TracedLens:
    """Tables and index of the lens with ``error``; an error of the source is left to the caller."""
    media = nominal.scene.media
    scene = replace(nominal.scene, media=replace(media, refractive_index=media.refractive_index + error.index))
    inner, outer = (
        _table(nominal, error.surfaces[name]) if name in error.surfaces else table
        for name, table in (("inner", nominal.inner), ("outer", nominal.outer))
    )
    return replace(nominal, scene=scene, inner=inner, outer=outer)


def _table(nominal: TracedLens, radius: Radius) -> torch.Tensor:
    grid = nominal.scene.grid
    samples = radius(grid.sample_directions())[:, None]
    return torch.from_numpy(grid.coefficients(samples).reshape(grid.side, grid.side))


def _row(error: Perturbation, found: TracedLight, designed: TracedLight, rays: int) -> ErrorRow:
    change = found.replicates.change_from(designed.replicates, rays)
    return ErrorRow(name=error.name, amount=error.amount, unit=error.unit, metrics=found.metrics, change=change)
