"""The outline of a plate as it was drawn: read from a STEP file, in a child process, as loops of lines and arcs."""

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import Field

from lensforge.results.file_bounds import MOST_STEP_MIB, require_small_step
from lensforge.results.files import MIB, read_file, temporary_folder, write_json
from lensforge.results.sandbox import ChildLimits, work_in_child
from lensforge.spec.spec_section import Coordinate, Label, Section, check
from lensforge.surfaces import step_outline
from lensforge.surfaces.plane_loop import Loop, Place, area_mm2, circle_of, loop_of
from lensforge.surfaces.step_outline import DRAWING, FOUND, JOB, MOST_CORNERS, MOST_LOOPS

_REMEDY = "export the top face of the plate, or its outline, as STEP"
_MEMORY_MIB = 1800
_SECONDS, _SECONDS_PER_MIB = 30.0, 15.0  # as of any other STEP file of a user

_Bulge = Annotated[float, Field(ge=-1e6, le=1e6)]
_Corners = Annotated[tuple[tuple[Coordinate, Coordinate, _Bulge], ...], Field(min_length=2, max_length=MOST_CORNERS)]


class DrawnOutline(Section):
    """An outline as it was read: a spec that names a file becomes this one, and needs the file no more."""

    origin: Label = ""
    """Name of its file."""
    sha256: Label = ""
    """SHA-256 of that file."""
    loops_mm: Annotated[tuple[_Corners, ...], Field(min_length=1, max_length=MOST_LOOPS)]
    """Outline, then the openings, each counter-clockwise: corners x and y in mm, and the bulge of the edge to the next
    corner, the tangent of a quarter of its arc's angle, 0 for a line.
    """

    @check
    def _run_counter_clockwise(self) -> None:
        for number, corners in enumerate(self.loops_mm):
            if area_mm2(loop_of(corners)) <= 0.0:
                raise ValueError(f"loops_mm.{number}: has no area, or runs clockwise; turn the order of its corners")

    @property
    def outer(self) -> Loop:
        """The outline."""
        return loop_of(self.loops_mm[0])

    @property
    def circles(self) -> tuple[tuple[Place, float], ...]:
        """Centres (mm) and radii (mm) of the round openings."""
        found = map(circle_of, self.loops_mm[1:])
        return tuple(circle for circle in found if circle is not None)

    @property
    def slots(self) -> tuple[Loop, ...]:
        """The other openings."""
        return tuple(loop_of(corners) for corners in self.loops_mm[1:] if circle_of(corners) is None)


def read_outline(path: Path) -> DrawnOutline:
    """The outline in the STEP file ``path``, in mm whatever its unit.

    Raises :class:`InputError` for a file without one face, wire or body, or with other curves than lines and arcs.
    """
    content = read_file(
        path, missing="plate.outline is relative to the folder of its spec", most_bytes=MOST_STEP_MIB * MIB
    )
    return _read(content, path)


@lru_cache(maxsize=4)  # a spec is made many times while it is read; the child takes seconds
def _read(content: bytes, path: Path) -> DrawnOutline:
    require_small_step(content, str(path), _REMEDY)
    limits = ChildLimits(_MEMORY_MIB, _SECONDS + _SECONDS_PER_MIB * len(content) / MIB)
    with temporary_folder("outline") as folder:
        (folder / DRAWING).write_bytes(content)
        write_json(folder / JOB, {"origin": str(path), "remedy": _REMEDY})
        work_in_child(Path(step_outline.__file__).resolve(), folder, limits, origin=str(path), remedy=_REMEDY)
        loops = json.loads((folder / FOUND).read_text(encoding="utf-8"))
    return DrawnOutline(origin=path.name[:200], sha256=hashlib.sha256(content).hexdigest(), loops_mm=loops)
