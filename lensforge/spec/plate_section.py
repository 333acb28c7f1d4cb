"""The plate that carries the lenses of ``[lamps]`` in one piece: ``[plate]``, its outline, holes, pins, bosses, gate.

Its top is the plane z = 0, in which the rims of the lenses lie; a rectangle or a circle has the origin in its middle.
The cavities go straight down through it, as through a base. An outline that was drawn is read from a STEP file, in a
child process, as loops of lines and arcs.
"""

import hashlib
import json
from functools import lru_cache
from math import hypot, radians, tan
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from lensforge.public import public
from lensforge.results.file_bounds import MOST_STEP_MIB, require_small_step
from lensforge.results.files import MIB, read_file, temporary_folder, write_json
from lensforge.results.sandbox import ChildLimits, work_in_child
from lensforge.spec.lamps_section import EndlessLamps, Lamps, LampsSection, Place, lamps_of
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import (
    Coordinate,
    FilePath,
    Label,
    Millimetres,
    MillimetresOrZero,
    Section,
    check,
    fault_of,
    rounded_up,
)
from lensforge.surfaces import plane_loop
from lensforge.surfaces.plane_loop import MOST_CORNERS, Loop, area_mm2, box_of_loop, circle_of, inside_by_mm, loop_of

_MOST_LENSES = 400
_MOST_MARKS = 200
_MARGIN_MM = 2.0
_SAME_MM = 1e-9
_ON_EDGE_MM = 1e-3
_Lines = Annotated[int, Field(ge=1, le=_MOST_LENSES)]
_OF_RECTANGLE = ("width_mm", "height_mm", "corner_radius_mm")
_FOREIGN = {  # sizes that an outline has not
    "rectangle": ("diameter_mm",),
    "round": _OF_RECTANGLE,
    "step": ("diameter_mm", *_OF_RECTANGLE, "margin_mm"),
}


_REMEDY = "export the top face of the plate, or its outline, as STEP"
_MEMORY_MIB = 1800
# The time that any other STEP file of a user has.
_SECONDS = 30.0
_SECONDS_PER_MIB = 15.0

_Bulge = Annotated[float, Field(ge=-1e6, le=1e6)]
_Corners = Annotated[tuple[tuple[Coordinate, Coordinate, _Bulge], ...], Field(min_length=2, max_length=MOST_CORNERS)]


@public
class DrawnOutline(Section):
    """An outline as it was read: a spec that names a file becomes this one, and needs the file no more."""

    origin: Label = Field(default="", description="Name of its file.")
    sha256: Label = Field(default="", description="SHA-256 of that file.")
    loops_mm: Annotated[tuple[_Corners, ...], Field(min_length=1, max_length=plane_loop.MOST_LOOPS)] = Field(
        description="Outline, then the openings, each counter-clockwise: corners x and y in mm, and the bulge of "
        "the edge to the next corner, the tangent of a quarter of its arc's angle, 0 for a line."
    )

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
        circles = map(circle_of, self.loops_mm[1:])
        return tuple(circle for circle in circles if circle is not None)

    @property
    def slots(self) -> tuple[Loop, ...]:
        """The other openings."""
        return tuple(loop_of(corners) for corners in self.loops_mm[1:] if circle_of(corners) is None)


def read_outline(path: Path) -> DrawnOutline:
    """The outline in the STEP file ``path``, in mm whatever its unit.

    Raises :class:`InputError` for a file without one face, wire or body, or with other curves than lines and arcs.
    """
    content = read_file(
        path, missing="plate.outline counts from the folder of its spec", most_bytes=MOST_STEP_MIB * MIB
    )
    return _read_outline(content, path)


