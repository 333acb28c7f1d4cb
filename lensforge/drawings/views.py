"""Outlines of the two views: the section at y = 0, and the part seen from its base along +z; first angle.

Both have +x upwards on paper. In the section z points to the right, in the view of the end y does: it stands to the
right of the section and shows the part from the left, as the first angle has it.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from lensforge.drawings.sheet import Points
from lensforge.geometry.custom_base import read_custom_base, tessellated
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.manifold import manifold_of
from lensforge.geometry.plan import lay_out, rim_radius
from lensforge.geometry.section import body_outlines
from lensforge.lens import Lens
from lensforge.spec import BaseSection

# Of the curves of the view, and of the meridians whose widest place is the silhouette: 1 um on a lens of 14 mm, a
# hundredth of a line's width at 5 : 1. Twice as many of each cost 6 s on a lens of 400 functions.
_AZIMUTHS, _POLAR = 361, 91
_CHORD_MM = 1e-2


@dataclass(frozen=True)
class ViewLine:
    """A line of a view (mm, in the view's own axes); ``hidden`` lines are dashed."""

    points: Points
    closed: bool = True
    hidden: bool = False


def section_outlines(lens: Lens) -> list[Points]:
    """Closed outlines of the cut material at y = 0, as (z, x)."""
    return [outline[:, ::-1] for outline in body_outlines(lens, 0.0)]


def section_edges(lens: Lens) -> list[Points]:
    """Edges of cavity, bore and pocket behind the plane of the section, across the opening, as (z, x)."""
    turns = np.array([0.0, np.pi])
    base = base_with_room(lens)
    holes = [(0.0, rim_radius(lens.inner))]
    if base.kind in ("cylinder", "square"):
        plan = lay_out(lens.inner, lens.outer, base)
        bore = rim_radius(lens.inner) if plan.bore is None else plan.bore.radius
        holes += [(0.0, bore), (-plan.bore_mm, bore)]
        if plan.pocket is not None:
            holes += [(-plan.bore_mm, plan.pocket.radius), (-base.height_mm, plan.pocket.radius)]
    return [np.array([(z, -left), (z, right)]) for z, hole in holes for right, left in [hole(turns).tolist()]]


def end_lines(lens: Lens) -> list[ViewLine]:
    """Lines of the part seen from its base, as (y, x)."""
    base = base_with_room(lens)
    turn = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS)
    opening = _loop(turn, rim_radius(lens.inner)(turn))
    dome = dome_radius(lens, turn)
    if base.kind == "none":
        return [ViewLine(opening), ViewLine(_loop(turn, rim_radius(lens.outer)(turn))), *_seen(turn, dome, None)]
    if base.file is not None:
        return [*(ViewLine(loop) for loop in _shadow_of_file(base)), ViewLine(_loop(turn, dome), hidden=True)]
    plan = lay_out(lens.inner, lens.outer, base)
    widest = plan.outline if plan.flange is None else plan.flange
    found = [ViewLine(opening)]
    found += [ViewLine(_loop(turn, circle.radius(turn))) for circle in (plan.bore, plan.pocket) if circle is not None]
    corners = np.union1d(turn, np.mod(plan.outline.corners, 2.0 * np.pi))
    found.append(ViewLine(_loop(corners, plan.outline.radius(corners)), hidden=plan.flange is not None))
    if plan.flange is not None:
        found.append(ViewLine(_loop(turn, plan.flange.radius(turn))))
    return [*found, *_seen(turn, dome, widest.radius(turn))]


def dome_radius(lens: Lens, turn: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Silhouette of the outer face along the axis: its largest distance (mm) from the axis at each azimuth."""
    polar, azimuth = np.meshgrid(np.linspace(0.0, 0.5 * np.pi, _POLAR), turn)
    across = np.sin(polar)
    directions = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(polar)], axis=-1)
    widths = lens.outer.radius(directions.reshape(-1, 3)).reshape(across.shape) * across
    return np.asarray(widths.max(axis=1))


def _loop(turn: Float[np.ndarray, " n"], radius: Float[np.ndarray, " n"]) -> Points:
    """(y, x) of a curve about the axis."""
    return np.column_stack([radius * np.sin(turn), radius * np.cos(turn)])


def _seen(
    turn: Float[np.ndarray, " n"], radius: Float[np.ndarray, " n"], front: Float[np.ndarray, " n"] | None
) -> list[ViewLine]:
    """A curve behind a body of radius ``front``, in pieces that are seen and pieces that are hidden."""
    visible = np.ones_like(turn, dtype=bool) if front is None else radius > front
    points = _loop(turn, radius)
    if visible.all() or not visible.any():
        return [ViewLine(points, hidden=not visible[0])]
    return [
        ViewLine(points[first : last + 1], closed=False, hidden=not visible[first]) for first, last in _runs(visible)
    ]


def _runs(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """First and last index of each piece of equal flags; a piece reaches to the first index of the next one."""
    changes = [0, *(np.flatnonzero(flags[1:] != flags[:-1]) + 1).tolist(), len(flags) - 1]
    return [(first, last) for first, last in pairwise(changes) if last > first]


def _shadow_of_file(base: BaseSection) -> list[Points]:
    """Outlines, and holes that go through, of a base from a file, seen along the axis."""
    assert base.file is not None
    vertices, triangles = tessellated(read_custom_base(base.file).solid, _CHORD_MM)
    loops = manifold_of(vertices, triangles).project().to_polygons()
    return [np.asarray(loop)[:, ::-1] for loop in loops]
