"""What each accuracy preset costs and leaves on this scene, read off the ladders."""

from typing import Any

import numpy as np

from lensforge.accuracy import PRESETS
from lensforge.evaluation.simulate import REPLICATES
from lensforge.studies.tradeoff.ladder import Ladder, Rung
from lensforge.studies.tradeoff.rays import PLAIN, QMC


def preset_prices(rays: Ladder, tables: Ladder, population: int | None) -> dict[str, Any]:
    """By preset: the tables' errors in design and evaluation, and the ray noise of a gradient step and of the verdict.

    ``noise_nmse``: of the filtered irradiance; between and beyond the rungs by the power law through the nearest two.
    ``table_share``: the table's irradiance NMSE over that noise. The rule of the presets is that it stays below 0.01.
    """
    prices: dict[str, Any] = {}
    for name, preset in PRESETS.items():
        if population is None:
            judged, shared = preset.evaluate_rays // REPLICATES, REPLICATES
        else:
            judged, shared = min(preset.evaluate_rays, population), 1
        design = _table(tables, preset.nodes_per_sigma)
        evaluation = _table(tables, preset.judge_nodes_per_sigma)
        step = _noise(rays, "irradiance_nmse", min(preset.design_rays, population or preset.design_rays))
        verdict = _noise(rays, "irradiance_nmse", judged) / shared
        prices[name] = {
            "design": _priced(design, step) | {"rays": preset.design_rays},
            "evaluation": _priced(evaluation, verdict)
            | {
                "rays": preset.evaluate_rays if population is None else judged,
                "efficiency_standard_error": _noise(rays, "efficiency", judged) / float(np.sqrt(shared)),
            },
        }
    return prices


def _priced(table: Rung | None, noise: float) -> dict[str, float]:
    if table is None:
        return {"noise_nmse": noise}
    errors = {f"table_{name}": estimate.value for name, estimate in table.errors.items()}
    share = {"table_share": errors["table_irradiance_nmse"] / noise} if noise > 0.0 else {}
    return {**errors, "noise_nmse": noise, **share}


def _table(tables: Ladder, nodes_per_sigma: float) -> Rung | None:
    return next((rung for rung in tables.rungs if rung.setting == nodes_per_sigma), None)


def _noise(rays: Ladder, error: str, count: int) -> float:
    """The error of a run of ``count`` rays, by the best sampling there is."""
    by_series = {series: [rung for rung in rays.rungs if rung.series == series] for series in (QMC, PLAIN)}
    rungs = by_series[QMC] or by_series[PLAIN]
    x = np.log([rung.setting for rung in rungs])
    values = np.array([rung.errors[error].value for rung in rungs])
    if len(rungs) < 2 or values.min() <= 0.0:
        return float(values[-1])
    right = int(np.clip(np.searchsorted(x, np.log(count)), 1, len(x) - 1))
    share = (np.log(count) - x[right - 1]) / (x[right] - x[right - 1])
    y = np.log(values)
    return float(np.exp(y[right - 1] + share * (y[right] - y[right - 1])))
