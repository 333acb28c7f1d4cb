"""The result of the plate: its size, its errors as read back, the criteria on them, and their facts."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated

from pydantic import Field

from lensforge.cad.part_limits import FORM_LIMIT_NM, ROUND_TRIP_LIMIT
from lensforge.results import Box, Count, Fact, Flag, Group, NotNegative, Number, Record
from lensforge.results.criteria import Criterion, at_least, at_most, kept
from lensforge.results.numerals import quantity, size

PLATE_STEP_FILE, PLATE_STL_FILE, PLATE_THREEMF_FILE = PLATE_FILES = ("plate.step", "plate.stl", "plate.3mf")
CLOSED_FORM_LIMIT = 1e-6  # relative, of the volume: the CAD kernel's areas err by 1e-7 at most where rims are short


class Plate(Record):
    """The plate with all lenses as one solid, in ``plate.step``, ``plate.stl`` and ``plate.3mf``.

    ``gap_mm``: least distance of two lenses, of their meshes; None for one lens. ``form_error_nm``: largest of all
    optical faces, that of the lens and how far its copies are from it. ``volume_mm3``: in closed form.
    ``chord_error_um``: largest distance of the facets from the optical faces. ``faces``: of the solid.
    """

    lenses: Count
    gap_mm: Number | None
    form_error_nm: NotNegative
    volume_mm3: Number
    volume_mesh_mm3: Number
    mass_g: NotNegative | None
    bounds_mm: Box
    watertight: Flag
    genus: Annotated[int, Field(strict=True)]
    faces: Count
    triangles: Count
    chord_error_um: NotNegative
    seconds: NotNegative


def plate_criteria(
    measured: Mapping[str, float], mesh_volume_limit: float, faults: Sequence[str]
) -> tuple[Criterion, ...]:
    """The criteria on what is ``measured`` of the plate, by their names; flags count as 1 or 0."""
    nodes, again = "export with more --nodes", "move holes and pins, or change plate.thickness_mm"
    wrong = f"{again}; not valid: {', '.join(faults[:5]) or 'the whole solid'}"
    return (
        at_most("plate_form_error", measured["form_error"], FORM_LIMIT_NM, "nm", nodes),
        at_least("plate_step_valid", measured["step_valid"], 1.0, "", wrong),
        at_most("plate_step_volume_change", measured["step_volume_change"], ROUND_TRIP_LIMIT, "", nodes),
        at_most("plate_volume_error", measured["volume_error"], CLOSED_FORM_LIMIT, "", again),
        at_least("plate_watertight", measured["watertight"], 1.0, "", again),
        at_least("plate_watertight_3mf", measured["watertight_3mf"], 1.0, "", again),
        at_most("plate_genus_difference", measured["genus_difference"], 0.0, "", again),
        at_most("plate_mesh_volume_change", measured["mesh_volume_change"], mesh_volume_limit, "", again),
    )


def plate_facts(plate: Plate, criteria: Iterable[Criterion], bytes_by_name: Mapping[str, int]) -> Group:
    """The group of facts on the plate; ``bytes_by_name``: sizes of its files."""
    return Group("plate", "Plate as read back", tuple(_facts(plate, tuple(criteria), bytes_by_name)))


def _facts(plate: Plate, criteria: tuple[Criterion, ...], bytes_by_name: Mapping[str, int]) -> Iterator[Fact]:
    yield Fact(
        "plate_lenses", "Lenses of the plate", plate.lenses, note=f"in one solid of {quantity(plate.faces, 'faces')}"
    )
    if plate.gap_mm is not None:
        yield Fact("plate_gap", "Least gap", plate.gap_mm, "mm", note="between two lenses of the plate")
    low, high = plate.bounds_mm
    across = " × ".join(f"{end - start:.5g}" for start, end in zip(low, high, strict=True))
    yield Fact("plate_size", "Size of the plate", f"{across} mm")
    yield Fact(
        "plate_form_error",
        "Form of all lenses",
        plate.form_error_nm,
        "nm",
        **kept(criteria, "plate_form_error"),
        note=f"largest error in {PLATE_STEP_FILE}",
        digits=2,
    )
    yield Fact(
        "plate_volume", "Volume of the plate", plate.volume_mm3, "mm³", note="lenses and pins included", digits=5
    )
    if plate.mass_g is not None:
        yield Fact("plate_mass", "Mass of the plate", plate.mass_g, "g", note="by the density of the spec")
    chord = quantity(plate.chord_error_um, "µm", digits=2)
    facets = f"{quantity(plate.triangles, 'facets')} within {chord}, genus {plate.genus}"
    yield Fact("plate_mesh", "Mesh of the plate", "closed" if plate.watertight else "not closed", note=facets)
    sizes = ", ".join(f"{name} {size(count)}" for name, count in bytes_by_name.items())
    yield Fact("plate_files", "Files of the plate", sizes)
