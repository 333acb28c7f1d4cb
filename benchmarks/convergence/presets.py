"""Accuracy presets on this scene: their table errors and ray noise, from the convergence studies."""

import numpy as np

from convergence.rays import PLAIN, QMC
from convergence.study import ConvergenceStudy, RefinementLevel
from lensforge.light.simulation import REPLICATES
from lensforge.results import Count, Metric, NotNegative, Number, Record
from lensforge.spec import Accuracy
from lensforge.spec.accuracy import PRESETS


class PresetStage(Record):
    """Errors of a preset in design or evaluation; ``table_*`` None where its tables were not measured.

    ``noise_nmse``: of the filtered irradiance, by ``rays`` rays; ``table_share``: the table's irradiance NMSE over it.
    """

    rays: Count
    noise_nmse: Number
    table_rho: Metric | None = None
    table_normal: Metric | None = None
    table_hit: Metric | None = None
    table_hit_99_percent: Metric | None = None
    table_irradiance_nmse: Metric | None = None
    table_share: Number | None = None
    efficiency_standard_error: NotNegative | None = None


class PresetAccuracy(Record):
    """Accuracy of a preset in its two stages."""

    design: PresetStage
    evaluation: PresetStage


def accuracy_of_presets(
    rays: ConvergenceStudy, tables: ConvergenceStudy, ray_count: int | None
) -> dict[Accuracy, PresetAccuracy]:
    """Table errors of each preset in design and evaluation, and ray noise of a gradient step and of the evaluation.

    ``noise_nmse``: of the filtered irradiance; between and beyond the measured counts of rays by the power law through
    the nearest two. ``table_share``: the table's irradiance NMSE over that noise; the presets are chosen to keep it
    below 0.01.
    """
    found: dict[Accuracy, PresetAccuracy] = {}
    for name, preset in PRESETS.items():
        if ray_count is None:
            at_once, shared = preset.evaluate_rays // REPLICATES, REPLICATES
        else:
            at_once, shared = min(preset.evaluate_rays, ray_count), 1
        design = _table(tables, preset.nodes_per_sigma)
        evaluation = _table(tables, preset.evaluate_nodes_per_sigma)
        step = _noise(rays, "irradiance_nmse", min(preset.design_rays, ray_count or preset.design_rays))
        evaluated = _noise(rays, "irradiance_nmse", at_once) / shared
        error = _noise(rays, "efficiency", at_once) / float(np.sqrt(shared))
        traced = preset.evaluate_rays if ray_count is None else at_once
        found[name] = PresetAccuracy(
            design=_stage(design, step, preset.design_rays), evaluation=_stage(evaluation, evaluated, traced, error)
        )
    return found


def _stage(
    table: RefinementLevel | None, noise: float, rays: int, efficiency_error: float | None = None
) -> PresetStage:
    errors = {} if table is None else table.errors
    added = errors.get("irradiance_nmse")
    return PresetStage(
        rays=rays,
        noise_nmse=noise,
        table_rho=errors.get("rho"),
        table_normal=errors.get("normal"),
        table_hit=errors.get("hit"),
        table_hit_99_percent=errors.get("hit_99_percent"),
        table_irradiance_nmse=added,
        table_share=added.value / noise if added and noise > 0.0 else None,
        efficiency_standard_error=efficiency_error,
    )


def _table(tables: ConvergenceStudy, nodes_per_sigma: float) -> RefinementLevel | None:
    return next((level for level in tables.levels if level.setting == nodes_per_sigma), None)


def _noise(rays: ConvergenceStudy, error: str, count: int) -> float:
    """The error of a run of ``count`` rays, quasi-Monte Carlo where the source allows it."""
    by_series = {series: [level for level in rays.levels if level.series == series] for series in (QMC, PLAIN)}
    levels = by_series[QMC] or by_series[PLAIN]
    x = np.log([level.setting for level in levels])
    values = np.array([level.errors[error].value for level in levels])
    if len(levels) < 2 or values.min() <= 0.0:
        return float(values[-1])
    right = int(np.clip(np.searchsorted(x, np.log(count)), 1, len(x) - 1))
    share = (np.log(count) - x[right - 1]) / (x[right] - x[right - 1])
    y = np.log(values)
    return float(np.exp(y[right - 1] + share * (y[right] - y[right - 1])))
