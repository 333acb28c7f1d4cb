"""Limits of the exported files: the largest errors, the criteria on measured values, form tolerances, and the mass.

Every value is measured by reading the files back.
"""

from collections.abc import Mapping

from lensforge.results import Positive, Record, Sense, Text
from lensforge.results.criteria import Criterion, at_least, at_most
from lensforge.spec import Spec

# The largest errors of an exported face.
FORM_LIMIT_NM, NORMAL_LIMIT_MRAD = 1.0, 0.02
ROUND_TRIP_LIMIT = 1e-9  # relative change of the volume by writing and reading: all digits are written
# Sense and unit of each criterion by its name; flags count as 1 or 0.
PART_CRITERIA: dict[str, tuple[Sense, str]] = {
    "form_error": ("<=", "nm"),
    "normal_error": ("<=", "mrad"),
    "step_valid": (">=", ""),
    "step_volume_change": ("<=", ""),
    "watertight": (">=", ""),
    "watertight_3mf": (">=", ""),
    "genus_difference": ("<=", ""),
    "mesh_volume_change": ("<=", ""),
}


def part_limits(mesh_volume_limit: float) -> dict[str, float]:
    """The limit of each criterion by name; ``mesh_volume_limit``: relative, what flat facets cut off."""
    return {
        "form_error": FORM_LIMIT_NM,
        "normal_error": NORMAL_LIMIT_MRAD,
        "step_valid": 1.0,
        "step_volume_change": ROUND_TRIP_LIMIT,
        "watertight": 1.0,
        "watertight_3mf": 1.0,
        "genus_difference": 0.0,
        "mesh_volume_change": mesh_volume_limit,
    }


def part_criteria(
    measured: Mapping[str, float], mesh_volume_limit: float, remedies: Mapping[str, str]
) -> tuple[Criterion, ...]:
    """The criteria that the files must meet before they go to a shop; ``measured``, ``remedies``: by their names."""
    limits = part_limits(mesh_volume_limit)
    return tuple(
        (at_most if sense == "<=" else at_least)(name, measured[name], limits[name], unit, remedies[name])
        for name, (sense, unit) in PART_CRITERIA.items()
    )


def mass_g(spec: Spec, volume_mm3: float) -> float | None:
    """Mass (g) of a part of ``volume_mm3`` (mm^3); None where the spec states no density."""
    density = spec.lens.density_g_per_cm3
    return None if density is None else 1e-3 * density * volume_mm3


def mesh_volume_limit(area_mm2: float, chord_error_mm: float, volume_mm3: float) -> float:
    """Largest relative change of the volume (mm^3) by facets of ``area_mm2`` that stay within a chord error."""
    return area_mm2 * chord_error_mm / volume_mm3


class FormTolerance(Record):
    """The surface profile on ``face`` in the STEP file: ``width_um`` of its zone, half of it on each side of the face.

    ``datum_faces``: the faces in z = 0 that are datum A; empty where the body has none there.
    """

    face: Text
    width_um: Positive
    datum_faces: tuple[Text, ...]
