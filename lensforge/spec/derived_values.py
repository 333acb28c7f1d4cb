"""Values that follow from the size of source, target and lens where a spec leaves them out.

The rules are those of the shipped specs, rounded to three digits; what they cost against values that were chosen by
hand is in benchmarks/README.md. A value that is given is never touched.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, hypot, log10
from typing import Any

_CAVITY = 1.2  # radius of the cavity over that of the circle around the source: shipped specs have 1.13 to 1.41
_CAVITY_LEAST = 0.02  # of the largest radius: around a point source
CAVITY_HEIGHT = 0.6  # height of the cavity over its radius
_WALL = 0.27  # of the root of the largest radius (mm)
_WALL_MOST = 0.15  # at most this share of it
_RECEIVER = 1.5  # side of the receiver over the pattern
_HALF_ANGLE = 4.0 / 3.0  # over the beam
_MOST_HALF_ANGLE_DEG = 85.0  # and where that is not known
_MOST_PLACES = 300  # digits behind the point: ten to this power is a number yet, also for the smallest length

# Words for each rule by the dotted name of its field; a kind of lens adds those of its faces.
WHY = {
    "constraints.cavity_radius_mm": f"{_CAVITY:g} x the circle around the source",
    "constraints.cavity_height_mm": f"{CAVITY_HEIGHT:g} x cavity_radius_mm",
    "constraints.min_thickness_mm": f"{_WALL:g} x the root of max_radius_mm",
    "target.receiver_mm": f"{_RECEIVER:g} x the pattern",
    "target.half_angle_deg": "4/3 x the beam, of beam and batwing",
}


@dataclass(frozen=True)
class LensSizes:
    """Cavity and wall (mm) of a lens of ``max_radius_mm`` around a source of some radius."""

    max_radius_mm: float
    reach_mm: float
    height_mm: float = 0.0

    @property
    def cavity_radius_mm(self) -> float:
        """Radius of the cavity."""
        return three_digits(max(_CAVITY * self.reach_mm, _CAVITY_LEAST * self.max_radius_mm), ceil)

    @property
    def cavity_height_mm(self) -> float:
        """Height of the cavity, above a source that is raised."""
        return three_digits(CAVITY_HEIGHT * self.cavity_radius_mm + max(self.height_mm, 0.0), ceil)

    @property
    def min_thickness_mm(self) -> float:
        """Least wall."""
        return three_digits(min(_WALL * self.max_radius_mm**0.5, _WALL_MOST * self.max_radius_mm))


def derived_sizes(sources: Sequence[Any], lens: Any, limits: Any, target: Any) -> dict[str, dict[str, Any]]:
    """Values of fields that the spec leaves out, by the rules, in tables by section and face.

    The arguments are the sections of a spec, ``target`` may be None. The cavity has room for each of the ``sources``.
    Of a source that states no size, such as a ray file, the cavity is not known, and of a target without one its
    receiver.
    """
    reaches = list(map(_reach_mm, sources))
    heights = [source.position_mm[2] for source in sources]
    if None in reaches:
        sizes = LensSizes(limits.max_radius_mm, 0.0)
    else:
        sizes = LensSizes(limits.max_radius_mm, max(filter(None, reaches), default=0.0), max(heights))
    known = ("min_thickness_mm",) if None in reaches else ("min_thickness_mm", "cavity_radius_mm", "cavity_height_mm")
    return {
        "lens": {
            name: {"offset_mm": offset_mm}
            for name, offset_mm in lens.derived_offsets_mm(sizes).items()
            if lens.faces[name].fixed is None
        },
        "constraints": {name: getattr(sizes, name) for name in known},
        "target": {} if target is None else receiver_of(target),
    }


def _reach_mm(source: Any) -> float | None:
    """Largest distance (mm) of an emitting area from the axis; None for a source that states no size."""
    extent = source.extent_mm
    (x, y, _) = source.position_mm
    return None if extent is None else extent + hypot(x, y)


def receiver_of(target: Any) -> dict[str, float]:
    """The receiver of a target that has none, by its field; empty if the size of the pattern is not known."""
    if target.distance_mm is not None:
        across = _pattern_mm(target)
        return {} if across is None else {"receiver_mm": rounded_length(_RECEIVER * across)}
    if not target.far_field_only:
        return {}
    widths = target.pair(target.across)
    wide = _MOST_HALF_ANGLE_DEG if widths is None else three_digits(_HALF_ANGLE * max(widths), ceil)
    return {"half_angle_deg": min(wide, _MOST_HALF_ANGLE_DEG)}


def _pattern_mm(target: Any) -> float | None:
    """Side (mm) of the square about the axis that holds a pattern; None for a kind without a size."""
    if target.bounds is None:
        return None
    across = max(target.bounds)
    height = target.bounds[1]
    turned = hypot(across, height) if target.rotation_deg else across
    x, y = target.centre
    return float(turned + 2.0 * max(abs(x), abs(y)))


def rounded_length(value_mm: float) -> float:
    """A length that something has to fit into, rounded up to three digits."""
    return three_digits(value_mm, ceil)


def three_digits(value: float, towards: Any = round) -> float:
    """``value`` to three significant digits, rounded by ``towards``."""
    if not value > 0.0:
        return value
    places = min(2 - floor(log10(value)), _MOST_PLACES)
    return float(round(towards(round(value * 10.0**places, 6)) / 10.0**places, 12))
