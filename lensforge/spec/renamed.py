"""Old names of spec fields, read for one version: each with the fields that took its place, and their values.

A spec with an old name is read, and a :class:`~lensforge.errors.RenamedWarning` says the new one, or that none
took its place.
"""

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from lensforge.errors import RenamedWarning


def _bound(name: str, unit: str, value: Any) -> dict[str, Any]:
    return {name: value, "unit": unit}


def _gone(value: Any) -> dict[str, Any]:
    return {}


def _whole_widths(unit: str, value: Any) -> dict[str, Any]:
    """Width, and height, of a flat top from its half widths; what is no number is left to its section."""
    halves = value if isinstance(value, list | tuple) else [value]
    sides = [2.0 * half if isinstance(half, int | float) else half for half in halves]
    return dict(zip((f"width_{unit}", f"height_{unit}"), sides, strict=False))


# By the class of the section, then by the old name.
RENAMED: dict[str, dict[str, Callable[[Any], dict[str, Any]]]] = {
    "LimitSection": {
        f"{name}_{unit}": partial(_bound, name, unit)
        for name in ("at_least", "at_most")
        for unit in ("w_per_m2", "lx", "w_per_sr", "cd", "relative")
    },
    "ManufactureSection": {"stepover_mm": _gone, "slope_limit_mrad": _gone},
    "OptimiseSection": {"learning_rate": _gone, "uniformity_steps": _gone},
    "ReceiverSection": {"pixel_aspect": _gone},
    "TolerancesSection": {"waviness_exponent": _gone},
    "FlatTopTarget": {f"half_width_{unit}": partial(_whole_widths, unit) for unit in ("mm", "deg")},
}


def with_new_names(section: str, content: Any) -> Any:
    """The table ``content`` of a section class by the names of its fields now; anything else as it is.

    Raises ``ValueError`` where an old name and a field beside it say two things.
    """
    old_names = RENAMED.get(section, {})
    if not isinstance(content, Mapping) or not any(name in old_names for name in content):
        return content
    table = {name: value for name, value in content.items() if name not in old_names}
    for old, value in content.items():
        if old not in old_names or value is None:
            continue
        new = old_names[old](value)
        if not new:
            warnings.warn(f"{old} is read no more, and goes with the next version", RenamedWarning, stacklevel=2)
            continue
        for name, implied in new.items():
            if table.setdefault(name, implied) != implied:
                raise ValueError(f"{old} = {value} does not go with {name} = {table[name]}; give one of them")
        words = ", ".join(
            f'{name} = "{given}"' if isinstance(given, str) else f"{name} = {given}" for name, given in new.items()
        )
        warnings.warn(f"{old} is an old name, read in this version only: write {words}", RenamedWarning, stacklevel=2)
    return table
