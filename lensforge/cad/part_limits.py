"""Limits of the exported files: the largest errors, criteria on measured values; form tolerances, signature, and mass.

Every value is measured by reading the files back.
"""

from collections.abc import Callable, Mapping, Sequence

from lensforge.results import Positive, Record, Text
from lensforge.results.criteria import Criterion, at_least, at_most
from lensforge.spec import Spec
from lensforge.spec.spec_section import CalendarDate

# The largest errors of an exported face.
FORM_LIMIT_NM, NORMAL_LIMIT_MRAD = 1.0, 0.02
# By which slopes, drafts and edges of exported faces may miss an angle that is asked for: a search keeps it to 0.01
# degrees by its tables, normals of the export are off by 0.001 (NORMAL_LIMIT_MRAD), and a check looks at other points.
# A cone of 2 degrees is measured as 1.99998.
ANGLE_TOLERANCE_DEG = 0.02
FIT_TOLERANCE = 1e-6  # of the radius of a ball that is to fit: 1 nm for a cutter of 1 mm
ROUND_TRIP_LIMIT = 1e-9  # relative change of the volume by writing and reading: all digits are written


def part_criteria(
    measured: Mapping[str, float], mesh_volume_limit: float, faults: Sequence[str] = ()
) -> tuple[Criterion, ...]:
    """The criteria that the files must meet before they go to a shop, on what is ``measured``, by their names.

    ``mesh_volume_limit``: relative, what flat facets cut off. ``faults``: names of faces that are not valid. Flags
    count as 1 or 0.
    """
    finer, rings = "raise the number of nodes", "change the number of rings"
    wrong = f"try another base.diameter_mm, or no base; not valid: {', '.join(faults) or 'the whole solid'}"
    limits: dict[str, tuple[Callable[..., Criterion], float, str, str]] = {
        "form_error": (at_most, FORM_LIMIT_NM, "nm", finer),
        "normal_error": (at_most, NORMAL_LIMIT_MRAD, "mrad", finer),
        "step_valid": (at_least, 1.0, "", wrong),
        "step_volume_change": (at_most, ROUND_TRIP_LIMIT, "", finer),
        "watertight": (at_least, 1.0, "", rings),
        "watertight_3mf": (at_least, 1.0, "", rings),
        "genus_difference": (at_most, 0.0, "", rings),
        "mesh_volume_change": (at_most, mesh_volume_limit, "", "raise the number of rings"),
    }
    return tuple(
        compared(name, measured[name], limit, unit, remedy) for name, (compared, limit, unit, remedy) in limits.items()
    )


def mass_g(spec: Spec, volume_mm3: float) -> float | None:
    """Mass (g) of a part of ``volume_mm3`` (mm^3); None where the spec states no density."""
    density = spec.lens.density_g_per_cm3
    return None if density is None else 1e-3 * density * volume_mm3


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

    ``datum_faces``: the faces in z = 0 that are datum A; empty where the body has none there.
    """

    face: Text
    width_um: Positive
    datum_faces: tuple[Text, ...]
