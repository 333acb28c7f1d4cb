"""Numbers as text: the one formatter of pages, screens, drawings and messages, and the unit of a record's value.

A number with a standard error ends at the second digit of that error (GUM 7.2.6), but has five significant digits at
most: the flux of an LED is known to some per cent. Any other has a few significant digits. Groups of three are parted
by a thin space (ISO 80000-1), which a screen shows as a plain one.
"""

import math
from collections.abc import Sequence
from pathlib import Path

NOTHING = "–"  # in the place of a value that is not known
_THIN_SPACE = "\u2009"
_MINUS = "\u2212"
_SIGNS = {"<=": "≤", ">=": "≥"}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Beyond these a number is written with an exponent.
_LARGEST_PLAIN = 1e6
_MOST_DECIMALS = 7

# Units by the end of a name, the longest end first: `_per_mm` ends in `_mm` too, `_lm_per_w` in `_w`.
_SUFFIXES = {
    "_w_per_m2_sr": "W/(m² sr)", "_cd_per_m2": "cd/m²", "_lm_per_w": "lm/W", "_w_per_m2": "W/m²",
    "_mw_per_cm2": "mW/cm²", "_mj_per_cm2": "mJ/cm²", "_umol_per_m2_s": "µmol/(m² s)", "_w_per_sr": "W/sr",
    "_g_per_cm3": "g/cm³",
    "_per_mm": "1/mm", "_per_sr": "1/sr", "_per_k": "1/K", "temperature_c": "°C", "_percent": "%", "_seconds": "s",
    "_pixel2": "pixel²", "_mrad": "mrad", "_urad": "µrad", "_mm3": "mm³", "_mm2": "mm²",
    "temperature_k": "K", "exposure_s": "s", "_rad": "rad", "_deg": "°",
    "_mm": "mm", "_um": "µm", "_nm": "nm", "_lm": "lm", "_lx": "lx", "_cd": "cd", "_px": "pixel", "_m": "m", "_w": "W",
}  # fmt: skip
_WHOLE_NAMES = {
    "seconds": "s",
    "hours": "h",
    "bytes": "B",
    "filter_variance": "pixel²",
    "rate": "1/s",
    "lumens": "lm",
    "watts": "W",
    "lumens_per_watt": "lm/W",
    "uniformity_lx": "",  # of illuminance: a ratio
}
_PURE_NUMBERS = ("fraction", "share", "count", "nmse", "efficiency")


def number(value: float | None, digits: int = 6) -> str:
    """``value`` to ``digits`` significant digits; a whole number in full, in groups of three."""
    if value is None or math.isnan(value):
        return NOTHING
    if isinstance(value, int) or (float(value).is_integer() and abs(value) < _LARGEST_PLAIN):
        return _grouped(f"{int(value)}")
    text = f"{value:.{digits}g}"
    if 10**digits <= abs(float(text)) < _LARGEST_PLAIN:
        return _grouped(f"{int(float(text))}")
    return _typeset(text)


def quantity(value: float | None, unit: str = "", error: float | None = None, digits: int = 6) -> str:
    """``value`` with its ``unit`` and, where it is known and not 0, its standard ``error``."""
    if value is None:
        return NOTHING
    if not error:
        return with_unit(number(value, digits), unit)
    return with_unit(" ± ".join(by_error(value, error)), unit)


def square(value: float, error: float | None = None, digits: int = 6) -> str:
    """A mean square with its standard ``error``; "≤" the error if subtracting noise left it negative."""
    if value < 0.0 and error:
        return f"≤ {number(error, 2)}"
    return quantity(value, "", error, digits)


_PLAIN = 4  # digits before the point of a number that is never written as a power of ten
_MOST_DIGITS = 5  # of a measured value: no source is known to more


