"""Lines of the views: sections through the axis, the part seen from its base along +z, and its dome seen along -z.

All have the axis level or across the paper; first angle. In the section S-S x points up and z to the right; the view
from the base, y to the right, stands to its right, the view of the dome, y to the left, to its left.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from lensforge.cad.boundary import Boundary, lens_boundaries
from lensforge.cad.cutter_room import lens_plan
from lensforge.cad.flange import ring_of
from lensforge.cad.mesh import manifold_of
from lensforge.cad.plan import BORE, BORE_TOP, POCKET_SIDE, POCKET_TOP, Plan, base_corners, rim_directions, rim_radius
from lensforge.cad.section import body_outlines
from lensforge.scene.lens import Lens
from lensforge.shop.sheet import PenName, Points
from lensforge.surfaces.surface import Surface

# Of the curves of a view, and of the meridians whose widest place is the silhouette: 1 um on a lens of 14 mm, a
# hundredth of a line's width at 5 : 1. Twice as many of each cost 6 s on a lens of 400 functions.
_AZIMUTHS = 361
_POLAR = 91
_CLOSER = 3  # rounds of a search for a silhouette at a crease
_BESIDE = 21  # its places in each round
_BEYOND_MM = 1e-4  # silhouettes nearer to the cut are not drawn beside it
_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class ViewLine:
    """A line of a view (mm, in the view's own axes)."""

    points: Points
    closed: bool = True
    pen: PenName = "outline"


@dataclass(frozen=True)
class SectionView:
    """A section at ``azimuth_deg`` in (z, across): closed ``outlines`` of the cut, and ``lines`` behind it."""

    letter: str
    azimuth_deg: float
    outlines: list[Points]
    lines: list[ViewLine]


def section_view(lens: Lens, letter: str, azimuth_deg: float) -> SectionView:
    """The section through the axis at ``azimuth_deg``, which points up."""
    outlines = [outline[:, ::-1] for outline in body_outlines(lens, azimuth_deg)]
    edges = [ViewLine(edge, closed=False) for edge in _edges(lens, np.radians(azimuth_deg))]
    behind = [*_silhouettes(lens, np.radians(azimuth_deg)), *_creases(lens, np.radians(azimuth_deg))]
    return SectionView(letter, azimuth_deg, outlines, [*edges, *behind])


def _edges(lens: Lens, azimuth: float) -> list[Points]:
    """Edges of cavity, bore and pocket behind the plane of the section, across the opening."""
    turns = azimuth + np.array([0.0, np.pi])
    plan = lens_plan(lens)
    of_hole = (corner for corner in base_corners(plan) if corner.face in (BORE, BORE_TOP, POCKET_SIDE, POCKET_TOP))
    holes = [(0.0, rim_radius(plan.cavity)), *((-corner.depth_mm, corner.radius) for corner in of_hole)]
    return [np.array([(z, -left), (z, right)]) for z, hole in holes for right, left in [hole(turns).tolist()]]


def _silhouettes(lens: Lens, azimuth: float) -> list[ViewLine]:
    """Silhouette of the dome where it is wider behind the plane of the section."""
    across, towards = rim_directions(np.array([azimuth, azimuth + 0.5 * np.pi]))
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _AZIMUTHS)
    plane = np.sin(turn)[:, None] * across + np.cos(turn)[:, None] * _AXIS
    plane[[0, -1], 2] = 0.0  # the rim lies in z = 0 exactly
    cut = lens_boundaries(lens)[1].radius(plane)
    behind = _seen_along(lens, plane, -towards)
    line = np.column_stack([behind * np.cos(turn), behind * np.sin(turn)])
    return _pieces(line, behind > cut + _BEYOND_MM, "outline", None)


def _creases(lens: Lens, azimuth: float) -> list[ViewLine]:
    """Creases of the cavity behind the plane of the section, where the cut leaves them open."""
    cavity = lens_boundaries(lens)[0]
    lines = []
    across = rim_directions(np.array([azimuth]))[0]
    for crease in cavity.creases:
        points = crease.points(np.linspace(azimuth - np.pi, azimuth, _AZIMUTHS))
        line = np.column_stack([points[:, 2], points @ across])
        away = np.linalg.norm(line, axis=1)
        cut = cavity.radius((line[:, 1:] * across + line[:, :1] * _AXIS) / away[:, None])
        lines += _pieces(line, away < cut - _BEYOND_MM, "outline", None)
    return lines


def _inner_lines(lens: Lens, boundary: Boundary[Surface], turn: Float[np.ndarray, " n"]) -> list[ViewLine]:
    """(y, x) of the creases of a boundary, and of the outer circle of a flange at the rim."""
    lines = [ViewLine(crease.points(turn)[:, 1::-1]) for crease in boundary.creases]
    ring = ring_of(lens)
    return lines if ring is None else [*lines, ViewLine(_loop(turn, np.full_like(turn, ring.outer_mm)))]