@lru_cache(maxsize=4)  # a spec is made many times while it is read; the child takes seconds
def _read_outline(content: bytes, path: Path) -> DrawnOutline:
    require_small_step(content, str(path), _REMEDY)
    limits = ChildLimits(_MEMORY_MIB, _SECONDS + _SECONDS_PER_MIB * len(content) / MIB)
    with temporary_folder("outline") as folder:
        (folder / plane_loop.DRAWING).write_bytes(content)
        write_json(folder / plane_loop.JOB, {"origin": str(path), "remedy": _REMEDY})
        script = Path(plane_loop.__file__).with_name("step_outline.py").resolve()
        work_in_child(script, folder, limits, origin=str(path), remedy=_REMEDY)
        loops = json.loads((folder / plane_loop.FOUND).read_text(encoding="utf-8"))
    return DrawnOutline(origin=path.name[:200], sha256=hashlib.sha256(content).hexdigest(), loops_mm=loops)


@public
class PlateMark(Section):
    """Common fields of holes and pins."""

    place_mm: tuple[Coordinate, Coordinate] = Field(description="Place (x, y) of its axis.")
    diameter_mm: Millimetres = Field(description="Diameter.")
    tolerance_mm: Millimetres | None = Field(
        default=None, description="Tolerance of the diameter, either way; left out, the general one."
    )
    place_tolerance_mm: Millimetres | None = Field(
        default=None,
        description="Diameter of the zone in which its axis must lie; left out, the general tolerances hold.",
    )

    @property
    def radius_mm(self) -> float:
        """Half of the diameter."""
        return self.diameter_mm / 2.0

    def away_mm(self, place: Place) -> float:
        """Distance of its axis from a place."""
        return hypot(self.place_mm[0] - place[0], self.place_mm[1] - place[1])


@public
class PlateHole(PlateMark):
    """A round hole through the plate, as for a screw."""


@public
class PlatePin(PlateMark):
    """A round pin below the plate, which finds its place on the board."""

    height_mm: Millimetres = Field(description="Length below the plate.")


@public
class PlateBoss(PlatePin):
    """A screw dome: a pin with a blind bore from its end. It keeps clear of the lenses, on which it would sink."""

    bore_diameter_mm: Millimetres = Field(description="Diameter of its bore.")
    bore_depth_mm: Millimetres = Field(description="Depth of its bore from its end, which may reach into the plate.")

    @check
    def _has_a_wall(self) -> None:
        if self.bore_diameter_mm >= self.diameter_mm:
            raise ValueError(
                f"bore_diameter_mm = {self.bore_diameter_mm:g}: must be below diameter_mm = {self.diameter_mm:g}"
            )


@public
class PlateGate(Section):
    """Gate at the edge of the plate, where it is filled: a mark on the drawing, and no part of the solid."""

    place_mm: tuple[Coordinate, Coordinate] = Field(description="Place (x, y) of its middle, on the outline.")
    width_mm: Millimetres = Field(description="Width along the outline.")
    clear_mm: MillimetresOrZero = Field(
        default=3.0,
        description="Distance from its middle that lenses as wide as `constraints.max_radius_mm`, holes, pins and "
        "bosses keep.",
    )


def _drawn(outline: Path | DrawnOutline | None) -> DrawnOutline | None:
    """The outline itself in place of the file that holds it: a spec needs that file no more."""
    with fault_of():
        return read_outline(outline) if isinstance(outline, Path) else outline


