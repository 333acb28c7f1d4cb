"""Numbers and units for a page: rounded, with typographic exponents; the unit of a value by its path in a record."""

import math
from collections.abc import Sequence
from pathlib import Path

from lensforge.light.evaluation_result import Light
from lensforge.results import Metric
from lensforge.results.chart import LightUnit, light_unit
from lensforge.results.digits import decimals_by_error
from lensforge.runs.results import Results
from lensforge.search.design_result import Design

_THIN_SPACE = "\u2009"
_MINUS = "\u2212"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOTHING = "–"
DIMENSIONLESS = ""

# The longest suffix first: `_per_mm` ends in `_mm` too, `_lm_per_w` in `_w`.
_SUFFIXES = (
    ("_lm_per_w", "lm/W"),
    ("_per_mm", "1/mm"),
    ("_seconds", "s"),
    ("_pixel2", "pixel²"),
    ("_mrad", "mrad"),
    ("_w_m2", "W/m²"),
    ("_mm3", "mm³"),
    ("_mm2", "mm²"),
    ("_rad", "rad"),
    ("_deg", "°"),
    ("_mm", "mm"),
    ("_um", "µm"),
    ("_nm", "nm"),
    ("_lm", "lm"),
    ("_cd", "cd"),
    ("_px", "pixel"),
    ("_w", "W"),
)
_WHOLE_NAMES = {
    "seconds": "s",
    "bytes": "B",
    "filter_variance": "pixel²",
    "rate": "1/s",
    "lumens": "lm",
    "watts": "W",
    "lumens_per_watt": "lm/W",
}
_PURE_NUMBERS = ("fraction", "share", "count", "nmse", "efficiency")


def number(value: float | None, digits: int = 6) -> str:
    """``value`` to ``digits`` significant digits; an integer in full, in groups of three."""
    if value is None or math.isnan(value):
        return NOTHING
    if isinstance(value, int) or (float(value).is_integer() and abs(value) < 1e6):
        return _grouped(f"{int(value)}")
    text = f"{value:.{digits}g}"
    if 10**digits <= abs(float(text)) < 1e6:
        return _grouped(f"{int(float(text))}")
    mantissa, _, exponent = text.partition("e")
    mantissa = mantissa.replace("-", _MINUS)
    if not exponent:
        return mantissa
    return f"{mantissa}{_THIN_SPACE}×{_THIN_SPACE}10{str(int(exponent)).translate(_SUPERSCRIPTS)}"


def number_with_error(metric: Metric | None, digits: int) -> str:
    """Value to at most ``digits`` significant digits and, where it is known and not 0, its standard error to one.

    The value has no digit beyond that of the error.
    """
    if metric is None:
        return NOTHING
    if not metric.standard_error:
        return number(metric.value, digits)
    kept = round(metric.value, decimals_by_error(metric.standard_error, 1))
    return f"{number(kept, digits)} ± {number(metric.standard_error, 1)}"


def percent(share: float | None, decimals: int = 1) -> str:
    """``share`` in per cent."""
    return NOTHING if share is None else f"{100.0 * share:.{decimals}f}{_THIN_SPACE}%".replace("-", _MINUS)


def percent_with_error(share: Metric) -> str:
    """A share in per cent and, where it is known and not 0, its standard error."""
    error = f" ± {percent(share.standard_error, 3)}" if share.standard_error else ""
    return f"{percent(share.value)}{error}"


def size(count: int) -> str:
    """A file size in decimal units."""
    for unit, scale in (("MB", 1e6), ("kB", 1e3)):
        if count >= scale:
            return f"{count / scale:.3g}{_THIN_SPACE}{unit}"
    return f"{count}{_THIN_SPACE}B"


def anything(value: object) -> str:
    """Any scalar of a spec or a JSON file; a path by its name."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Path):
        return value.name
    return number(value) if isinstance(value, int | float) else str(value)


def unit_of(names: Sequence[str]) -> str:
    """The unit of the value at the path ``names``, outermost name first; ``""`` for a pure number.

    The innermost name that implies a unit decides: ``form_error_nm.max`` is in nm, ``draft_deg.min`` in degrees, and
    ``draft_deg.area_fraction`` is a pure number.
    """
    for name in reversed(names):
        unit = _stated(name)
        if unit is not None:
            return unit
    return DIMENSIONLESS


def unit_of_light(results: Results, *, far_field: bool | None = None) -> LightUnit:
    """Lux or candela where the luminous efficacy of the source is known, else W/m^2 or W/sr.

    ``far_field``: by default as the first receiver is.
    """
    light, design = results.find(Light), results.find(Design)
    if far_field is None:
        far_field = results.spec.all_receivers[0].kind == "far_field"
    if light is not None:
        return light_unit(light.lumens_per_watt, far_field=far_field)
    return light_unit(None if design is None else design.source.lumens_per_watt, far_field=far_field)


def _grouped(digits: str) -> str:
    sign, digits = (_MINUS, digits[1:]) if digits.startswith("-") else ("", digits)
    return sign + (f"{int(digits):,}".replace(",", _THIN_SPACE) if len(digits) > 4 else digits)


def _stated(name: str) -> str | None:
    if name in _WHOLE_NAMES:
        return _WHOLE_NAMES[name]
    for suffix, unit in _SUFFIXES:
        if name.endswith(suffix):
            return unit
    return DIMENSIONLESS if any(word in name for word in _PURE_NUMBERS) else None
