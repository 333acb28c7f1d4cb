"""The plan of the body seen along the axis, as radius over azimuth, and the section of its base, as a chain of corners.

The seat, where the base begins, is the outer rim, or the wall of a step that is set back from it. It may lie inside the
outline (a *ledge* of the base projects), outside (the dome *overhangs* the base), on it (*flush*), or *cross* the
outline. Mesh and solid are both built arc by arc from this plan, so neither needs a boolean operation.

The corners go from the outer rim around the outside, the bottom and the bore to the cavity. Mesh, drawings and the
obstacles of tools are made from them. The solid has them as edges of its faces.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Generic

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import Boundary, Shape, StarShaped, TrimmedFace, as_pair, optical_name
from lensforge.cad.flange import FlangeRing
from lensforge.cad.outline import FULL_TURN, Arc, Outline, Radius, arcs_between, circle, outline_of, sampled_azimuths
from lensforge.errors import InputError, remedy
from lensforge.optics.face_roles import DOUBLE
from lensforge.spec import BaseSection
from lensforge.spec.part_section import FeetSection
from lensforge.surfaces.plane_loop import drafted_scale
from lensforge.surfaces.surface import grid, to_sphere

MIN_BASE_WALL_MM = 0.01
_WALL_NODES = 96  # chart nodes at which the wall is tested


@dataclass(frozen=True)
class Plan(Generic[Shape]):
    """Boundaries of the cavity of a lens and of its body, its base, and the arcs of the seat, which go once around.

    ``ring``: the circle of a relief step's wall that is set back from the outer rim; it is then the seat. ``bore``: the
    circle of a bore that is set back from the cavity's rim. ``rim_flange``: of a lens for total internal reflection.
    """

    cavity: Boundary[Shape]
    envelope: Boundary[Shape]
    base: BaseSection
    arcs: tuple[Arc, ...]
    ring: Outline | None = None
    bore: Outline | None = None
    rim_flange: FlangeRing | None = None

    @property
    def faces(self) -> tuple[TrimmedFace[Shape], ...]:
        """The optical faces, those of the envelope first, and the ring around an opening."""
        return self.envelope.of_material + self.cavity.of_material

    @property
    def has_base(self) -> bool:
        """True if the body extends below z = 0; a base from a STEP file is joined later."""
        return self.base.kind in ("cylinder", "square")

    @property
    def outline(self) -> Outline:
        """The base seen along the axis, without its flange."""
        return outline_of(self.base)

    @property
    def flange(self) -> Outline | None:
        """The wider ring at the bottom."""
        return None if self.base.flange_diameter_mm is None else circle(self.base.flange_diameter_mm / 2.0)

    @property
    def pocket(self) -> Outline | None:
        """The wider bore at the bottom."""
        return None if self.base.pocket_diameter_mm is None else circle(self.base.pocket_diameter_mm / 2.0)

    @property
    def flush(self) -> bool:
        """True if the outer rim is the base's outline."""
        return self.arcs[0].relation == "flush"

    @property
    def relief_mm(self) -> float:
        """Depth below z = 0 at which the base's outline begins; a flush base has no step."""
        return 0.0 if self.flush else self.base.step_mm

    @property
    def shoulder_mm(self) -> float:
        """Depth below z = 0 at which the base's outline ends: at the flange or at the bottom."""
        return self.base.height_mm - (0.0 if self.flange is None else self.base.flange_height_mm)

    @property
    def bore_mm(self) -> float:
        """Depth below z = 0 at which the bore ends: at the pocket or at the bottom."""
        return self.base.height_mm - (0.0 if self.pocket is None else self.base.pocket_depth_mm)

    @property
    def crossings(self) -> Float[np.ndarray, " k"]:
        """Azimuths (rad) at which the seat crosses the outline; none or an even number."""
        return np.array([arc.start for arc in self.arcs] if len(self.arcs) > 1 else [])

    @property
    def breaks(self) -> Float[np.ndarray, " k"]:
        """Azimuths (rad) at which the mesh must have a vertex: crossings, and corners of the outline."""
        return np.sort(np.concatenate([self.crossings, self.outline.corners])) if self.has_base else self.crossings


