"""Old names of spec fields, read for one version: each with the fields that took its place, and their values.

A spec with an old name is read, and a :class:`~lensforge.errors.RenamedWarning` says the new one, or that none
took its place.
"""

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from lensforge.errors import RenamedWarning
from lensforge.optics.media import DOUBLE


def _bound(name: str, unit: str, value: Any) -> dict[str, object]:
    return {name: value, "unit": unit}


def _whole_widths(unit: str, value: Any) -> dict[str, object]:
    """Width, and height, of a flat top from its half widths; what is no number is left to its section."""
    halves = value if isinstance(value, list | tuple) else [value]
    sides = [2.0 * half if isinstance(half, int | float) else half for half in halves]
    return dict(zip((f"width_{unit}", f"height_{unit}"), sides, strict=False))


_OF_ROADS = ("pole_height_m", "pole_spacing_m", "road_width_m", "overhang_m", "maintenance_factor")
_FIELDS = ("concave_radius_mm", "draft_deg")
_ERRORS = ("form_um", "waviness_um", "ripple_um", "roughness_mrad")
_OF_LENS = {
    old: f"{face}.{new}"
    for face in DOUBLE
    for old, new in (
        (f"{face}_offset_mm", "offset_mm"), (f"fixed_{face}", "fixed"), (f"{face}_coating", "coating"),
    )
}  # fmt: skip
# Fields that stand in the table of a face now, by their dotted names in a spec.
MOVED = {
    **{f"lens.{old}": f"lens.{new}" for old, new in _OF_LENS.items()},
    **{f"constraints.{face}_{name}": f"lens.{face}.{name}" for face in DOUBLE for name in _FIELDS},
    **{f"tolerances.{face}_{name}": f"lens.{face}.{name}" for face in DOUBLE for name in _ERRORS},
    **{f"tolerances.outer_{name}": f"lens.outer.{name}" for name in ("shift_mm", "tilt_deg")},
    "tolerances.gap_mm": "lens.outer.gap_mm",
}
# By the class of the section and the old name: the new one, None where none took its place, or a function of the value.
RENAMED: dict[str, Mapping[str, str | Callable[[Any], dict[str, object]] | None]] = {
    "LensFaces": _OF_LENS,
    "LimitSection": {
        f"{name}_{unit}": partial(_bound, name, unit)
        for name in ("at_least", "at_most")
        for unit in ("w_per_m2", "lx", "w_per_sr", "cd", "relative")
    },
    "ManufactureSection": {"stepover_mm": None, "slope_limit_mrad": None},
    "OptimiseSection": {"learning_rate": None, "uniformity_steps": None},
    "PhotometrySection": dict.fromkeys(_OF_ROADS),
    "ReceiverSection": {"pixel_aspect": None},
    "Spec": MOVED,
    "TolerancesSection": {"waviness_exponent": None},
    "FlatTopTarget": {f"half_width_{unit}": partial(_whole_widths, unit) for unit in ("mm", "deg")},
}


def with_new_names(section: str, content: Any) -> Any:
    """The table ``content`` of a section class by the names of its fields now; anything else as it is.

    Names may be dotted: of fields in tables within it. Raises ``ValueError`` where an old name and a field beside it
    say two things.
    """
    for old, replacement in RENAMED.get(section, {}).items():
        content, value = _without(content, old)
        if value is None:
            continue
        new = replacement(value) if callable(replacement) else {replacement: value} if replacement else {}
        for name, implied in new.items():
            _, before = _without(content, name)
            if before not in (None, implied):
                raise ValueError(f"{_words(old, value)} does not go with {_words(name, before)}; give one of them")
            content = _with(content, name, implied)
        words = ", ".join(map(_words, new, new.values()))
        said = f"is an old name, read in this version only: write {words}"
        gone = f"{_NO_MORE}; a road is one of [[roads]]" if old in _OF_ROADS else _NO_MORE
        warnings.warn(f"{old} {said if new else gone}", RenamedWarning, stacklevel=2)
    return content


_NO_MORE = "is read no more, and goes with the next version"


def _without(content: Any, name: str) -> tuple[Any, Any]:
    """``content`` without the field of a dotted name, and the value that it had; None where it had none."""
    first, _, rest = name.partition(".")
    if not isinstance(content, Mapping) or first not in content:
        return content, None
    others = {key: value for key, value in content.items() if key != first}
    if not rest:
        return others, content[first]
    inside, value = _without(content[first], rest)
    return (content, None) if inside is content[first] else ({**content, first: inside}, value)


def _with(content: Any, name: str, value: Any) -> dict[str, object]:
    """``content`` with a field of a dotted name, in new tables where it has none."""
    if not isinstance(content, Mapping):
        raise ValueError(f"{_words(name, value)}: give it in {str(content)[:60]!r}")
    first, _, rest = name.partition(".")
    return {**content, first: _with(content.get(first) or {}, rest, value) if rest else value}


def _words(name: str, value: Any) -> str:
    if isinstance(value, Mapping):
        return f"[{name}]"
    return f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value}"
