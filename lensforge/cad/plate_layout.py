"""The plate seen along z: its outline and its round openings as closed loops, and where each lens stands and is turned.

A loop is a chain of straight lines and arcs. Solid and mesh of the plate are both made from the same loops, and its
volume follows from them in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, pi, sin

import numpy as np
from jaxtyping import Float

from lensforge.cad.outline import FULL_TURN
from lensforge.cad.plan import MIN_BASE_WALL_MM, rim_directions
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.spec.lamps_section import Lamps, Place
from lensforge.spec.plate_section import PlateHole, PlatePin, PlateSection

Ends = tuple[float, float]  # azimuths (rad)


@dataclass(frozen=True)
class Edge:
    """A line from ``start`` to ``end`` (mm), or an arc between them, counter-clockwise about ``centre``.

    An arc that ends where it starts is a whole circle.
    """

    start: Place
    end: Place
    centre: Place | None = None

    @property
    def radius_mm(self) -> float:
        """Radius of an arc; 0 of a line."""
        return 0.0 if self.centre is None else hypot(self.start[0] - self.centre[0], self.start[1] - self.centre[1])

    @property
    def azimuths(self) -> Ends:
        """Azimuths (rad) of an arc's ends about its centre, the second one larger."""
        x, y = self.centre or (0.0, 0.0)
        first, last = (atan2(point[1] - y, point[0] - x) for point in (self.start, self.end))
        return first, last if last > first + 1e-9 else last + FULL_TURN

    @property
    def twice_area_mm2(self) -> float:
        """Integral of x dy - y dx along it."""
        (x0, y0), (x1, y1) = self.start, self.end
        if self.centre is None:
            return x0 * y1 - y0 * x1
        first, last = self.azimuths
        return self.radius_mm**2 * (last - first) + self.centre[0] * (y1 - y0) - self.centre[1] * (x1 - x0)

    def points(self, chord_mm: float) -> Float[np.ndarray, "n 2"]:
        """Points from its start up to, and without, its end; chords of an arc are within ``chord_mm`` of it."""
        if self.centre is None:
            return np.array([self.start])
        first, last = self.azimuths
        step = 2.0 * np.arccos(max(1.0 - chord_mm / self.radius_mm, 0.5))
        turns = np.linspace(first, last, max(ceil((last - first) / step), 2), endpoint=False)
        return np.array(self.centre) + self.radius_mm * rim_directions(turns)[:, :2]


Loop = tuple[Edge, ...]


def circle_at(place: Place, radius_mm: float) -> Loop:
    """The circle about ``place``, counter-clockwise from +x."""
    start = (place[0] + radius_mm, place[1])
    return (Edge(start, start, place),)


def area_mm2(loop: Loop) -> float:
    """Area (mm^2) within a loop that runs counter-clockwise."""
    return sum(edge.twice_area_mm2 for edge in loop) / 2.0


def points_on(loop: Loop, chord_mm: float) -> Float[np.ndarray, "n 2"]:
    """Points (mm) along the loop."""
    return np.concatenate([edge.points(chord_mm) for edge in loop])


@dataclass(frozen=True)
class PlateLayout:
    """Outline, thickness (mm), holes and pins of a plate, and the places and turns of its lenses."""

    outline: Loop
    thickness_mm: float
    lenses: Lamps
    holes: tuple[PlateHole, ...]
    pins: tuple[PlatePin, ...]

    @property
    def marks(self) -> tuple[Loop, ...]:
        """Circles of the holes, then of the pins."""
        return tuple(circle_at(mark.place_mm, mark.radius_mm) for mark in (*self.holes, *self.pins))

    def volume_mm3(self, lens_mm3: float, opening_mm2: float) -> float:
        """Volume of the plate in closed form.

        ``lens_mm3``: of one lens above z = 0 without a base. ``opening_mm2``: area of its cavity's rim.
        """
        open_mm2 = len(self.lenses) * opening_mm2 + sum(pi * hole.radius_mm**2 for hole in self.holes)
        pins_mm3 = sum(pi * pin.radius_mm**2 * pin.height_mm for pin in self.pins)
        return len(self.lenses) * lens_mm3 + self.thickness_mm * (area_mm2(self.outline) - open_mm2) + pins_mm3

    def placed(self, points: Float[np.ndarray, "n d"], number: int) -> Float[np.ndarray, "n d"]:
        """Points (mm) of the lens, in its own coordinates, at the place and turn of lens ``number``; d is 2 or 3."""
        turn = self.lenses.turns_deg[number] * pi / 180.0
        moved = np.array(points)
        if turn:
            moved[:, :2] = points[:, :2] @ np.array([[cos(turn), sin(turn)], [-sin(turn), cos(turn)]])
        moved[:, :2] += self.lenses.places_mm[number]
        return moved


def layout_of(lens: Lens) -> PlateLayout | None:
    """The plate of the spec of ``lens``; None where it has none."""
    plate, spec = lens.spec.plate, lens.spec
    if plate is None:
        return None
    lenses = plate.lenses(spec.lamps)
    size = plate.size_mm(lenses, spec.constraints.max_radius_mm)
    return PlateLayout(_outline(plate, size), plate.thickness_mm, lenses, plate.holes, plate.pins)


def _outline(plate: PlateSection, size_mm: tuple[float, float]) -> Loop:
    """The outline, counter-clockwise; lines of no length are left out."""
    if plate.kind == "round":
        return circle_at((0.0, 0.0), size_mm[0] / 2.0)
    corner, half = plate.corner_radius_mm, (size_mm[0] / 2.0, size_mm[1] / 2.0)
    edges = list[Edge]()
    for x, y in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
        centre = (x * (half[0] - corner), y * (half[1] - corner))
        along_x, along_y = (x * half[0], centre[1]), (centre[0], y * half[1])  # where sides across x and y end
        ends = (along_x, along_y) if x * y > 0.0 else (along_y, along_x)
        edges.append(Edge(*ends, centre))
    lines = [Edge(one.end, other.start) for one, other in zip(edges, [*edges[1:], edges[0]], strict=True)]
    chain = [edge for pair in zip(edges, lines, strict=True) for edge in pair]
    return tuple(edge for edge in chain if hypot(edge.end[0] - edge.start[0], edge.end[1] - edge.start[1]) > 0.0)


def require_walls(layout: PlateLayout, opening: Float[np.ndarray, "n 2"]) -> None:
    """Raise :class:`InputError` for a pin that meets a cavity, whose ``opening`` (mm) in z = 0 are points around it."""
    for number, pin in enumerate(layout.pins):
        wall = _least_mm(layout, opening, pin.place_mm) - pin.radius_mm
        if wall < MIN_BASE_WALL_MM:
            raise InputError(
                f"plate.pins.{number}: its wall to the cavity of a lens is {wall:.4g} mm; allowed: at least "
                f"{MIN_BASE_WALL_MM:g}; move it between the lenses, or take a smaller one"
            )


def _least_mm(layout: PlateLayout, opening: Float[np.ndarray, "n 2"], place: Sequence[float]) -> float:
    """Distance (mm) of ``place`` from the nearest opening; below 0 inside, by its distance from the axis there."""
    found = []
    for number, axis in enumerate(layout.lenses.places_mm):
        ways = layout.placed(opening, number) - place
        nearest = float(np.hypot(*ways.T).min())
        inside = hypot(place[0] - axis[0], place[1] - axis[1]) < float(np.hypot(*opening.T).min())
        found.append(-nearest if inside else nearest)
    return min(found)
