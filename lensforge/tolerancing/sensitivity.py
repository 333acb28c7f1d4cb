"""``sensitivity.json``: uniformity, NMSE and efficiency of the lens as it should be, and of it with each error."""

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from lensforge.accuracy import Preset
from lensforge.evaluation.evaluate import evaluate_traced
from lensforge.evaluation.simulate import TracedLens
from lensforge.files import write_json
from lensforge.lens import Lens
from lensforge.sources.bundle import Source
from lensforge.tolerancing.perturbations import Amounts, Perturbation, Radius, perturbations
from lensforge.tolerancing.shifted_source import ShiftedSource

FILE = "sensitivity.json"
RAYS = 2**19
METRICS = ("uniformity", "rsd", "nmse", "efficiency")


def measure_sensitivity(
    lens: Lens,
    source: Source,
    preset: Preset,
    directory: Path,
    *,
    rays: int | None = None,
    amounts: Amounts | None = None,
) -> dict[str, Any]:
    """Trace the lens with each error of ``amounts``, always with the same rays; write and return the table.

    ``change`` is against the lens as designed: with common rays most of the noise of both cancels.
    """
    started = time.perf_counter()
    amounts = amounts or Amounts()
    nominal = TracedLens.of(lens, preset.judge_nodes_per_sigma)
    count = rays or RAYS
    designed = _metrics(nominal, lens, source, count)
    rows = []
    for error in perturbations(lens, amounts, lens.seed):
        shifted = ShiftedSource(source, error.source_mm, error.index) if any(error.source_mm) or error.index else source
        found = _metrics(perturbed(nominal, error), lens, shifted, count)
        change = {key: _difference(found[key], designed[key]) for key in METRICS}
        rows.append({"name": error.name, "amount": error.amount, "unit": error.unit, **found, "change": change})
    content = {
        "nominal": designed,
        "rows": rows,
        "amounts": asdict(amounts),
        "rays": count,
        "seconds": time.perf_counter() - started,
    }
    write_json(Path(directory) / FILE, content)
    return content


def perturbed(nominal: TracedLens, error: Perturbation) -> TracedLens:
    """The tables and the index of a lens with ``error``; its source is the caller's."""
    scene = replace(nominal.scene, refractive_index=nominal.scene.refractive_index + error.index)
    inner, outer = (
        _table(nominal, error.surfaces[name]) if name in error.surfaces else table
        for name, table in (("inner", nominal.inner), ("outer", nominal.outer))
    )
    return replace(nominal, scene=scene, inner=inner, outer=outer)


def _table(nominal: TracedLens, radius: Radius) -> torch.Tensor:
    grid = nominal.scene.grid
    samples = radius(grid.sample_directions())[:, None]
    return torch.from_numpy(grid.coefficients(samples).reshape(grid.side, grid.side))


def _metrics(traced: TracedLens, lens: Lens, source: Source, rays: int) -> dict[str, float | None]:
    report = evaluate_traced(traced, lens.spec, source, rays, lens.seed).report
    return {key: report[key] for key in METRICS}


def _difference(value: float | None, before: float | None) -> float | None:
    return None if value is None or before is None else value - before
