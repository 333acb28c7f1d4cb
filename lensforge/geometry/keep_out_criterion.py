"""The criterion on the distance from the keep-out, with the fields to change where it is missed.

It follows from the record and the spec alone, so that the criterion in a file can be held against the file's numbers.
"""

import numpy as np

from lensforge.criteria import Criterion, at_least
from lensforge.geometry.part import KeepOutDistance
from lensforge.spec import Spec
from lensforge.spec.section import rounded_up

_RIM_MM = 1e-5  # from z = 0: a place on the rim of an exported face
_UNMEASURED = "the mesh of the lens is not closed: change the number of rings, and export again"


def keep_out_criteria(spec: Spec, found: KeepOutDistance | None) -> tuple[Criterion, ...]:
    """The criterion on the distance, but for the errors of both meshes; none for a spec without a keep-out."""
    limits = spec.constraints
    if limits.keep_out is None:
        return ()
    if found is None:
        return (at_least("keep_out_distance", float("nan"), limits.keep_out_margin_mm, "mm", _UNMEASURED),)
    limit = limits.keep_out_margin_mm - limits.tolerance_mm - found.error_mm
    return (at_least("keep_out_distance", found.distance_mm, limit, "mm", _remedy(spec, found)),)


def _remedy(spec: Spec, found: KeepOutDistance) -> str:
    """The fields to change, by where the two are closest."""
    place = ", ".join(f"{value + 0.0:.4g}" for value in np.round(found.body_point_mm, 6))
    return f"{_fields(spec, found)}; the body is closest at ({place}) mm"


def _fields(spec: Spec, found: KeepOutDistance) -> str:
    base, margin = spec.base, spec.constraints.keep_out_margin_mm
    (x, y, z), other = found.body_point_mm, found.keep_out_point_mm
    overlap, across, below = found.distance_mm < 0.0, float(np.hypot(*other[:2])), z - other[2]
    outwards = across - float(np.hypot(x, y))
    at_bottom = base.kind != "none" and z <= _RIM_MM - base.height_mm
    stands = at_bottom and found.distance_mm <= _RIM_MM  # the base stands on it
    side = base.side_mm if base.kind == "square" else base.diameter_mm
    through = overlap and 2.0 * (across + margin) >= side  # no pocket of this width leaves a wall
    under = (other[2] < 0.0 and (at_bottom or not through)) if overlap else below > abs(outwards) or stands
    deep = base.height_mm - below + z + margin  # of a pocket whose top is clear
    in_lens = z > _RIM_MM or (overlap and other[2] > _RIM_MM)
    if in_lens or (z >= -_RIM_MM and not under and (outwards <= 0.0 or base.kind == "none")):
        return "raise lens.inner_offset_mm, or lower constraints.keep_out_margin_mm"
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
