"""Values that follow from the size of source, target and lens where a spec leaves them out.

The rules are those of the shipped specs, rounded to three digits; what they cost against values that were chosen by
hand is in docs/results.md. A value that is given is never touched.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, hypot, inf, log10
from typing import Any

from pydantic import BaseModel

_CAVITY = 1.2  # radius of the cavity over that of the circle around the source: shipped specs have 1.13 to 1.41
_CAVITY_LEAST = 0.02  # of the largest radius: around a point source
CAVITY_HEIGHT = 0.6  # height of the cavity over its radius
_WALL, _WALL_MOST = 0.27, 0.15  # of the root of the largest radius (mm); at most this share of it
_INNER, _OUTER = 0.43, 0.98  # hemispheres over the largest radius
_AROUND_CAVITY = 1.05  # least inner hemisphere over the cavity
_RECEIVER = 1.5  # side of the receiver over the pattern
_HALF_ANGLE, _MOST_HALF_ANGLE_DEG = 4.0 / 3.0, 85.0  # over the beam; and where that is not known
_AREAS = ("square", "disc", "rectangle", "chip_array")
_ACROSS = ("width_mm", "diameter_mm", "length_mm", "outer_diameter_mm")
_LARGEST_MM = 1e9  # of any length of a spec
_MOST_PLACES = 300  # digits behind the point: ten to this power is a number yet, also for the smallest length
_GLYPH = 1.6  # height of a narrow glyph over its width

WHY = {
    "constraints.cavity_radius_mm": f"{_CAVITY:g} x the circle around the source",
    "constraints.cavity_height_mm": f"{CAVITY_HEIGHT:g} x cavity_radius_mm",
    "constraints.min_thickness_mm": f"{_WALL:g} x the root of max_radius_mm",
    "lens.inner_offset_mm": f"{_INNER:g} x max_radius_mm: the search starts from this hemisphere",
    "lens.outer_offset_mm": f"{_OUTER:g} x max_radius_mm",
    "target.receiver_mm": f"{_RECEIVER:g} x the pattern",
    "target.half_angle_deg": "4/3 x the beam, of beam and batwing",
}


@dataclass(frozen=True)
class LensSizes:
    """Cavity, wall and starting hemispheres (mm) of a lens of ``max_radius_mm`` around a source of some radius."""

    max_radius_mm: float
    reach_mm: float
    height_mm: float = 0.0

    @property
    def cavity_radius_mm(self) -> float:
        """Radius of the cavity."""
        return _digits(max(_CAVITY * self.reach_mm, _CAVITY_LEAST * self.max_radius_mm), ceil)

    @property
    def cavity_height_mm(self) -> float:
        """Height of the cavity, above a source that is raised."""
        return _digits(CAVITY_HEIGHT * self.cavity_radius_mm + max(self.height_mm, 0.0), ceil)

    @property
    def min_thickness_mm(self) -> float:
        """Least wall."""
        return _digits(min(_WALL * self.max_radius_mm**0.5, _WALL_MOST * self.max_radius_mm))

    @property
    def outer_offset_mm(self) -> float:
        """Outer hemisphere."""
        return _digits(_OUTER * self.max_radius_mm, floor)

    @property
    def inner_offset_mm(self) -> float:
        """Inner hemisphere: around the cavity, and with some wall."""
        wanted = max(_INNER * self.max_radius_mm, _AROUND_CAVITY * self.cavity_radius_mm)
        return _digits(min(wanted, self.outer_offset_mm - 1.5 * self.min_thickness_mm), floor)


def with_derived(content: Mapping[str, Any]) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """The sections of a spec with derived values for what they leave out, and the names of these values.

    A section that is an object becomes a table where something is filled in.
    """
    filled = {key: dict(value) if isinstance(value, Mapping) else value for key, value in content.items()}
    names: list[tuple[str, str]] = []
    limits = filled.get("constraints")
    largest = _number(limits, "max_radius_mm")
    source = filled.get("source")
    # A spec without its size, or that of its source, is refused for that alone: any other values do.
    place = _reach(source) or ((0.0, 0.0) if _get(source, "kind") in _AREAS else None)
    sizes = LensSizes(largest or 1.0, *(place or (0.0, 0.0)))
    lens = filled.setdefault("lens", {})
    if isinstance(lens, dict | BaseModel):
        for side in ("inner", "outer"):
            if _get(lens, f"fixed_{side}") is None:
                _fill(filled, names, "lens", f"{side}_offset_mm", getattr(sizes, f"{side}_offset_mm"))
    if isinstance(limits, dict | BaseModel):
        _fill(filled, names, "constraints", "min_thickness_mm", sizes.min_thickness_mm)
        if place is not None:
            _fill(filled, names, "constraints", "cavity_radius_mm", sizes.cavity_radius_mm)
            _fill(filled, names, "constraints", "cavity_height_mm", sizes.cavity_height_mm)
    target = filled.get("target")
    if isinstance(target, dict | BaseModel):
        receiver = _receiver_of(target)
        if receiver is not None:
            _fill(filled, names, "target", *receiver)
    if "lens" not in content:
        names.append(("", "lens"))
    return filled, names


def _fill(filled: dict[str, Any], names: list[tuple[str, str]], section: str, name: str, value: float) -> None:
    if _given(filled[section], name) is None:
        filled[section] = {**_table(filled[section]), name: value}
        names.append((section, name))


def _reach(source: Any) -> tuple[float, float] | None:
    """Radius (mm) of the circle about the axis that holds an emitting area, and its height; None for a ray set."""
    extent = _source_extent(source)
    if extent is None:
        return None
    x, y, z = _triple(_get(source, "position_mm"))
    return extent + hypot(x, y), z


def _source_extent(source: Any) -> float | None:
    """Radius (mm) of the circle around an emitting area, in its own plane; None for a ray set."""
    side, width, height, diameter = (
        _number(source, name) for name in ("side_mm", "width_mm", "height_mm", "diameter_mm")
    )
    kind = _get(source, "kind")
    if kind == "square":
        return None if side is None else side / 2.0**0.5
    if kind == "disc":
        return None if diameter is None else 0.5 * diameter
    if width is None or height is None or kind not in ("rectangle", "chip_array"):
        return None
    if kind == "chip_array":
        columns, rows = (_number(source, name) or 1.0 for name in ("columns", "rows"))
        across, up, _ = _triple(_get(source, "pitch_mm"))
        width, height = (columns - 1.0) * across + width, (rows - 1.0) * up + height
    return 0.5 * hypot(width, height)


def _given(section: Any, name: str) -> Any:
    """The value that the user gave as ``name``: a section of another spec holds what was derived there, too."""
    return None if isinstance(section, BaseModel) and name not in section.model_fields_set else _get(section, name)


def _table(section: Any) -> dict[str, Any]:
    if not isinstance(section, BaseModel):
        return dict(section)
    names = [name for name in type(section).model_fields if name in section.model_fields_set or name == "kind"]
    return {name: getattr(section, name) for name in names}


def _receiver_of(target: Any) -> tuple[str, float] | None:
    """Name and value of the receiver that a target leaves out; None where it has one, or its size is not known."""
    if _number(target, "distance_mm") is not None:
        across = _pattern_mm(target)
        return None if across is None else ("receiver_mm", _digits(_RECEIVER * across, ceil))
    if _get(target, "kind") not in ("beam", "batwing", "photometric") or _get(target, "receiver_mm") is not None:
        return None
    widths = _sizes(_get(target, "fwhm_deg") or _get(target, "to_deg"))
    wide = _HALF_ANGLE * max(widths) if widths else _MOST_HALF_ANGLE_DEG
    return "half_angle_deg", min(_digits(wide, ceil), _MOST_HALF_ANGLE_DEG)


def _pattern_mm(target: Any) -> float | None:
    """Side (mm) of the square about the axis that holds a pattern."""
    sides = [value for name in _ACROSS if (value := _number(target, name)) is not None]
    if sides and (pitch := _number(target, "pitch_mm")) is not None:
        sides = [sides[0] + (max(_number(target, name) or 1.0 for name in ("columns", "rows")) - 1.0) * pitch]
    sides += [2.0 * each for each in _sizes(_get(target, "half_width_mm"))]  # its old name
    if not sides:
        return None
    up = _number(target, "height_mm")
    if up is None and isinstance(text := _get(target, "text"), str) and text:
        up = _GLYPH * sides[0] / len(text)
    across = max(*sides, up or 0.0)
    turned = hypot(across, up or across) if _number(target, "rotation_deg") else across
    x, y, _ = _triple(_get(target, "centre_mm"))
    return turned + 2.0 * max(abs(x), abs(y))


def rounded_length(value_mm: float) -> float:
    """A length that something has to fit into, rounded up to three digits."""
    return _digits(value_mm, ceil)


def _get(table: Any, name: str) -> Any:
    return table.get(name) if isinstance(table, Mapping) else getattr(table, name, None)


def _number(table: Any, name: str) -> float | None:
    """A number from 0 on, as its section would read it; None for anything else, which that refuses."""
    try:
        value = float(_get(table, name))
    except (TypeError, ValueError, OverflowError):
        return None
    return value if 0.0 <= value <= _LARGEST_MM else None


def _sizes(values: Any) -> list[float]:
    """The numbers above 0 among one or several values."""
    several = values if isinstance(values, list | tuple) else [values]
    return [size for each in several if (size := _number({"": each}, ""))]


def _triple(values: Any) -> tuple[float, float, float]:
    """Coordinates, 0 for those that are left out or that their section will refuse."""
    several = values if isinstance(values, list | tuple) else ()
    known = [float(each) if isinstance(each, int | float) and abs(each) <= _LARGEST_MM else 0.0 for each in several]
    x, y, z = (*known, 0.0, 0.0, 0.0)[:3]
    return x, y, z


def _digits(value: float, towards: Any = round) -> float:
    """``value`` to three significant digits."""
    if not 0.0 < value < inf:
        return value
    places = min(2 - floor(log10(value)), _MOST_PLACES)
    return float(round(towards(round(value * 10.0**places, 6)) / 10.0**places, 12))
