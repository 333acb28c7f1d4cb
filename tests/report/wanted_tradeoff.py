"""Numbers that the page and the screen of a trade-off must show, by their label, each from its level or preset."""

from shown_numbers import shown, with_error

_ERRORS = {
    "efficiency": "efficiency", "hit_99_percent": "hit, 99th percentile", "irradiance_nmse": "irradiance, NMSE",
    "chord": "form", "normal": "normal", "nmse_shift": "NMSE shifted by", "loss": "lost light",
}  # fmt: skip
_OTHER = {"triangles": "triangles", "step_kb": "STEP (kB)", "inner_concave_mm": "smallest concave radius inside (mm)"}
_UNITS = {"um": "µm"}
# Column, its unit in the record, and the field of a preset's stage.
_PRESETS = (
    ("rays", None, "rays"), ("radius (nm)", "nm", "table_rho"), ("normal (mrad)", "mrad", "table_normal"),
    ("hit (mm)", "mm", "table_hit"), ("irradiance, NMSE", "", "table_irradiance_nmse"),
    ("ray noise, NMSE", None, "noise_nmse"), ("table / noise", None, "table_share"),
    ("efficiency ±", None, "efficiency_standard_error"),
)  # fmt: skip
_NONE = "–"


def tradeoff_numbers(found):
    """Entries of the page."""
    words = "--accuracy draft, seed {}; measured in {} s on {} threads."
    yield shown("p", words, found.lens.seed, found.seconds, found.threads)
    for name, preset in found.presets.items():
        for stage, each in (("design", preset.design), ("evaluation", preset.evaluation)):
            yield from _preset(f"Presets / {name}, {stage}", each)
    for study in found.studies.values():
        yield from _study(study)
        last = study.title
    yield shown(f"{last} / footer", f"Written by lensforge {found.version}.")


def _preset(row, stage):
    for column, unit, field in _PRESETS:
        value = getattr(stage, field)
        if value is not None and unit is not None:
            assert value.unit == unit, f"{field}: the page says {unit}"
            value = value.value
        yield _or_none(f"{row} / {column}", value)


def _or_none(label, value):
    return shown(label, _NONE) if value is None else shown(label, "{}", value)


def _study(study):
    yield shown(f"{study.title} / p", f"Set by {study.knob}. Reference: {study.reference}.")
    for series, orders in study.order.items():
        for number, (error, order) in enumerate(orders.items()):
            before = f"{series}: " if number == 0 else ", "
            yield with_error(f"{study.title} / p", order).after(f"{before}{_ERRORS[error]} ")
    units = {name: error.unit for name, error in study.levels[0].errors.items()}
    columns = {name: _ERRORS[name] + (f" ({_UNITS.get(unit, unit)})" if unit else "") for name, unit in units.items()}
    if "hit_99_percent" in columns:
        yield shown(f"{study.title} / columns", "hit, 99th percentile (mm)")
        against = "time" if study.against == "seconds" else "setting"
        title = f"Hit, 99th percentile against {against}"
        yield shown(f"{study.title} / {title} / title", title)
    for level in study.levels:
        yield from _level(f"{study.title} / {level.series}", level, columns, study)


def _level(row, level, columns, study):
    yield _or_none(f"{row} / setting", None if level.reference else level.setting)
    yield _or_none(f"{row} / seconds", level.seconds)
    yield _or_none(f"{row} / MB", level.peak_mb)
    for name, column in columns.items():
        yield with_error(f"{row} / {column}", level.errors[name])
    for name in {name: None for each in study.levels for name in each.other}:
        yield _or_none(f"{row} / {_OTHER[name]}", level.other.get(name))
    yield shown(f"{row} / used by", "reference" if level.reference else "; ".join(level.used_by))


def tradeoff_lines(found):
    """Entries of the screen."""
    title = "Error of each preset on this scene"
    for name, preset in found.presets.items():
        for words, stage in (("search", preset.design), ("evaluation", preset.evaluation)):
            text = f"{words}: {{}} rays, noise adds an NMSE of {{}}"
            label, tables = f"{title} / {name}", stage.table_irradiance_nmse
            if tables is None:
                yield shown(label, text, stage.rays, stage.noise_nmse)
            else:
                values = (stage.rays, stage.noise_nmse, tables.value, tables.standard_error)
                yield shown(label, f"{text}, the tables {{}} ± {{}}", *values)
