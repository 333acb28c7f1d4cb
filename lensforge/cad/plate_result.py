"""The result of the plate: its size, its errors as read back, and their limits."""

from collections.abc import Iterable, Mapping
from typing import Annotated, Any

from pydantic import Field

from lensforge.cad.part_limits import CLOSED_FORM_LIMIT, round_trip_limit, state_of_mesh
from lensforge.results import Box, Count, Fact, Flag, Group, NotNegative, Number, Record, Text
from lensforge.results.figure import Criterion, Figure, figure
from lensforge.results.numerals import size
from lensforge.results.record import InCriterion

PLATE_STEP_FILE, PLATE_STL_FILE, PLATE_THREEMF_FILE = PLATE_FILES = ("plate.step", "plate.stl", "plate.3mf")


_SHAPE = "move holes and pins, or change plate.thickness_mm"


def _mend_solid(part: Any) -> str:
    return f"{_SHAPE}; not valid: {', '.join(part.plate.invalid_faces[:5]) or 'the whole solid'}"


class Plate(Record):
    """The plate with all lenses as one solid, in ``plate.step``, ``plate.stl`` and ``plate.3mf``.

    ``gap_mm``: least distance of two lenses, of their meshes; None for one lens. ``form_error_nm``: largest of all
    optical faces, that of the lens plus the distance of its copies from it. ``volume_mm3``: in closed form.
    ``chord_error_um``: largest distance of the facets from the optical faces. ``faces``: of the solid. ``step_valid``,
    ``step_volume_change``, ``volume_error``, ``watertight_3mf``, ``genus_difference``: of the files as read back,
    changes relative. ``mesh_volume_limit``: relative, what flat facets cut off at most. ``invalid_faces``: names of
    faces that the CAD kernel finds wrong; no file keeps them.
    """

    lenses: Annotated[Count, Figure("Lenses of the plate", "in one solid of {faces} faces")]
    gap_mm: Annotated[Number | None, Figure("Min. gap of lenses")]
    form_error_nm: Annotated[
        NotNegative,
        Figure("Form of all lenses", f"largest error in {PLATE_STEP_FILE}", digits=2),
        Criterion(
            "<=",
            lambda part: part.face_tolerance.form_nm,
            "form error of all lenses in plate.step",
            "export with more --nodes",
        ),
    ]
    step_valid: Annotated[
        Flag, InCriterion(), Criterion(">=", 1.0, "solid of plate.step is valid (1: yes)", _mend_solid)
    ]
    step_volume_change: Annotated[
        NotNegative,
        InCriterion(),
        round_trip_limit(PLATE_STEP_FILE, "export with more --nodes"),
    ]
    volume_error: Annotated[
        NotNegative,
        InCriterion(),
        Criterion("<=", CLOSED_FORM_LIMIT, "volume of plate.step, against its closed form", _SHAPE),
    ]
    volume_mm3: Annotated[Number, Figure("Volume of the plate", "lenses and pins included", digits=5)]
    volume_mesh_mm3: Number
    mesh_volume_limit: Annotated[Number, InCriterion("plate_mesh_volume_change", "limit")]
    mass_g: Annotated[
        NotNegative | None, Figure("Mass of the plate", "volume times density", key="plate_mass", unit="g")
    ]
    bounds_mm: Box
    watertight: Annotated[Flag, Criterion(">=", 1.0, "plate.stl is closed (1: yes)", _SHAPE)]
    watertight_3mf: Annotated[Flag, InCriterion(), Criterion(">=", 1.0, "plate.3mf is closed (1: yes)", _SHAPE)]
    genus: Annotated[int, Field(strict=True)]
    genus_difference: Annotated[
        Count,
        InCriterion(),
        Criterion("<=", 0.0, "handles and holes that the mesh of the plate should not have", _SHAPE),
    ]
    faces: Count
    triangles: Count
    chord_error_um: NotNegative
    seconds: NotNegative
    invalid_faces: Annotated[tuple[Text, ...], Field(exclude=True)] = ()

    @property
    @figure(
        Criterion(
            "<=",
            lambda part: part.plate.mesh_volume_limit,
            "volume of plate.stl, against its closed form",
            _SHAPE,
        )
    )
    def mesh_volume_change(self) -> float:
        """Relative change of the volume by flat facets."""
        return abs(self.volume_mesh_mm3 / self.volume_mm3 - 1.0)

    @property
    @figure(Figure("Size of the plate", key="plate_size"))
    def size_words(self) -> str:
        """Display text of the sides of the box."""
        low, high = self.bounds_mm
        return f"{' × '.join(f'{end - start:.5g}' for start, end in zip(low, high, strict=True))} mm"

    @property
    @figure(
        Figure("Mesh of the plate", "{triangles} facets within {chord_error_um:2}, genus {genus}", key="plate_mesh")
    )
    def mesh_state(self) -> str:
        """Display text of the state of the mesh."""
        return state_of_mesh(self.watertight)


def plate_facts(facts: Iterable[Fact], bytes_by_name: Mapping[str, int]) -> Group:
    """The group of ``facts`` on the plate; ``bytes_by_name``: sizes of its files."""
    sizes = ", ".join(f"{name} {size(count)}" for name, count in bytes_by_name.items())
    return Group("plate", "Plate as read back", (*facts, Fact("plate_files", "Files of the plate", sizes)))
