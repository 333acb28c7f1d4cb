"""The plate seen along z: its outline and its openings as closed loops, and where each lens stands and is turned.

Solid and mesh of the plate are both made from the same loops, and its
volume follows from them in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from lensforge.scene.lens import Lens
from lensforge.spec.lamps_section import Lamps, Place
from lensforge.spec.plate_section import DrawnOutline, PlateBoss, PlateHole, PlateMark, PlatePin, PlateSection
from lensforge.surfaces.plane_loop import Loop, LoopEdge, area_mm2, box_of_loop, circle_at, drafted_scale

PLATE_TOP = "PLATE_TOP"
PLATE_BOTTOM = "PLATE_BOTTOM"
PLATE_SIDE = "PLATE_SIDE"
PLATE_BORE = "PLATE_BORE"
PLATE_HOLE = "PLATE_HOLE"
PIN_SIDE = "PIN_SIDE"
PIN_END = "PIN_END"
BOSS_BORE = "BOSS_BORE"
BOSS_ROOF = "BOSS_ROOF"
_SAME_MM = 1e-9
_Around = Float[np.ndarray, "n 2"]
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class PlateWall:
    """A wall of the plate, and the two things between which it is."""

    thickness_mm: float
    between: str


@dataclass(frozen=True)
class RoundWall:
    """A cone about the axis at ``place``, or a cylinder: its radii at its top, below z = 0, and at its foot."""

    place: Place
    radius_mm: float
    foot_mm: float
    depth_mm: float
    length_mm: float

    @property
    def volume_mm3(self) -> float:
        """Volume within."""
        return pi * self.length_mm * (self.radius_mm**2 + self.radius_mm * self.foot_mm + self.foot_mm**2) / 3.0

    @property
    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Its corners seen along +y, x and z: top and foot on the left, foot and top on the right."""
        x = self.place[0]
        top = -self.depth_mm
        foot = -self.depth_mm - self.length_mm
        left = [(x - self.radius_mm, top), (x - self.foot_mm, foot)]
        return np.array([*left, (x + self.foot_mm, foot), (x + self.radius_mm, top)])

    @property
    def growth_per_mm(self) -> float:
        """Relative growth of its radius per mm downwards."""
        return (self.foot_mm / self.radius_mm - 1.0) / self.length_mm


