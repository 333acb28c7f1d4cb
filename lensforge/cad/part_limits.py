"""Limits of the exported files: criteria on what they are as read back; form tolerances, signature, mass."""

from collections.abc import Callable, Mapping, Sequence

from lensforge.cad.face_tolerance import MAX_NODES, FaceTolerance
from lensforge.results import Fact, NotNegative, Positive, Record, Text
from lensforge.results.criteria import Criteria, at_least, at_most
from lensforge.spec import Spec
from lensforge.spec.spec_section import CalendarDate

# By which slopes, drafts and edges of exported faces may miss an angle that is asked for: a search keeps it to 0.01
# degrees by its tables, normals of the export are off by 0.011 (face_tolerance.py), and a check looks at other points.
# A cone of 2 degrees is measured as 1.99998.
ANGLE_TOLERANCE_DEG = 0.02
FIT_TOLERANCE = 1e-6  # of the radius of a ball that is to fit: 1 nm for a cutter of 1 mm
ROUND_TRIP_LIMIT = 1e-9  # relative change of the volume by writing and reading: all digits are written
CLOSED_FORM_LIMIT = 1e-6  # relative, of the volume: the CAD kernel's areas err by 1e-7 at most where rims are short


# Compared how, with what limit and unit, and what a remedy must change: by the name of the figure, in the files' order.
_LIMITS: dict[str, tuple[Callable[..., Fact], float | None, str, str]] = {
    "form_error": (at_most, None, "nm", "faces"),
    "normal_error": (at_most, None, "mrad", "faces"),
    "step_valid": (at_least, 1.0, "", "solid"),
    "step_volume_change": (at_most, ROUND_TRIP_LIMIT, "", "faces"),
    "volume_error": (at_most, CLOSED_FORM_LIMIT, "", "shape"),
    "watertight": (at_least, 1.0, "", "mesh"),
    "watertight_3mf": (at_least, 1.0, "", "mesh"),
    "genus_difference": (at_most, 0.0, "", "mesh"),
    "mesh_volume_change": (at_most, None, "", "facets"),
}


def file_criteria(
    measured: Mapping[str, float],
    mesh_volume_limit: float,
    tolerance: FaceTolerance,
    remedies: Mapping[str, str],
    start: str = "",
) -> Criteria:
    """The criteria that files must meet before they go to a shop, on what is ``measured``, by their names.

    ``mesh_volume_limit``: relative, what flat facets cut off. ``tolerance``: of the optical faces. ``remedies``: by
    what they change. ``start``: of the names. Flags count as 1 or 0.
    """
    asked = {
        "form_error": tolerance.form_nm,
        "normal_error": tolerance.normal_mrad,
        "mesh_volume_change": mesh_volume_limit,
    }
    return tuple(
        compared(f"{start}{name}", measured[name], asked[name] if limit is None else limit, unit, remedies[change])
        for name, (compared, limit, unit, change) in _LIMITS.items()
        if name in measured
    )


def part_criteria(
    measured: Mapping[str, float],
    mesh_volume_limit: float,
    tolerance: FaceTolerance,
    nodes: int,
    faults: Sequence[str] = (),
) -> Criteria:
    """The criteria on the files of a part; ``nodes``: most of a face, ``faults``: names of faces that are not valid."""
    larger = "raise manufacture.form_nm and normal_mrad"
    remedies = {
        "faces": f"{larger}: no spline is finer than this one of {nodes} nodes"
        if nodes >= MAX_NODES
        else f"raise the number of nodes, or {larger}",
        "solid": f"try another base.diameter_mm, or no base; not valid: {', '.join(faults) or 'the whole solid'}",
        "mesh": "change the number of rings",
        "facets": "raise the number of rings",
    }
    return file_criteria(measured, mesh_volume_limit, tolerance, remedies)


def plate_criteria(
    measured: Mapping[str, float], mesh_volume_limit: float, tolerance: FaceTolerance, faults: Sequence[str] = ()
) -> Criteria:
    """The criteria on the files of a plate; ``faults``: names of faces that are not valid."""
    again = "move holes and pins, or change plate.thickness_mm"
    remedies = {
        "faces": "export with more --nodes",
        "solid": f"{again}; not valid: {', '.join(faults[:5]) or 'the whole solid'}",
        **dict.fromkeys(("shape", "mesh", "facets"), again),
    }
    return file_criteria(measured, mesh_volume_limit, tolerance, remedies, "plate_")


class UntrimmedSurfaces(Record):
    """The optical faces extended beyond the rim, in ``lens_surfaces.step``; errors above the rim as read back.

    ``scale``: of these faces against the lens's, 1 + shrinkage for a mould insert.
    """

    extension_deg: Positive
    scale: Positive
    form_error_nm: NotNegative
    normal_error_mrad: NotNegative


def untrimmed_criteria(untrimmed: UntrimmedSurfaces | None, tolerance: FaceTolerance) -> Criteria:
    """The criteria on the faces of ``lens_surfaces.step``; none where there is no such file."""
    if untrimmed is None:
        return ()
    finer = "raise the number of nodes, or lower the extension"
    return (
        at_most("surfaces_form_error", untrimmed.form_error_nm, tolerance.form_nm, "nm", finer),
        at_most("surfaces_normal_error", untrimmed.normal_error_mrad, tolerance.normal_mrad, "mrad", finer),
    )


def mass_g(spec: Spec, volume_mm3: float) -> float | None:
    """Mass (g) of a part of ``volume_mm3`` (mm^3); None where the density is not known."""
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

    ``datum_faces``: the faces that are datum A, in z = 0 or of a flange; empty where the body has none.
    """

    face: Text
    width_um: Positive
    datum_faces: tuple[Text, ...]