def by_error(value: float, error: float) -> tuple[str, str]:
    """``value`` and ``error`` (above 0) to the second digit of the error: "0.0123" and "0.0012"; "1230" and "120".

    A value has five significant digits at most: "0.98765" and "1.2 × 10⁻⁷".
    """
    decimals = 1 - math.floor(math.log10(float(f"{error:.1e}")))
    rounded = float(f"{value:.{_MOST_DIGITS - 1}e}")
    if rounded and decimals > (most := _MOST_DIGITS - 1 - math.floor(math.log10(abs(rounded)))):
        plain = 1e-3 <= abs(rounded) < _LARGEST_PLAIN
        text = f"{rounded:.{max(most, 0)}f}" if plain else f"{rounded:.{_MOST_DIGITS - 1}e}"
        return _typeset(text), _typeset(f"{error:.2g}")
    rounded = round(value, decimals) + 0.0  # no minus zero
    if decimals <= _MOST_DECIMALS:
        shown = max(decimals, 0)
        return _typeset(f"{rounded:.{shown}f}"), _typeset(f"{round(error, decimals):.{shown}f}")
    size = math.floor(math.log10(abs(rounded))) if rounded else -decimals
    if -2 <= size < _PLAIN:  # 92.30055217, 0.0923: no one reads these as powers of ten
        return _typeset(f"{rounded:.{decimals}f}"), _typeset(f"{error:.1e}")
    return _typeset(f"{rounded:.{size + decimals}e}"), _typeset(f"{error:.1e}")


def limit_text(sense: str, value: float, unit: str = "", digits: int = 4) -> str:
    """A limit with its sign: ``sense`` "<=" or ">=", and the permitted ``value`` in ``unit``."""
    return f"{_SIGNS[sense]} {quantity(value, unit, digits=digits)}"


def with_unit(text: str, unit: str) -> str:
    """A number's text before its unit."""
    gap = {"": "", "°": "", "%": _THIN_SPACE}.get(unit, " ")
    return f"{text}{gap}{unit}"


def percent(share: float | None, digits: int = 3) -> str:
    """``share`` in per cent."""
    return NOTHING if share is None else quantity(100.0 * share, "%", digits=digits)


def size(count: int) -> str:
    """A file size in decimal units."""
    for unit, scale in (("MB", 1e6), ("kB", 1e3)):
        if count >= scale:
            return f"{count / scale:.3g}{_THIN_SPACE}{unit}"
    return f"{count}{_THIN_SPACE}B"


def anything(value: object) -> str:
    """Any scalar of a spec or a record; a path by its name."""
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
    a ``share`` within such a field is a pure number.
    """
    for name in reversed(names):
        if (unit := unit_in(name)) or any(word in name for word in _PURE_NUMBERS):
            return unit
    return ""


def unit_in(name: str) -> str:
    """The unit in the name of a field; ``""`` without one."""
    return _WHOLE_NAMES.get(name, _SUFFIXES.get(_suffix_of(name), ""))


def without_unit(name: str) -> str:
    """The name of a field less the unit at its end: "pole_spacing" of ``pole_spacing_m``."""
    end = _suffix_of(name) if unit_in(name) else ""
    return name.removesuffix(end[end.find("_") :])


def _suffix_of(name: str) -> str:
    return next((end for end in _SUFFIXES if name.endswith(end)), "")


_POWERS_OF_A_METRE = {"nm": -9, "um": -6, "µm": -6, "mm": -3, "m": 0}


def converted(value: float, unit: str, wanted: str) -> float:
    """``value`` converted from ``unit`` to ``wanted`` if both are lengths; else unchanged."""
    powers = _POWERS_OF_A_METRE
    if unit == wanted or unit not in powers or wanted not in powers:
        return value
    return value * 10.0 ** (powers[unit] - powers[wanted])


def _typeset(text: str) -> str:
    """A number as Python writes it, with a real minus, a power of ten, and groups of three from five digits on."""
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return _grouped(mantissa)
    power = str(int(exponent)).translate(_SUPERSCRIPTS)
    return f"{mantissa.replace('-', _MINUS)}{_THIN_SPACE}×{_THIN_SPACE}10{power}"


def _grouped(digits: str) -> str:
    sign, digits = (_MINUS, digits[1:]) if digits.startswith("-") else ("", digits)
    whole, point, decimals = digits.partition(".")
    grouped = f"{int(whole):,}".replace(",", _THIN_SPACE) if len(whole) > 4 else whole
    return f"{sign}{grouped}{point}{decimals}"
