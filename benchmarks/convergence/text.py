"""Convergence studies in words and numbers: Markdown of a page or a terminal."""

from collections.abc import Iterator, Mapping

from convergence.presets import PresetAccuracy
from convergence.study import ConvergenceStudy, Errors, RefinementLevel
from lensforge.results import Metric
from lensforge.results.numerals import NOTHING, number, quantity
from lensforge.spec import Accuracy

_NAMES = {
    "efficiency": "efficiency",
    "irradiance_nmse": "irradiance, NMSE",
    "nmse_raised": "NMSE raised by",
    "rho": "radius",
    "normal": "normal",
    "hit": "hit, largest",
    "hit_99_percent": "hit, 99th percentile",
    "splat_nmse": "splat, NMSE",
    "nmse_shift": "NMSE shifted by",
    "noise_nmse": "remaining noise, NMSE",
    "form": "form",
    "nmse": "NMSE",
    "loss": "lost light",
    "chord": "form",
}
_UNITS = {"um": "µm"}
_OTHER = {
    "nodes": "nodes per side",
    "nmse": "NMSE",
    "step_kb": "STEP (kB)",
    "triangles": "triangles",
    "inner_concave_mm": "smallest concave radius inside (mm)",
    "outer_concave_mm": "outside (mm)",
}

_PRESETS = {
    "rays": "rays",
    "table_rho": "radius (nm)",
    "table_normal": "normal (mrad)",
    "table_hit": "hit (mm)",
    "table_irradiance_nmse": "irradiance, NMSE",
    "noise_nmse": "ray noise, NMSE",
    "table_share": "table / noise",
    "efficiency_standard_error": "efficiency ±",
}
PRESET_HEAD = ["preset", *_PRESETS.values()]


def study_text(study: ConvergenceStudy) -> Iterator[str]:
    """The study's description, and its levels as a table."""
    other = list(dict.fromkeys(key for level in study.levels for key in level.other))
    orders = [_order(series, errors) for series, errors in study.order.items() if errors]
    yield from ("", f"### {study.title}", "", f"Set by `{study.knob}`. Reference: {study.reference}.")
    if orders:
        yield f"Measured order, the power of the setting: {'; '.join(orders)}."
    yield ""
    columns = [_headed(error, study.units) for error in study.units]
    head = ["method", "setting", "seconds", "MB", *columns, *(_OTHER.get(key, key) for key in other), "used by"]
    yield from table(head, [_cells(level, list(study.units), other) for level in study.levels])


def preset_text(presets: Mapping[Accuracy, PresetAccuracy]) -> Iterator[str]:
    """Errors of each preset in the search and in the evaluation, as a table."""
    yield from ("", "### Presets", "")
    yield from table(PRESET_HEAD, preset_rows(presets))


def table(head: list[str], rows: list[list[str]]) -> Iterator[str]:
    """A Markdown table."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"


def preset_rows(presets: Mapping[Accuracy, PresetAccuracy]) -> list[list[str]]:
    """Errors of each preset in design and in evaluation, under :data:`PRESET_HEAD`."""
    return [
        [f"{name}, {stage}", *(_plain(getattr(found, key)) for key in _PRESETS)]
        for name, preset in presets.items()
        for stage, found in (("design", preset.design), ("evaluation", preset.evaluation))
    ]


def _plain(value: Metric | float | None) -> str:
    return number(value.value if isinstance(value, Metric) else value, 3)


def _headed(error: str, units: dict[str, str]) -> str:
    unit = _UNITS.get(units[error], units[error])
    return _named(error) + (f" ({unit})" if unit else "")


def _named(error: str) -> str:
    return _NAMES.get(error, error)


def _order(series: str, found: Errors) -> str:
    return f"{series}: " + ", ".join(f"{_named(error)} {_metric(order)}" for error, order in found.items())


def _cells(level: RefinementLevel, errors: list[str], other: list[str]) -> list[str]:
    setting = NOTHING if level.reference and not level.setting else number(level.setting)
    used = "reference" if level.reference else "; ".join(level.used_by)
    costs = [number(level.seconds, 2), number(level.peak_mb, 2)]
    found = [_metric(level.errors[name]) for name in errors]
    return [level.series, setting, *costs, *found, *(number(level.other.get(key), 4) for key in other), used]


def _metric(metric: Metric | None) -> str:
    return NOTHING if metric is None else quantity(metric.value, "", metric.standard_error, 3)