@dataclass(frozen=True)
class PlateLayout:
    """A plate of the spec, its width and height (mm), and the places, turns and kinds of its lenses."""

    plate: PlateSection
    size_mm: tuple[float, float]
    lenses: Lamps

    @property
    def outline(self) -> Loop:
        """Its outline in z = 0, counter-clockwise, without lines of zero length."""
        return self._outline(0.0)

    @property
    def foot(self) -> Loop:
        """Its outline at the bottom."""
        return self._outline(1.0)

    @property
    def inset_mm(self) -> float:
        """Length by which its outline is narrower at the bottom; 0 for a drawn outline."""
        return 0.0 if isinstance(self.plate.outline, DrawnOutline) else self.plate.slope * self.plate.thickness_mm

    def _outline(self, share: float) -> Loop:
        """Its outline at a share of the thickness; corners lose at most half of their radius."""
        if isinstance(self.plate.outline, DrawnOutline):
            return self.plate.outline.outer
        radius = self.plate.corner_radius_mm
        corner = radius - share * min(self.inset_mm, radius / 2.0)
        half = self.size_mm[0] / 2.0 - share * self.inset_mm, self.size_mm[1] / 2.0 - share * self.inset_mm
        if self.plate.kind == "round":
            return circle_at((0.0, 0.0), half[0])
        arcs = list[LoopEdge]()
        for x, y in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
            centre = (x * (half[0] - corner), y * (half[1] - corner))
            on_side = (x * half[0], centre[1])
            on_end = (centre[0], y * half[1])
            arcs.append(LoopEdge(*((on_side, on_end) if x * y > 0.0 else (on_end, on_side)), centre))
        lines = [LoopEdge(arc.end, next_arc.start) for arc, next_arc in zip(arcs, [*arcs[1:], arcs[0]], strict=True)]
        chain = [edge for pair in zip(arcs, lines, strict=True) for edge in pair]
        return tuple(
            edge for edge in chain if hypot(edge.end[0] - edge.start[0], edge.end[1] - edge.start[1]) > _SAME_MM
        )

    @property
    def slots(self) -> tuple[Loop, ...]:
        """Its non-round openings, each counter-clockwise."""
        return self.plate.outline.slots if isinstance(self.plate.outline, DrawnOutline) else ()

    @property
    def holes(self) -> tuple[RoundWall, ...]:
        """Its round holes."""
        length = self.plate.thickness_mm
        return tuple(self._drafted(hole.place_mm, hole.radius_mm, 0.0, length, 1.0) for hole in self.plate.all_holes)

    @property
    def standing(self) -> tuple[tuple[RoundWall, RoundWall | None], ...]:
        """Its pins and bosses, each with the bore that a boss has."""
        return tuple((self._pin(pin), self._bore(pin)) for pin in self.plate.standing)

    def _pin(self, pin: PlatePin) -> RoundWall:
        return self._drafted(pin.place_mm, pin.radius_mm, self.plate.thickness_mm, pin.height_mm, -1.0)

    def _bore(self, pin: PlatePin) -> RoundWall | None:
        if not isinstance(pin, PlateBoss):
            return None
        depth = self.plate.thickness_mm + pin.height_mm - pin.bore_depth_mm
        return self._drafted(pin.place_mm, pin.bore_diameter_mm / 2.0, depth, pin.bore_depth_mm, 1.0)

    def _drafted(self, place: Place, radius_mm: float, depth_mm: float, length_mm: float, way: float) -> RoundWall:
        foot_mm = radius_mm + way * self.plate.slope * length_mm
        return RoundWall(place, radius_mm, foot_mm, depth_mm, length_mm)

    def bore_scale(self, opening: _Around) -> float:
        """Factor from a cavity's rim, points (mm) in z = 0, to the foot of its bore."""
        return drafted_scale(opening, self.plate.slope, self.plate.thickness_mm)

    @property
    def box_mm(self) -> tuple[Place, Place]:
        """Least and largest x and y of its outline."""
        return box_of_loop(self.outline)

    @property
    def counted(self) -> list[str]:
        """Phrase for the number of its lenses, by kind."""
        lenses = self.lenses
        return [f"{len(kind.numbers)} × lens {kind.name}" for kind in lenses.kinds] or [f"{len(lenses)} × lens"]

    def of_each(self, values: Sequence[_Value]) -> list[_Value]:
        """For each lens the value of its kind."""
        return [values[kind] for kind in self.lenses.kind_of_each]

    def volume_mm3(self, lenses_mm3: Sequence[float], openings: Sequence[_Around]) -> float:
        """Volume of the plate in closed form, from those of a lens of each kind.

        ``lenses_mm3``: above z = 0 without a base. ``openings``: points (mm) at equal azimuths around their rims.
        """
        thickness = self.plate.thickness_mm
        bores_mm3 = [thickness * self._mean_bore_mm2(opening) for opening in openings]
        of_lenses_mm3 = sum(self.of_each(lenses_mm3)) - sum(self.of_each(bores_mm3))
        top, middle, foot = (area_mm2(self._outline(share)) for share in (0.0, 0.5, 1.0))
        mean_mm2 = (top + 4.0 * middle + foot) / 6.0 - sum(map(area_mm2, self.slots))
        pins_mm3 = sum(pin.volume_mm3 - (0.0 if bore is None else bore.volume_mm3) for pin, bore in self.standing)
        holes_mm3 = sum(hole.volume_mm3 for hole in self.holes)
        return of_lenses_mm3 + thickness * mean_mm2 + pins_mm3 - holes_mm3

    def _mean_bore_mm2(self, opening: _Around) -> float:
        scale = self.bore_scale(opening)
        return float(pi * np.mean(np.sum(opening**2, axis=1)) * (1.0 + scale + scale**2) / 3.0)

    def placed(self, points: Float[np.ndarray, "n d"], number: int) -> Float[np.ndarray, "n d"]:
        """Transform points (mm) from local coordinates of lens ``number`` to those of the plate; d is 2 or 3."""
        pose = self.lenses.lamps[number].pose
        width = points.shape[1]
        return np.asarray(points @ pose.rotation[:width, :width].T + pose.origin_mm[:width])

    def thinnest_wall(self, openings: Sequence[_Around]) -> PlateWall | None:
        """The thinnest wall at its holes, pins and bosses; ``openings``: points (mm) around cavities of each kind.

        None without any of them.
        """
        bores = self.of_each(
            [self.bore_scale(opening) * opening for opening in openings]
        )  # at the bottom, where all is widest
        plate = self.plate
        axes = np.array(self.lenses.places_mm)
        largest = max(float(np.hypot(*bore.T).max()) for bore in bores)
        widened = {name: self._at_bottom_mm(mark) for name, mark in plate.marks}
        walls = list[PlateWall]()
        for number, (name, mark) in enumerate(plate.marks):
            away = np.hypot(*(axes - mark.place_mm).T)
            near = np.flatnonzero(away <= away.min() + 2.0 * largest)
            gaps = {"the cavity of a lens": min(self._gap_mm(bores[k], int(k), mark.place_mm) for k in near)}
            gaps["the edge"] = plate.to_edge_mm(mark.place_mm, self.size_mm) - self.inset_mm
            for mark_name, neighbour in plate.marks[:number]:
                gaps[mark_name] = mark.away_mm(neighbour.place_mm) - widened[mark_name]
            walls += [PlateWall(gap - widened[name], f"{name} and {neighbour}") for neighbour, gap in gaps.items()]
            if isinstance(mark, PlateBoss):
                bore = self._bore(mark)
                assert bore is not None
                walls.append(PlateWall(self._pin(mark).foot_mm - bore.foot_mm, f"{name} and its bore"))
                roof_mm = plate.thickness_mm + mark.height_mm - mark.bore_depth_mm
                walls.append(PlateWall(roof_mm, f"the bore of {name} and the top of the plate"))
        return min(walls, key=lambda wall: wall.thickness_mm, default=None)

    def _at_bottom_mm(self, mark: PlateMark) -> float:
        return mark.radius_mm + (self.plate.slope * self.plate.thickness_mm if isinstance(mark, PlateHole) else 0.0)

    def _gap_mm(self, opening: _Around, number: int, place: Place) -> float:
        """Distance (mm) of a place from the opening of a lens, negative within its smallest radius."""
        nearest = float(np.hypot(*(self.placed(opening, number) - place).T).min())
        axis = self.lenses.places_mm[number]
        inside = hypot(place[0] - axis[0], place[1] - axis[1]) < float(np.hypot(*opening.T).min())
        return -nearest if inside else nearest


def layout_of(lens: Lens) -> PlateLayout | None:
    """The plate of the spec of ``lens``; None if it has none."""
    plate = lens.spec.plate
    spec = lens.spec
    if plate is None:
        return None
    lenses = plate.lenses(spec.lamps)
    return PlateLayout(plate, plate.size_mm(lenses, spec.constraints.max_radius_mm), lenses)
