"""The plate seen along z: its outline and its openings as closed loops, and where each lens stands and is turned.

Solid and mesh of the plate are both made from the same loops, and its
volume follows from them in closed form.
"""

from dataclasses import dataclass
from math import hypot, pi

import numpy as np
from jaxtyping import Float

from lensforge.scene.lens import Lens
from lensforge.spec.lamps_section import Lamps, Place
from lensforge.spec.plate_section import DrawnOutline, PlateBoss, PlateSection
from lensforge.surfaces.plane_loop import Loop, LoopEdge, area_mm2, box_of_loop, circle_at


@dataclass(frozen=True)
class PlateWall:
    """A wall of the plate, and between which two things it is."""

    thickness_mm: float
    between: str


@dataclass(frozen=True)
class PlateLayout:
    """A plate of the spec, its width and height (mm), and the places and turns of its lenses."""

    plate: PlateSection
    size_mm: tuple[float, float]
    lenses: Lamps

    @property
    def outline(self) -> Loop:
        """Its outline, counter-clockwise; lines of no length are left out."""
        if isinstance(self.plate.outline, DrawnOutline):
            return self.plate.outline.outer
        corner, half = self.plate.corner_radius_mm, (self.size_mm[0] / 2.0, self.size_mm[1] / 2.0)
        if self.plate.kind == "round":
            return circle_at((0.0, 0.0), half[0])
        arcs = list[LoopEdge]()
        for x, y in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
            centre = (x * (half[0] - corner), y * (half[1] - corner))
            on_side, on_end = (x * half[0], centre[1]), (centre[0], y * half[1])
            arcs.append(LoopEdge(*((on_side, on_end) if x * y > 0.0 else (on_end, on_side)), centre))
        lines = [LoopEdge(one.end, other.start) for one, other in zip(arcs, [*arcs[1:], arcs[0]], strict=True)]
        chain = [edge for pair in zip(arcs, lines, strict=True) for edge in pair]
        return tuple(edge for edge in chain if edge.end != edge.start)

    @property
    def openings(self) -> tuple[Loop, ...]:
        """Its holes and other openings, each counter-clockwise, without those of the lenses."""
        drawn = self.plate.outline.slots if isinstance(self.plate.outline, DrawnOutline) else ()
        return *(circle_at(hole.place_mm, hole.radius_mm) for hole in self.plate.all_holes), *drawn

    @property
    def box_mm(self) -> tuple[Place, Place]:
        """Least and largest x and y of its outline."""
        return box_of_loop(self.outline)

    def volume_mm3(self, lens_mm3: float, opening_mm2: float) -> float:
        """Volume of the plate in closed form.

        ``lens_mm3``: of one lens above z = 0 without a base. ``opening_mm2``: area of its cavity's rim.
        """
        count, plate = len(self.lenses), self.plate
        open_mm2 = count * opening_mm2 + sum(area_mm2(opening) for opening in self.openings)
        pins_mm3 = sum(pi * pin.radius_mm**2 * pin.height_mm for pin in plate.standing)
        pins_mm3 -= sum(pi * boss.bore_diameter_mm**2 / 4.0 * boss.bore_depth_mm for boss in plate.bosses)
        return count * lens_mm3 + plate.thickness_mm * (area_mm2(self.outline) - open_mm2) + pins_mm3

    def placed(self, points: Float[np.ndarray, "n d"], number: int) -> Float[np.ndarray, "n d"]:
        """Points (mm) of the lens, in its own coordinates, at the place and turn of lens ``number``; d is 2 or 3."""
        pose, width = self.lenses.lamps[number].pose, points.shape[1]
        return np.asarray(points @ pose.rotation[:width, :width].T + pose.origin_mm[:width])

    def thinnest_wall(self, opening: Float[np.ndarray, "n 2"]) -> PlateWall | None:
        """The thinnest wall at its holes, pins and bosses; ``opening``: points (mm) around a cavity in z = 0.

        None where it has none of them.
        """
        plate, axes, largest = self.plate, np.array(self.lenses.places_mm), float(np.hypot(*opening.T).max())
        found = list[PlateWall]()
        for number, (name, mark) in enumerate(plate.marks):
            away = np.hypot(*(axes - mark.place_mm).T)
            near = np.flatnonzero(away <= away.min() + 2.0 * largest)
            gaps = {"the cavity of a lens": min(self._gap_mm(opening, int(k), mark.place_mm) for k in near)}
            gaps["the edge"] = plate.to_edge_mm(mark.place_mm, self.size_mm)
            for other, one in plate.marks[:number]:
                gaps[other] = mark.away_mm(one.place_mm) - one.radius_mm
            found += [PlateWall(gap - mark.radius_mm, f"{name} and {other}") for other, gap in gaps.items()]
            if isinstance(mark, PlateBoss):
                found.append(PlateWall(mark.radius_mm - mark.bore_diameter_mm / 2.0, f"{name} and its bore"))
                roof_mm = plate.thickness_mm + mark.height_mm - mark.bore_depth_mm
                found.append(PlateWall(roof_mm, f"the bore of {name} and the top of the plate"))
        return min(found, key=lambda wall: wall.thickness_mm, default=None)

    def _gap_mm(self, opening: Float[np.ndarray, "n 2"], number: int, place: Place) -> float:
        """Distance (mm) of a place from the opening of a lens, below 0 within its smallest radius."""
        nearest = float(np.hypot(*(self.placed(opening, number) - place).T).min())
        axis = self.lenses.places_mm[number]
        inside = hypot(place[0] - axis[0], place[1] - axis[1]) < float(np.hypot(*opening.T).min())
        return -nearest if inside else nearest


def layout_of(lens: Lens) -> PlateLayout | None:
    """The plate of the spec of ``lens``; None where it has none."""
    plate, spec = lens.spec.plate, lens.spec
    if plate is None:
        return None
    lenses = plate.lenses(spec.lamps)
    return PlateLayout(plate, plate.size_mm(lenses, spec.constraints.max_radius_mm), lenses)
