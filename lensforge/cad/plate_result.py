"""The result of the plate: its size, its errors as read back, the criteria on them, and their facts."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from lensforge.results import Box, Count, Fact, Flag, Group, NotNegative, Number, Record
from lensforge.results.criteria import Criteria
from lensforge.results.fact_table import Row, facts_of
from lensforge.results.numerals import size

PLATE_STEP_FILE, PLATE_STL_FILE, PLATE_THREEMF_FILE = PLATE_FILES = ("plate.step", "plate.stl", "plate.3mf")


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

    @property
    def size_words(self) -> str:
        """Sides of the box in words."""
        low, high = self.bounds_mm
        return f"{' × '.join(f'{end - start:.5g}' for start, end in zip(low, high, strict=True))} mm"

    @property
    def closed_or_not(self) -> str:
        """The state of the mesh in words."""
        return "closed" if self.watertight else "not closed"


_TABLE = (
    Row("plate_lenses", "Lenses of the plate", "lenses", "in one solid of {faces} faces"),
    Row("plate_gap", "Min. gap of lenses", "gap_mm"),
    Row("plate_size", "Size of the plate", "size_words"),
    Row(
        "plate_form_error",
        "Form of all lenses",
        "form_error_nm",
        f"largest error in {PLATE_STEP_FILE}",
        digits=2,
        like="plate_form_error",
    ),
    Row("plate_volume", "Volume of the plate", "volume_mm3", "lenses and pins included", digits=5),
    Row("plate_mass", "Mass of the plate", "mass_g", "volume times density", "g"),
    Row(
        "plate_mesh",
        "Mesh of the plate",
        "closed_or_not",
        "{triangles} facets within {chord_error_um:2}, genus {genus}",
    ),
)


def plate_facts(plate: Plate, criteria: Criteria, bytes_by_name: Mapping[str, int]) -> Group:
    """The group of facts on the plate; ``bytes_by_name``: sizes of its files."""
    sizes = ", ".join(f"{name} {size(count)}" for name, count in bytes_by_name.items())
    files = Fact("plate_files", "Files of the plate", sizes)
    return Group("plate", "Plate as read back", (*facts_of(plate, _TABLE, judged=criteria), files))