@public
class PlateSection(Section):
    """One moulded plate for all lenses of [lamps], its top in z = 0; without [lamps] it has one lens. Lenses for total
    internal reflection have a flange instead: no mould releases a wall that widens above a plate.
    """

    kind: Literal["rectangle", "round", "step"] = Field(
        default="rectangle", description='Outline, about the origin; "step": as drawn in a file.'
    )
    outline: Annotated[FilePath | DrawnOutline | None, AfterValidator(_drawn)] = Field(
        default=None,
        description="STEP file of the outline, in the coordinates of the lamps: one face or wires of lines and "
        "arcs in a plane of one z, or a flat body, whose top counts. Its openings become holes of the "
        "plate.",
    )
    thickness_mm: Millimetres = Field(description="Thickness, from z = 0 downwards.")
    draft_deg: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=1.0,
        description="Draft of the lenses' bores, of sides, holes, pins and bosses, which the lower half of a "
        "mould makes: sides and holes are as wide as stated in z = 0, a pin at its root, the bore of "
        "a boss at its closed end. A drawn outline and its slots stand upright.",
    )
    margin_mm: MillimetresOrZero | None = Field(
        default=None,
        description="Distance of the edge from lenses as wide as `constraints.max_radius_mm`; 2 where neither it "
        "nor a size is given.",
    )
    width_mm: Millimetres | None = Field(
        default=None, description="Width of a rectangle along x; left out, by `margin_mm`."
    )
    height_mm: Millimetres | None = Field(
        default=None, description="Height of a rectangle along y; left out, by `margin_mm`."
    )
    diameter_mm: Millimetres | None = Field(
        default=None, description="Diameter of a round plate; left out, by `margin_mm`."
    )
    corner_radius_mm: MillimetresOrZero = Field(default=0.0, description="Radius of the corners of a rectangle.")
    columns: _Lines | None = Field(
        default=None, description='Lenses along x; of lamps of kind "endless", whose plate has so many.'
    )
    rows: _Lines | None = Field(default=None, description='Lenses along y; of lamps of kind "endless".')
    holes: Annotated[tuple[PlateHole, ...], Field(max_length=_MOST_MARKS)] = Field(
        default=(), description="Holes through the plate, beside the lenses."
    )
    pins: Annotated[tuple[PlatePin, ...], Field(max_length=_MOST_MARKS)] = Field(
        default=(), description="Pins below the plate, beside the cavities."
    )
    bosses: Annotated[tuple[PlateBoss, ...], Field(max_length=_MOST_MARKS)] = Field(
        default=(), description="Screw domes below the plate, beside the lenses."
    )
    gate: PlateGate | None = Field(default=None, description="The gate of the mould; by default none is drawn.")

    @check
    def _sizes_go_with_the_outline(self) -> None:
        """Each size has something to be the size of, and the margin is given once."""
        if (self.kind == "step") != (self.outline is not None):
            raise ValueError('kind = "step" and outline go together: give both, or neither')
        wrong = next((name for name in _FOREIGN[self.kind] if getattr(self, name)), None)
        if wrong is not None:
            raise ValueError(f'{wrong} = {getattr(self, wrong):g} does not go with kind = "{self.kind}"; leave it out')
        if (self.width_mm is None) != (self.height_mm is None):
            raise ValueError("width_mm and height_mm go together: give both, or neither")
        size = self.diameter_mm or self.width_mm
        if size is not None and self.margin_mm is not None:
            raise ValueError(
                f"margin_mm = {self.margin_mm:g}: the size says where the edge is; leave out one of the two"
            )
        if (self.columns is None) != (self.rows is None):
            raise ValueError("columns and rows go together: give both, or neither")

    @check
    def _pins_do_not_end_in_a_point(self) -> None:
        for name, pin in self.marks:
            if not isinstance(pin, PlatePin):
                continue
            bore_mm = 0.0
            if isinstance(pin, PlateBoss):
                bore_mm = pin.bore_diameter_mm / 2.0 + self.slope * pin.bore_depth_mm
            if pin.radius_mm - self.slope * pin.height_mm <= bore_mm:
                raise ValueError(
                    f"draft_deg = {self.draft_deg:g}: {name} has no wall at its end; lower it, or make that thicker or "
                    "shorter"
                )

    @property
    def slope(self) -> float:
        """Tangent of the draft."""
        return tan(radians(self.draft_deg))

    @property
    def marks(self) -> tuple[tuple[str, PlateMark], ...]:
        """Holes, pins and bosses, each with its name in the spec."""
        marks: dict[str, tuple[PlateMark, ...]] = {"holes": self.holes, "pins": self.pins, "bosses": self.bosses}
        drawn = ((f"hole {number} of plate.outline", hole) for number, hole in enumerate(self._drawn_holes, 1))
        return *drawn, *((f"plate.{kind}.{number}", mark) for kind in marks for number, mark in enumerate(marks[kind]))

    @property
    def _drawn_holes(self) -> tuple[PlateHole, ...]:
        circles = self.outline.circles if isinstance(self.outline, DrawnOutline) else ()
        return tuple(PlateHole(place_mm=place, diameter_mm=2.0 * radius) for place, radius in circles)

    @property
    def all_holes(self) -> tuple[PlateHole, ...]:
        """Round holes, of the drawn outline and of its own."""
        return *self._drawn_holes, *self.holes

    @property
    def standing(self) -> tuple[PlatePin, ...]:
        """Pins and bosses."""
        return *self.pins, *self.bosses

    def lenses(self, lamps: LampsSection | None) -> Lamps:
        """Places and turns of its lenses: those of ``lamps``, or its rows and columns of an endless lattice."""
        if not isinstance(lamps, EndlessLamps):
            return lamps_of(lamps)
        across, up = lamps.lamps.period_mm or (0.0, 0.0)
        up, odd = (up, 0.0) if lamps.lattice == "rectangle" else (up / 2.0, 0.25)
        columns = self.columns or 0
        rows = self.rows or 0
        places = [
            (across * (i - 0.5 * (columns - 1) + odd * (-1.0) ** (j + 1) * (rows > 1)), up * (j - 0.5 * (rows - 1)))
            for j in range(rows)
            for i in range(columns)
        ]
        return Lamps.level(places)

    def size_mm(self, lenses: Lamps, lens_mm: float) -> tuple[float, float]:
        """Width and height; of a round plate its diameter twice. ``lens_mm``: radius of a lens."""
        if isinstance(self.outline, DrawnOutline):
            low, high = box_of_loop(self.outline.outer)
            return high[0] - low[0], high[1] - low[1]
        beyond = lens_mm + (_MARGIN_MM if self.margin_mm is None else self.margin_mm)
        if self.kind == "round":
            size = self.diameter_mm or 2.0 * (lenses.reach_mm + beyond)
            return size, size
        if self.width_mm is not None and self.height_mm is not None:
            return self.width_mm, self.height_mm
        reach_x, reach_y = (max(abs(place[axis]) for place in lenses.places_mm) for axis in (0, 1))
        return 2.0 * (reach_x + beyond), 2.0 * (reach_y + beyond)

    def to_edge_mm(self, place: Place, size_mm: tuple[float, float]) -> float:
        """Distance of a place from the edge of a plate of ``size_mm``, below 0 outside.

        Of a drawn outline also from its openings that are not round.
        """
        if isinstance(self.outline, DrawnOutline):
            beside = [-inside_by_mm(slot, place) for slot in self.outline.slots]
            return min([inside_by_mm(self.outline.outer, place), *beside])
        corner = size_mm[0] / 2.0 if self.kind == "round" else self.corner_radius_mm
        x, y = (abs(at) - width / 2.0 + corner for at, width in zip(place, size_mm, strict=True))
        return corner - hypot(max(x, 0.0), max(y, 0.0)) - min(max(x, y), 0.0)


