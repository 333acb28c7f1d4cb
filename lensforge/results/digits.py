"""Digits of a printed number: as many as its standard error carries."""

from math import floor, log10

_MOST_DECIMALS = 7  # smaller errors are written with an exponent


def by_error(value: float, error: float, digits: int = 2) -> tuple[str, str]:
    """``value`` and ``error`` (above 0) as texts that end at the same decimal: that of the error's last of ``digits``.

    "0.0123" and "0.0012"; "1230" and "120"; "1.23e-10" and "1.2e-11".
    """
    decimals = decimals_by_error(error, digits)
    kept = round(value, decimals) + 0.0  # no minus zero
    if decimals <= _MOST_DECIMALS:
        shown = max(decimals, 0)
        return f"{kept:.{shown}f}", f"{round(error, decimals):.{shown}f}"
    size = floor(log10(abs(kept))) if kept else -decimals
    return f"{kept:.{size + decimals}e}", f"{error:.{digits - 1}e}"


def decimals_by_error(error: float, digits: int = 2) -> int:
    """Decimals up to the last of the first ``digits`` significant digits of ``error``, once rounded to them."""
    return digits - 1 - floor(log10(float(f"{error:.{digits - 1}e}")))