def end_lines(lens: Lens) -> list[ViewLine]:
    """Lines of the part seen from its base, as (y, x)."""
    plan = lens_plan(lens)
    turn = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS)
    base = plan.base
    opening, rim = (_loop(turn, rim_radius(boundary)(turn)) for boundary in lens_boundaries(lens))
    dome = dome_radius(lens, turn)
    inside = _inner_lines(lens, plan.cavity, turn)
    if base.kind == "none":
        return [ViewLine(opening), ViewLine(rim), ViewLine(_loop(turn, dome)), *inside]
    outlines = _base_outlines(plan)
    if base.file is not None:
        return [*(ViewLine(loop) for loop in outlines), ViewLine(_loop(turn, dome), pen="hidden"), *inside]
    circles = [_loop(turn, circle.radius(turn)) for circle in (plan.bore, plan.pocket) if circle is not None]
    lines = [*(ViewLine(curve) for curve in (opening, *circles, outlines[-1])), *inside]
    lines += [ViewLine(outline, pen="hidden") for outline in outlines[:-1]]
    if base.feet is not None:
        round_it = _loop(turn, np.full_like(turn, base.feet.diameter_mm / 2.0))
        lines += [ViewLine(round_it + np.array([y, x])) for x, y in base.feet.places_mm]
    widest = plan.outline if plan.flange is None else plan.flange
    return [*lines, *_pieces(_loop(turn, dome), dome > widest.radius(turn), "outline", "hidden")]


def dome_lines(lens: Lens) -> list[ViewLine]:
    """Lines of the part seen along -z, as (-y, x): the dome, and the part of the base that it does not cover."""
    plan = lens_plan(lens)
    turn = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS)
    lines = [ViewLine(_loop(turn, dome_radius(lens, turn)))]
    lines += _inner_lines(lens, plan.envelope, turn)
    for loop in [] if plan.base.kind == "none" else _base_outlines(plan):
        closed = np.vstack([loop, loop[:1]])
        covered = dome_radius(lens, np.arctan2(closed[:, 0], closed[:, 1]))
        lines += _pieces(closed, np.hypot(closed[:, 0], closed[:, 1]) > covered, "outline", None)
    mirror = np.array([-1.0, 1.0])
    return [ViewLine(line.points * mirror, line.closed, line.pen) for line in lines]


def _base_outlines(plan: Plan[Surface]) -> list[Points]:
    """Outline of the base seen along the axis as (y, x), that of its flange last."""
    if plan.base.file is not None:  # and holes that go through
        from lensforge.cad.custom_base import mesh_of_base

        loops = manifold_of(*mesh_of_base(plan.base.file)).project().to_polygons()
        return [np.asarray(loop)[:, ::-1] for loop in loops]
    turn = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS)
    corners = np.union1d(turn, np.mod(plan.outline.corners, 2.0 * np.pi))
    outlines = [_loop(corners, plan.outline.radius(corners))]
    return outlines if plan.flange is None else [*outlines, _loop(turn, plan.flange.radius(turn))]


def dome_radius(lens: Lens, turn: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Silhouette of the envelope along the axis: its largest distance (mm) from the axis at each azimuth."""
    return _seen_along(lens, rim_directions(turn), _AXIS)


def front_line(lens: Lens, turn_deg: float) -> Points:
    """The dome of a lens, turned about its axis, seen along +y: (x, z) from rim to rim."""
    across, towards = rim_directions(np.radians([-turn_deg, 90.0 - turn_deg]))
    polar = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _AZIMUTHS)
    plane = np.sin(polar)[:, None] * across + np.cos(polar)[:, None] * _AXIS
    plane[[0, -1], 2] = 0.0
    radius = np.maximum(*(_seen_along(lens, plane, way * towards) for way in (1.0, -1.0)))
    return np.column_stack([radius * np.sin(polar), radius * plane[:, 2]])


def _seen_along(lens: Lens, plane: Float[np.ndarray, "n 3"], away: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " n"]:
    """Silhouette (mm) of the envelope seen along ``away``, of the half on that side, by directions across it."""
    envelope = lens_boundaries(lens)[1]
    tilt = np.linspace(0.0, 0.5 * np.pi, _POLAR)[:, None]
    for _ in range(1 + _CLOSER * bool(envelope.creases)):  # where it is a crease it has a bend: nearer and nearer
        directions = np.cos(tilt)[..., None] * plane + np.sin(tilt)[..., None] * away
        radius = envelope.radius(directions.reshape(-1, 3)).reshape(directions.shape[:2])
        seen = radius * np.cos(tilt)
        best = np.take_along_axis(tilt + 0.0 * seen, seen.argmax(axis=0)[None], axis=0)
        step = tilt[1] - tilt[0]
        tilt = np.clip(best + step * np.linspace(-1.0, 1.0, _BESIDE)[:, None], 0.0, 0.5 * np.pi)
    return np.asarray(seen.max(axis=0))


def _loop(turn: Float[np.ndarray, " n"], radius: Float[np.ndarray, " n"]) -> Points:
    """(y, x) of a curve about the axis."""
    return np.column_stack([radius * np.sin(turn), radius * np.cos(turn)])


def _pieces(points: Points, flags: Bool[np.ndarray, " n"], pen: PenName, other_pen: PenName | None) -> list[ViewLine]:
    if flags.all() or not flags.any():
        single_pen = pen if flags[0] else other_pen
        return [] if single_pen is None else [ViewLine(points, closed=False, pen=single_pen)]
    runs = [(first, last, pen if flags[first] else other_pen) for first, last in _runs(flags)]
    return [
        ViewLine(points[max(first - 1, 0) : last + 1], closed=False, pen=run_pen)
        for first, last, run_pen in runs
        if run_pen
    ]


def _runs(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """First and last index of each run of equal flags; a run reaches to the first index of the next one."""
    changes = [0, *(np.flatnonzero(flags[1:] != flags[:-1]) + 1).tolist(), len(flags) - 1]
    return [(first, last) for first, last in pairwise(changes) if last > first]