def require_plate(plate: PlateSection, lamps: LampsSection | None, limits: ConstraintsSection) -> None:
    """Raise ``ValueError`` for a plate that does not hold its lenses, holes and pins, or of an unknown number of them.

    That the lenses do not overlap is asked of the lamps.
    """
    endless = isinstance(lamps, EndlessLamps)
    if endless != (plate.columns is not None):
        reason = "an infinite lattice needs them" if endless else 'they go with lamps of kind = "endless"'
        raise ValueError(f"plate.columns and plate.rows: {reason}; {'give both' if endless else 'leave them out'}")
    lenses = plate.lenses(lamps)
    lens_mm = limits.max_radius_mm
    if lenses.posed:
        raise ValueError(
            "plate: its lenses stand on z = 0 with their axes along z, [lamps] have heights or aims; leave these out "
            "(places_mm of x and y, no aims_mm), or [plate]"
        )
    if len(lenses) > _MOST_LENSES:
        raise ValueError(f"plate: {len(lenses)} lenses, at most {_MOST_LENSES}; take fewer columns, rows or lamps")
    size = plate.size_mm(lenses, lens_mm)
    if 2.0 * plate.corner_radius_mm > min(size) + _SAME_MM:
        raise ValueError(f"plate.corner_radius_mm = {plate.corner_radius_mm:g}: at most {min(size) / 2.0:.6g}")
    room = min(plate.to_edge_mm(place, size) for place in lenses.places_mm)
    if room < lens_mm - _SAME_MM and isinstance(plate.outline, DrawnOutline):
        x, y = min(lenses.places_mm, key=lambda place: plate.to_edge_mm(place, size))
        raise ValueError(
            f"plate.outline: a lens of {lens_mm:g} mm radius at ({x:.4g}, {y:.4g}) mm ends {lens_mm - room:.4g} mm "
            f"outside that of {plate.outline.origin}; draw it wider there, or move the lamps"
        )
    if room < lens_mm - _SAME_MM:
        field = "plate.diameter_mm" if plate.kind == "round" else "plate.width_mm and plate.height_mm"
        raise ValueError(
            f"{field} = {size[0]:g}{'' if plate.kind == 'round' else f' x {size[1]:g}'}: smaller than its lenses, of "
            f"which one ends {lens_mm - room:.4g} mm outside; leave it out, or add {rounded_up(2.0 * (lens_mm - room))}"
        )
    _require_clear(plate, size, lenses, limits)
    for number, boss in enumerate(plate.bosses):
        if boss.bore_depth_mm >= boss.height_mm + plate.thickness_mm:
            raise ValueError(
                f"plate.bosses.{number}.bore_depth_mm = {boss.bore_depth_mm:g}: goes through the plate; at most its "
                f"height_mm and plate.thickness_mm, {boss.height_mm + plate.thickness_mm:g}, less a wall"
            )
    if plate.gate is not None:
        _require_gate(plate, plate.gate, size, lenses, limits.max_radius_mm)


