"""The unit of a number in a record, read from the names that lead to it: ``form_error_nm.max`` is in nm."""

from collections.abc import Sequence

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


def unit_of(names: Sequence[str]) -> str:
    """The unit of the value at the path ``names``, outermost name first; ``""`` for a pure number.

    The innermost name that says anything decides: ``min`` in ``draft_deg`` is an angle, ``area_fraction`` is not.
    """
    for name in reversed(names):
        unit = _stated(name)
        if unit is not None:
            return unit
    return DIMENSIONLESS


def _stated(name: str) -> str | None:
    if name in _WHOLE_NAMES:
        return _WHOLE_NAMES[name]
    for suffix, unit in _SUFFIXES:
        if name.endswith(suffix):
            return unit
    return DIMENSIONLESS if any(word in name for word in _PURE_NUMBERS) else None
