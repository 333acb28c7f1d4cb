"""Limits of the exported files, and records of them: form tolerances, signature, mass, keep-out.

Free of the CAD kernel: a stored record is judged without.
"""

import numpy as np

from lensforge.results import NotNegative, Number, Point, Positive, Record, Text
from lensforge.results.figure import Bound, Criterion, Words
from lensforge.spec import Spec
from lensforge.spec.spec_section import CalendarDate, rounded_up

# By which slopes, drafts and edges of exported faces may miss an angle that is asked for: a search keeps it to 0.01
# degrees by its tables, normals of the export are off by 0.011 (face_tolerance.py), and a check looks at other points.
# A cone of 2 degrees is measured as 1.99998.
ANGLE_TOLERANCE_DEG = 0.02
FIT_TOLERANCE = 1e-6  # of the radius of a ball that is to fit: 1 nm for a cutter of 1 mm
ROUND_TRIP_LIMIT = 1e-9  # relative change of the volume by writing and reading: all digits are written
OTHER_RINGS = "change the number of rings"  # of a mesh that is not closed
MORE_RINGS = "raise the number of rings"  # of one whose facets cut off too much
CLOSED_FORM_LIMIT = 1e-6  # relative, of the volume: the CAD kernel's areas err by 1e-7 at most where rims are short


def step_face_limit(error: str, bound: Bound, remedy: Words) -> Criterion:
    """Limit on the largest ``error``, "form error" or "normal error", of the optical faces in a STEP file."""
    return Criterion("<=", bound, f"{error} of the optical faces in the STEP file", remedy, of="max")


def round_trip_limit(file: str, remedy: Words) -> Criterion:
    """Limit on the relative change of volume when ``file`` is written and read."""
    return Criterion("<=", ROUND_TRIP_LIMIT, f"volume of {file} as read back", remedy)


def state_of_mesh(watertight: bool) -> str:
    """State of a mesh for the screen."""
    return "closed" if watertight else "not closed"


class UntrimmedSurfaces(Record):
    """The optical faces extended beyond the rim, in ``lens_surfaces.step``; errors above the rim as read back.

    ``scale``: of these faces against the lens's, 1 + shrinkage for a mould insert.
    """

    extension_deg: Positive
    scale: Positive
    form_error_nm: NotNegative
    normal_error_mrad: NotNegative


def mass_g(spec: Spec, volume_mm3: float) -> float | None:
    """Mass (g) of a part of ``volume_mm3`` (mm^3); None if the density is not known."""
    density = spec.lens.density
    return None if density is None else 1e-3 * density.g_per_cm3 * volume_mm3


def mesh_volume_limit(area_mm2: float, chord_error_mm: float, volume_mm3: float) -> float:
    """Largest relative change of the volume (mm^3) by facets of ``area_mm2`` that stay within a chord error."""
    return area_mm2 * chord_error_mm / volume_mm3


class Signature(Record):
    """Author, organisation ("" where not given) and date (2026-01-31) of the files."""

    author: Text
    organisation: Text
    date: CalendarDate | None


class FormTolerance(Record):
    """The surface profile on ``face`` in the STEP file: ``width_um`` of its zone, half of it on each side of the face.

    ``datum_faces``: the faces that are datum A, in z = 0 or of a flange; empty if the body has none.
    """

    face: Text
    width_um: Positive
    datum_faces: tuple[Text, ...]


_RIM_MM = 1e-5  # from z = 0: a place on the rim of an exported face


class KeepOutDistance(Record):
    """Smallest distance between the body and the keep-out of the spec, and where: a place on each, to a facet's size.

    ``distance_mm``: of their meshes; negative if they overlap: the mean thickness of their intersection, twice its
    volume over its surface; the places are then its lowest vertex, and its outermost one lifted to its greatest height.
    ``error_mm``: of both meshes' facets.
    """

    distance_mm: Number
    body_point_mm: Point
    keep_out_point_mm: Point
    error_mm: NotNegative


def keep_out_remedy(spec: Spec, measured: KeepOutDistance | None) -> str:
    """The fields to change, depending on where lens and keep-out are closest."""
    if measured is None:
        return f"the mesh of the lens is not closed: {OTHER_RINGS}, and export again"
    place = ", ".join(f"{value + 0.0:.4g}" for value in np.round(measured.body_point_mm, 6))
    return f"{_fields(spec, measured)}; the body is closest at ({place}) mm"


def _fields(spec: Spec, measured: KeepOutDistance) -> str:
    base = spec.base_made
    margin = spec.constraints.keep_out_margin_mm
    (x, y, z) = measured.body_point_mm
    keep_out_point = measured.keep_out_point_mm
    overlap = measured.distance_mm < 0.0
    across = float(np.hypot(*keep_out_point[:2]))
    below = z - keep_out_point[2]
    outwards = across - float(np.hypot(x, y))
    at_bottom = base.kind != "none" and z <= _RIM_MM - base.height_mm
    stands = at_bottom and measured.distance_mm <= _RIM_MM  # the base stands on it
    side = base.side_mm if base.kind == "square" else base.diameter_mm
    through = overlap and 2.0 * (across + margin) >= side  # no pocket of this width leaves a wall
    under = (keep_out_point[2] < 0.0 and (at_bottom or not through)) if overlap else below > abs(outwards) or stands
    deep = base.height_mm - below + z + margin  # of a pocket whose top is clear
    in_lens = z > _RIM_MM or (overlap and keep_out_point[2] > _RIM_MM)
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
    """A length for a spec, rounded up; at least a micrometre."""
    return rounded_up(max(length_mm, 1e-3))
