"""A trade-off record of a few made-up levels; no two methods of a study have the same name."""

from lensforge.results import Metric
from lensforge.runs.tradeoff.convergence import ConvergenceStudy, RefinementLevel, reference_level
from lensforge.runs.tradeoff.record import MeasuredLens, PresetAccuracy, PresetStage, Tradeoff

_TABLE = {"rho": ("nm", 12.5), "normal": ("mrad", 0.0125), "hit": ("mm", 0.375), "irradiance_nmse": ("", 1.5e-4)}
_LIGHT = {"efficiency": ("of the source", 3e-4), "hit_99_percent": ("mm", 0.1), "irradiance_nmse": ("", 0.02)}
_CONCAVE = {"inner_concave_mm": 3.25}
_MESH = {"chord": ("um", 0.9), "normal": ("mrad", 1.7), "nmse_shift": ("", -3e-4)}


def make_tradeoff(lens):
    """Two presets, one of them without tables, and three studies."""
    studies = {
        "rays": _study("rays", _LIGHT, ("plain", "quasi"), 65536, against="seconds"),
        "mesh": _study("mesh", _MESH, ("equal rings", "split rings"), 48, other={"triangles": 12345, "step_kb": 678.9}),
        "search": _study("search", {"loss": ("", 0.2)}, ("few", "many"), 0.75, other=_CONCAVE, order=()),
    }
    tables = PresetStage(
        rays=8192, noise_nmse=0.0312, table_share=0.0043, efficiency_standard_error=2.5e-4,
        **{f"table_{name}": _metric(unit, value) for name, (unit, value) in _TABLE.items()},
    )  # fmt: skip
    plain = PresetStage(rays=4_194_304, noise_nmse=3.1e-5)
    return Tradeoff(
        inputs={"lens": lens.sha256},
        name="of a lens",
        lens=MeasuredLens(accuracy="draft", seed=23, version="0.0.0"),
        threads=3,
        presets={
            "draft": PresetAccuracy(design=tables, evaluation=plain),
            "reference": PresetAccuracy(design=plain, evaluation=tables),
        },
        studies=studies,
        seconds=1234.5,
    )


def _metric(unit, value):
    return Metric(value=value, unit=unit, standard_error=0.05 * abs(value))


def _study(name, errors, series, setting, against="setting", other=None, order=("first",)):
    """The second level has no costs, none of the ``other`` numbers, and its errors in another order."""
    found = {key: _metric(unit, value) for key, (unit, value) in errors.items()}
    first, second = series
    levels = (
        RefinementLevel(
            setting=setting, series=first, seconds=0.123, peak_mb=45.6, errors=found, other=other or {},
            used_by=("the export", "draft, design"),
        ),
        RefinementLevel(
            setting=2 * setting, series=second, seconds=None, peak_mb=None,
            errors={key: Metric(value=0.25 * found[key].value, unit=found[key].unit) for key in reversed(found)},
        ),
        reference_level("the exact sum", {key: unit for key, (unit, _) in errors.items()}),
    )  # fmt: skip
    orders = {key: Metric(value=-1.5, standard_error=0.2) for key in errors}
    return ConvergenceStudy(
        name=name, title=f"Number of {name}", knob=f"--{name}", reference=f"the sum of 4321 {name}", levels=levels,
        order={first: orders} if order else {}, plotted=tuple(errors), against=against,
    )  # fmt: skip
