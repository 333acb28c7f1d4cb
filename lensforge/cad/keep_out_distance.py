"""The distance of a body from its keep-out, the criterion on it, and which fields of the spec move the two apart.

Free of the CAD kernel, which measures it (``cad.keep_out``): a stored distance is judged without.
"""

from math import nan

import numpy as np

from lensforge.results import NotNegative, Number, Point, Record
from lensforge.results.criteria import Criteria, at_least
from lensforge.spec import Spec
from lensforge.spec.spec_section import rounded_up

_RIM_MM = 1e-5  # from z = 0: a place on the rim of an exported face
_UNMEASURED = "the mesh of the lens is not closed: change the number of rings, and export again"


class KeepOutDistance(Record):
    """Smallest distance between the body and the keep-out of the spec, and where: a place on each, to a facet's size.

    ``distance_mm``: of their meshes; below 0 where they overlap, less the mean thickness of what they have in common,
    twice its volume over its surface; the places are then the lowest vertex of that, and its outermost one lifted
    to the height of its highest. ``error_mm``: of both meshes' facets.
    """

    distance_mm: Number
    body_point_mm: Point
    keep_out_point_mm: Point
    error_mm: NotNegative


def keep_out_criteria(spec: Spec, measured: KeepOutDistance | None) -> Criteria:
    """The criterion on the distance, but for the errors of both meshes; none for a spec without a keep-out."""
    limits = spec.constraints
    if limits.keep_out is None:
        return ()
    if measured is None:
        return (at_least("keep_out_distance", nan, limits.keep_out_margin_mm, "mm", _UNMEASURED),)
    asked, tolerance = limits.keep_out_margin_mm, limits.tolerance_mm + measured.error_mm
    return (at_least("keep_out_distance", measured.distance_mm, asked, "mm", _remedy(spec, measured), tolerance),)


def _remedy(spec: Spec, measured: KeepOutDistance) -> str:
    """The fields to change, by where the two are closest."""
    place = ", ".join(f"{value + 0.0:.4g}" for value in np.round(measured.body_point_mm, 6))
    return f"{_fields(spec, measured)}; the body is closest at ({place}) mm"


def _fields(spec: Spec, measured: KeepOutDistance) -> str:
    base, margin = spec.base_made, spec.constraints.keep_out_margin_mm
    (x, y, z), other = measured.body_point_mm, measured.keep_out_point_mm
    overlap, across, below = measured.distance_mm < 0.0, float(np.hypot(*other[:2])), z - other[2]
    outwards = across - float(np.hypot(x, y))
    at_bottom = base.kind != "none" and z <= _RIM_MM - base.height_mm
    stands = at_bottom and measured.distance_mm <= _RIM_MM  # the base stands on it
    side = base.side_mm if base.kind == "square" else base.diameter_mm
    through = overlap and 2.0 * (across + margin) >= side  # no pocket of this width leaves a wall
    under = (other[2] < 0.0 and (at_bottom or not through)) if overlap else below > abs(outwards) or stands
    deep = base.height_mm - below + z + margin  # of a pocket whose top is clear
    in_lens = z > _RIM_MM or (overlap and other[2] > _RIM_MM)
    if in_lens or (z >= -_RIM_MM and not under and (outwards <= 0.0 or base.kind == "none")):
        return f"raise lens.{spec.lens.names[0]}.offset_mm, or lower constraints.keep_out_margin_mm"
    if base.kind == "step" and (z < -_RIM_MM or not under):
        return "cut the solid of base.file back there, or lower constraints.keep_out_margin_mm"
    if under and (z >= -_RIM_MM or deep >= base.height_mm):
        return "the keep-out is too close below the lens: move it down, or lower constraints.keep_out_margin_mm"
    if under and through:
        return "lower base.height_mm, or move the keep-out down or aside"
    if under:
        pocket = (
            f"base.pocket_depth_mm = {_at_least(deep)} with pocket_diameter_mm = {_at_least(2.0 * (across + margin))}"
        )
        return f"lower base.height_mm, or give {pocket}"
    if outwards > 0.0:
        field = "side_mm" if base.kind == "square" else "diameter_mm"
        return f"the keep-out stands beside the base: lower base.{field}, or base.flange_diameter_mm if it has a flange"
    return f"the bore is too small: base.pocket_diameter_mm must be above {_at_least(2.0 * (across + margin))}"


def _at_least(length_mm: float) -> str:
    """A length for a spec, rounded up; a micrometre where none is needed."""
    return rounded_up(max(length_mm, 1e-3))