def _require_clear(plate: PlateSection, size: tuple[float, float], lenses: Lamps, limits: ConstraintsSection) -> None:
    """Raise ``ValueError`` for a hole or a pin across the edge, another one, a lens, or a cavity."""
    for number, (name, mark) in enumerate(plate.marks):
        beside = isinstance(mark, PlateHole | PlateBoss)  # a boss is so thick that the face above it would sink
        around, neighbour = (limits.max_radius_mm, "a lens") if beside else (limits.cavity_radius_mm, "a cavity")
        stated = f"{name}: a diameter of {mark.diameter_mm:g} mm at ({mark.place_mm[0]:g}, {mark.place_mm[1]:g}) mm"
        if plate.to_edge_mm(mark.place_mm, size) <= mark.radius_mm:
            raise ValueError(f"{stated} crosses the edge of the plate; move it inwards, or make the plate larger")
        away = min(mark.away_mm(place) for place in lenses.places_mm)
        if away <= mark.radius_mm + around:
            raise ValueError(
                f"{stated} meets {neighbour} of {around:g} mm radius, {away:.4g} mm away; move it between them"
            )
        for mark_name, mark_before in plate.marks[:number]:
            if mark.away_mm(mark_before.place_mm) <= mark.radius_mm + mark_before.radius_mm:
                raise ValueError(f"{stated} meets {mark_name}; move one of the two")


def _require_gate(
    plate: PlateSection, gate: PlateGate, size: tuple[float, float], lenses: Lamps, lens_mm: float
) -> None:
    """Raise ``ValueError`` for a gate that is not on the outline, or too near to a lens, a hole, a pin or a boss."""
    (x, y) = gate.place_mm
    off = plate.to_edge_mm(gate.place_mm, size)
    if abs(off) > _ON_EDGE_MM:
        side = "inside" if off > 0.0 else "outside of"
        raise ValueError(
            f"plate.gate.place_mm = ({x:g}, {y:g}): {abs(off):.4g} mm {side} the outline; move it onto that"
        )
    near = [(hypot(at[0] - x, at[1] - y) - lens_mm, "a lens") for at in lenses.places_mm]
    near += [(mark.away_mm(gate.place_mm) - mark.radius_mm, name) for name, mark in plate.marks]
    away, neighbour = min(near)
    if away < gate.clear_mm:
        raise ValueError(
            f"plate.gate: {away:.4g} mm from {neighbour}, but clear_mm = {gate.clear_mm:g}; move it along the edge"
        )
