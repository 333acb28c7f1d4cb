"""Numbers as a reader wants them: rounded where digits mean nothing, with exponents as exponents."""

import math
from pathlib import Path

_THIN_SPACE = "\u2009"
_MINUS = "\u2212"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOTHING = "–"


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


def percent(share: float | None, decimals: int = 1) -> str:
    """``share`` in per cent."""
    return NOTHING if share is None else f"{100.0 * share:.{decimals}f}{_THIN_SPACE}%".replace("-", _MINUS)


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


def _grouped(digits: str) -> str:
    sign, digits = (_MINUS, digits[1:]) if digits.startswith("-") else ("", digits)
    return sign + (f"{int(digits):,}".replace(",", _THIN_SPACE) if len(digits) > 4 else digits)
