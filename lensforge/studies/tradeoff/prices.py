"""What each accuracy preset costs and leaves on this scene, read off the ladders."""

import numpy as np

from lensforge.accuracy import PRESETS
from lensforge.evaluation.simulate import REPLICATES
from lensforge.spec import Accuracy
from lensforge.studies.tradeoff.ladder import Ladder, Rung
from lensforge.studies.tradeoff.rays import PLAIN, QMC
from lensforge.studies.tradeoff.record import PresetPrice, PresetStage


def preset_prices(rays: Ladder, tables: Ladder, population: int | None) -> dict[Accuracy, PresetPrice]:
    """By preset: the tables' errors in design and evaluation, and the ray noise of a gradient step and of the verdict.

    ``noise_nmse``: of the filtered irradiance; between and beyond the rungs by the power law through the nearest two.
    ``table_share``: the table's irradiance NMSE over that noise. The rule of the presets is that it stays below 0.01.
    """
    prices: dict[Accuracy, PresetPrice] = {}
    for name, preset in PRESETS.items():
        if population is None:
            judged, shared = preset.evaluate_rays // REPLICATES, REPLICATES
        else:
            judged, shared = min(preset.evaluate_rays, population), 1
        design = _table(tables, preset.nodes_per_sigma)
        evaluation = _table(tables, preset.judge_nodes_per_sigma)
        step = _noise(rays, "irradiance_nmse", min(preset.design_rays, population or preset.design_rays))
        verdict = _noise(rays, "irradiance_nmse", judged) / shared
        error = _noise(rays, "efficiency", judged) / float(np.sqrt(shared))
        traced = preset.evaluate_rays if population is None else judged
        prices[name] = PresetPrice(
            design=_priced(design, step, preset.design_rays), evaluation=_priced(evaluation, verdict, traced, error)
        )
    return prices


def _priced(table: Rung | None, noise: float, rays: int, efficiency_error: float | None = None) -> PresetStage:
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


def _table(tables: Ladder, nodes_per_sigma: float) -> Rung | None:
    return next((rung for rung in tables.rows if rung.setting == nodes_per_sigma), None)


def _noise(rays: Ladder, error: str, count: int) -> float:
    """The error of a run of ``count`` rays, by the best sampling there is."""
    by_series = {series: [rung for rung in rays.rows if rung.series == series] for series in (QMC, PLAIN)}
    rungs = by_series[QMC] or by_series[PLAIN]
    x = np.log([rung.setting for rung in rungs])
    values = np.array([rung.errors[error].value for rung in rungs])
    if len(rungs) < 2 or values.min() <= 0.0:
        return float(values[-1])
    right = int(np.clip(np.searchsorted(x, np.log(count)), 1, len(x) - 1))
    share = (np.log(count) - x[right - 1]) / (x[right] - x[right - 1])
    y = np.log(values)
    return float(np.exp(y[right - 1] + share * (y[right] - y[right - 1])))