def rim_directions(azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Unit directions in the plane z = 0; the last column is exactly 0."""
    return np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)


def make_plan(
    cavity: Shape | Boundary[Shape],
    envelope: Shape | Boundary[Shape],
    base: BaseSection,
    rim_flange: FlangeRing | None = None,
) -> Plan[Shape]:
    """Lay out the body. Raises :class:`InputError` if the surfaces touch or the base cannot hold the cavity."""
    with remedy("raise constraints.min_thickness_mm and design again"):
        _require_wall(*as_pair(cavity, envelope))
    if base.kind in ("cylinder", "square"):
        _require_opening_inside(cavity, base, outline_of(base))
    if base.feet is not None:
        _require_feet_beside(base.feet, lay_out(cavity, envelope, base))
    plan = replace(lay_out(cavity, envelope, base), rim_flange=rim_flange)
    if plan.has_base and base.draft_deg:
        _require_room_for_draft(plan)
    met = len(plan.arcs) > 1 or (plan.ring is not None and plan.flush)
    if base.step_mm > 0.0 and met:
        widths = 2.0 * (rim_radius(envelope) if plan.ring is None else plan.ring.radius)(sampled_azimuths())
        raise InputError(
            f"base.relief_step_mm = {base.step_mm:g}: the wall of the step, {widths.min():.4g} to "
            f"{widths.max():.4g} mm wide, meets the side of the base; make the base wider, or set the step to 0"
        )
    return plan


def lay_out(cavity: Shape | Boundary[Shape], envelope: Shape | Boundary[Shape], base: BaseSection) -> Plan[Shape]:
    """The plan of a body that need not be feasible, for a drawing; a single face is that of a double-freeform lens.

    Raises :class:`InputError` if a setback leaves nothing of the base.
    """
    inwards, outwards = as_pair(cavity, envelope)
    if base.kind in ("none", "step"):
        return Plan(inwards, outwards, base, (Arc(0.0, FULL_TURN, "bare"),))
    outline = outline_of(base)
    bore = _bore(inwards, base, outline)
    ring = _relief_ring(inwards if bore is None else bore, outwards, base)
    seat = rim_radius(outwards) if ring is None else ring.radius
    return Plan(inwards, outwards, base, arcs_between(seat, outline), ring, bore)


def rim_radius(face: StarShaped) -> Radius:
    """Distance (mm) of a face's rim from the axis, over azimuths."""
    return lambda azimuths: face.radius(rim_directions(azimuths))


def rim_points(face: StarShaped) -> Float[np.ndarray, "n 2"]:
    """Points (mm) of a face's rim at equal azimuths."""
    azimuths = sampled_azimuths()
    return rim_radius(face)(azimuths)[:, None] * rim_directions(azimuths)[:, :2]


def _bore(cavity: StarShaped, base: BaseSection, outline: Outline) -> Outline | None:
    """The bore's circle; None if it is extruded from the cavity's rim."""
    if not base.bore_setback_mm:
        return None
    azimuths = sampled_azimuths()
    opening = float(rim_radius(cavity)(azimuths).max())
    room = float(outline.radius(azimuths).min())
    if base.pocket_diameter_mm is not None:
        room = min(room, base.pocket_diameter_mm / 2.0)
    if base.bore_setback_mm > room - opening - MIN_BASE_WALL_MM:
        raise InputError(
            f"base.bore_setback_mm = {base.bore_setback_mm:g}: the bore must fit inside the base and its pocket; "
            f"at most {room - opening - MIN_BASE_WALL_MM:.4g}"
        )
    return circle(opening + base.bore_setback_mm)


def _relief_ring(opening: StarShaped | Outline, envelope: StarShaped, base: BaseSection) -> Outline | None:
    """The wall of a step that is set back from the outer rim; None if it is extruded from the rim."""
    if not base.relief_setback_mm:
        return None
    azimuths = sampled_azimuths()
    hole = opening.radius(azimuths) if isinstance(opening, Outline) else rim_radius(opening)(azimuths)
    rim = rim_radius(envelope)(azimuths)
    room = float(rim.min() - hole.max()) - MIN_BASE_WALL_MM
    if base.relief_setback_mm > room:
        raise InputError(
            f"base.relief_setback_mm = {base.relief_setback_mm:g}: the step's wall would open the cavity or its bore; "
            f"at most {room:.4g}"
        )
    return circle(float(rim.min()) - base.relief_setback_mm)


def _require_wall(cavity: Boundary[Any], envelope: Boundary[Any]) -> None:
    chart = grid(_WALL_NODES, half_width=1.0).reshape(-1, 2)
    directions = to_sphere(chart[np.sum(chart**2, axis=1) <= 1.0])
    directions = np.concatenate([directions, rim_directions(sampled_azimuths())])
    directions = directions[cavity.closed(directions)]
    wall = envelope.radius(directions) - cavity.radius(directions)
    worst = int(np.argmin(wall))
    if wall[worst] <= 0.0:
        x, y, z = directions[worst]
        raise InputError(
            f"wall = {wall[worst]:.4g} mm in the direction ({x:.3f}, {y:.3f}, {z:.3f}): the outer surface must lie "
            "outside the inner one"
        )


def _require_opening_inside(cavity: StarShaped, base: BaseSection, outline: Outline) -> None:
    azimuths = sampled_azimuths()
    opening = cavity.radius(rim_directions(azimuths)) + MIN_BASE_WALL_MM
    needed = float((opening / outline.radius(azimuths)).max())
    field, value = ("side_mm", base.side_mm) if base.kind == "square" else ("diameter_mm", base.diameter_mm)
    if needed > 1.0:
        least = f"at least {value * needed:.4g}, or base.kind = 'none'"
        if base.flat_mm is not None and opening.max() < value / 2.0:
            field = "flat_mm"
            value = base.flat_mm
            least = f"at least {opening.max():.4g}"
        raise InputError(
            f"base.{field} = {value:g}: the cavity opens to {2.0 * (opening.max() - MIN_BASE_WALL_MM):.4g} mm "
            f"and must fit inside; {least}"
        )
    pocket = base.pocket_diameter_mm
    room = 2.0 * (float(outline.radius(azimuths).min()) - MIN_BASE_WALL_MM)
    if pocket is not None and not 2.0 * opening.max() <= pocket <= room:
        raise InputError(
            f"base.pocket_diameter_mm = {pocket:g}: from {2.0 * opening.max():.4g}, wider than the cavity, "
            f"to {room:.4g}, inside the base"
        )


def _require_room_for_draft(plan: Plan[Any]) -> None:
    """Raise if draft leaves nothing of the bottom, a pocket, the top of a flange, or the ends of feet."""
    turns = sampled_azimuths()
    base = plan.base
    room = {"feet": MIN_BASE_WALL_MM if base.feet is None else base.foot_radii_mm[1]}
    for corner, next_corner in pairwise(base_corners(plan)):
        if corner.face in (BOTTOM, POCKET_TOP, FLANGE_TOP):
            inwards = corner.radius(turns) - next_corner.radius(turns)
            room[corner.face] = float((-inwards if corner.face == FLANGE_TOP else inwards).min())
    if (lacks := next((name for name, wide_mm in room.items() if wide_mm < MIN_BASE_WALL_MM), None)) is not None:
        raise InputError(f"base.draft_deg = {base.draft_deg:g}: leaves no {lacks}; take less, or a wider base")


def _require_feet_beside(feet: FeetSection, plan: Plan[Any]) -> None:
    """Test feet against the opening in the bottom: the bore or its pocket."""
    opening = max((corner.radius(sampled_azimuths()).max() for corner in _bore_corners(plan)), default=0.0)
    least = 2.0 * float(opening) + feet.diameter_mm + 2.0 * MIN_BASE_WALL_MM
    if feet.circle_diameter_mm < least:
        raise InputError(
            f"base.feet.circle_diameter_mm = {feet.circle_diameter_mm:g}: the feet stand in the opening of the base, "
            f"{2.0 * opening:.4g} mm wide; at least {least:.4g}"
        )


INNER, OUTER = map(optical_name, DOUBLE)
RIM = "RIM"
TOP = "BASE_TOP"
SIDE = "BASE_SIDE"
BOTTOM = "BASE_BOTTOM"
BORE = "BASE_BORE"
BORE_TOP = "BORE_TOP"
RELIEF = "BASE_RELIEF"
FLANGE_TOP = "FLANGE_TOP"
FLANGE_SIDE = "FLANGE_SIDE"
POCKET_SIDE = "POCKET_SIDE"
POCKET_TOP = "POCKET_TOP"
FOOT_SIDE = "FOOT_SIDE"
FOOT_END = "FOOT_END"
RIM_FLANGE_TOP = "RIM_FLANGE_TOP"
RIM_FLANGE_SIDE = "RIM_FLANGE_SIDE"
RIM_FLANGE_BOTTOM = "RIM_FLANGE_BOTTOM"


@dataclass(frozen=True)
class Corner:
    """A closed line around the body: its distance (mm) from the axis over azimuths, and its depth (mm) below z = 0.

    ``face``: the name of the face between it and the next corner.
    """

    radius: Radius
    depth_mm: float
    face: str


def base_corners(plan: Plan[Any]) -> list[Corner]:
    """The corners from the outer rim to the last one before the cavity's rim; the outer rim alone without a base."""
    rim = rim_radius(plan.envelope)
    if not plan.has_base:
        return [Corner(rim, 0.0, RIM)]
    return [*_seat_corners(plan, rim), *_foot_corners(plan), *_bore_corners(plan)]


def _seat_corners(plan: Plan[Any], rim: Radius) -> list[Corner]:
    if plan.ring is not None:
        wall = plan.ring.radius
        return [Corner(rim, 0.0, RIM), Corner(wall, 0.0, RELIEF), Corner(wall, plan.relief_mm, TOP)]
    if plan.relief_mm > 0.0:
        return [Corner(rim, 0.0, RELIEF), Corner(rim, plan.relief_mm, TOP)]
    return [Corner(rim, 0.0, TOP)]


def _foot_corners(plan: Plan[Any]) -> list[Corner]:
    side = plan.outline.radius
    height = plan.base.height_mm
    way = -1.0 if plan.flange is None else 1.0
    top = Corner(side, plan.relief_mm, SIDE)
    foot = _drafted(plan, side, way, plan.shoulder_mm - plan.relief_mm)
    if plan.flange is None:
        return [top, Corner(foot, height, BOTTOM)]
    wide = plan.flange.radius
    shoulder_mm = plan.shoulder_mm
    end = _drafted(plan, wide, -1.0, height - shoulder_mm)
    return [
        top,
        Corner(foot, shoulder_mm, FLANGE_TOP),
        Corner(wide, shoulder_mm, FLANGE_SIDE),
        Corner(end, height, BOTTOM),
    ]


def _bore_corners(plan: Plan[Any]) -> list[Corner]:
    corners = []
    if plan.pocket is not None:
        pocket = plan.pocket.radius
        depth_mm = plan.base.pocket_depth_mm
        mouth = _drafted(plan, pocket, 1.0, depth_mm)
        corners += [Corner(mouth, plan.base.height_mm, POCKET_SIDE), Corner(pocket, plan.bore_mm, POCKET_TOP)]
    bore = rim_radius(plan.cavity) if plan.bore is None else plan.bore.radius
    corners.append(Corner(_drafted(plan, bore, 1.0, plan.bore_mm), plan.bore_mm, BORE))
    return corners if plan.bore is None else [*corners, Corner(bore, 0.0, BORE_TOP)]


def _drafted(plan: Plan[Any], top: Radius, way: float, length_mm: float) -> Radius:
    """The foot of a wall below a closed line; ``way``: 1 if it widens downwards, else -1."""
    azimuths = sampled_azimuths()
    if plan.base.slope == 0.0:
        return top
    scale = drafted_scale(top(azimuths)[:, None] * rim_directions(azimuths)[:, :2], way * plan.base.slope, length_mm)
    return lambda around: scale * top(around)


def foot_scale(plan: Plan[Any], face: str) -> float:
    """Factor from the top of the wall ``face`` to its foot."""
    corners = [*base_corners(plan), Corner(rim_radius(plan.cavity), 0.0, "")]
    ends = next(corner_pair for corner_pair in pairwise(corners) if corner_pair[0].face == face)
    top, foot = (float(end.radius(np.zeros(1))[0]) for end in sorted(ends, key=lambda end: end.depth_mm))
    return foot / top
