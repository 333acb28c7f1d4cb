"""Views and sizes of a linear lens: its section, and broken views from below and from above.

The section is the same at every y. A part that is longer than a few of its widths is drawn as two ends between zigzag
lines, the interrupted view of ISO 128-3.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from lensforge.cad.section import body_outlines
from lensforge.optics.face_roles import BODY, CAVITY
from lensforge.scene.lens import Lens
from lensforge.scene.section_arcs import points_along
from lensforge.shop.dimensions import Dimension, apex_title, without_repeats
from lensforge.shop.sheet import Points
from lensforge.shop.view_lines import SectionView, ViewLine

LENGTH = "length along y"
WIDTH = "width across the feet, along x"
_WHOLE = 3.0  # widths up to which a part is drawn whole
_SHOWN = 0.6  # of a width: half of a broken view along y
_GAP = 0.1  # of a width: half of the gap
_TEETH = 9
_FOOT_RAD = 0.5 * np.pi
_DENSE_RAD = np.linspace(-_FOOT_RAD, _FOOT_RAD, 1441)  # an eighth of a degree apart


def section_of_drawn(lens: Lens) -> SectionView:
    """The section across the part, in (z, x)."""
    return SectionView("S", 0.0, [outline[:, ::-1] for outline in body_outlines(lens, 0.0)], [])


def drawn_end_lines(lens: Lens) -> list[ViewLine]:
    """Lines of the part seen from below, as (y, x): its feet, the silhouette of its envelope beyond them, and edges."""
    envelope = _outline(lens, BODY)
    cavity = _outline(lens, CAVITY)
    feet = [*envelope[[0, -1], 1], *cavity[[0, -1], 1]]
    return _along_y(lens, [*map(float, feet), *_extremes(envelope[:, 1]), *_edges_mm(lens, CAVITY)])


def drawn_dome_lines(lens: Lens) -> list[ViewLine]:
    """Lines of the part seen along -z, as (-y, x): the silhouette of its envelope, and edges."""
    return _along_y(lens, [*_extremes(_outline(lens, BODY)[:, 1]), *_edges_mm(lens, BODY)])


def drawn_dimensions(lens: Lens) -> list[Dimension]:
    """Sizes of the section, and the length."""
    half = _shown_half_mm(lens)
    length = Dimension(LENGTH, _length_mm(lens), "length", ((-half, 0.0), (half, 0.0)), "base")
    return without_repeats([*_of_section(lens), *_of_creases(lens), length])


def _outline(lens: Lens, medium: str) -> Points:
    """Dense points (z, x) of one side of the section, from foot to foot."""
    arcs = lens.body.arcs(medium)
    corners = [arc.high_rad for arc in arcs[:-1]]
    return points_along(arcs, np.unique(np.concatenate([_DENSE_RAD, corners])))[:, ::-1]


def _creases(lens: Lens, medium: str) -> Iterator[tuple[str, Points]]:
    """Each crease on a side of the section, by the names of its faces, and its point (z, x)."""
    for inner, outer in pairwise(lens.body.arcs(medium)):
        yield f"crease of {inner.name} and {outer.name}", inner.face.points(np.array([inner.high_rad]))[0, ::-1]


def _edges_mm(lens: Lens, medium: str) -> list[float]:
    """x of the creases on a side of the section."""
    return [float(point[1]) for _, point in _creases(lens, medium)]


def drawn_width_mm(lens: Lens, face: str) -> float:
    """Width (mm) of a face along x."""
    arcs = [arc for arc in lens.body.arcs(lens.body.face(face).before) if arc.name == face]
    low, high = _extremes(np.concatenate([arc.face.points(arc.angles(len(_DENSE_RAD)))[:, 0] for arc in arcs]))
    return high - low


def _width_mm(lens: Lens) -> float:
    """Largest width (mm) of the part along x."""
    low, high = _extremes(_outline(lens, BODY)[:, 1])
    return high - low


def _extremes(values: Float[np.ndarray, " n"]) -> list[float]:
    return [float(values.min()), float(values.max())]


def _length_mm(lens: Lens) -> float:
    length_mm = lens.spec.lens.drawn_mm
    assert length_mm is not None
    return length_mm


def _is_broken(lens: Lens) -> bool:
    """True for a part that is too long for whole views along y."""
    return _length_mm(lens) > _WHOLE * _width_mm(lens)


def _shown_half_mm(lens: Lens) -> float:
    """Half of the length (mm) on paper of a view along y."""
    return _SHOWN * _width_mm(lens) if _is_broken(lens) else 0.5 * _length_mm(lens)


def _along_y(lens: Lens, across_mm: list[float]) -> list[ViewLine]:
    """Lines along y at these x, with the ends of the part, and zigzags where the view is broken."""
    half = _shown_half_mm(lens)
    low = min(across_mm)
    high = max(across_mm)
    ends = [ViewLine(np.array([(y, low), (y, high)]), closed=False) for y in (-half, half)]
    if not _is_broken(lens):
        return [*ends, *(ViewLine(np.array([(-half, x), (half, x)]), closed=False) for x in across_mm)]
    gap = _GAP * (high - low)
    pieces = [
        ViewLine(np.array([(side * half, x), (side * gap, x)]), closed=False) for x in across_mm for side in (-1.0, 1.0)
    ]
    teeth = 0.25 * gap * np.where(np.arange(_TEETH) % 2, 1.0, -1.0)
    zigzag = np.column_stack([teeth, np.linspace(low, high, _TEETH)])
    breaks = [ViewLine(zigzag + np.array([side * gap, 0.0]), closed=False, pen="thin") for side in (-1.0, 1.0)]
    return [*ends, *pieces, *breaks]


def _of_section(lens: Lens) -> Iterator[Dimension]:
    outer, inner = (_outline(lens, medium) for medium in (BODY, CAVITY))
    low, high = (_height_on_axis(lens, medium) for medium in (CAVITY, BODY))
    top_face = lens.body.arcs(BODY)[len(lens.body.arcs(BODY)) // 2].name
    gap = lens.spec.part_tolerances.amount(top_face, "gap_mm")
    side = float(outer[0, 1])
    top = outer[np.argmax(outer[:, 0])]
    left, right = (outer[k(outer[:, 1])] for k in (np.argmin, np.argmax))
    yield Dimension(f"{apex_title(top_face)} above z = 0", high, "axis", ((0.0, side), (high, 0.0)))
    yield Dimension("apex of the cavity above z = 0", low, "axis", ((0.0, side), (low, 0.0)))
    yield Dimension("thickness on the axis", high - low, "axis", ((low, 0.0), (high, 0.0)), tolerance_mm=gap or None)
    yield Dimension("overall height", float(top[0]), "section", ((0.0, side), (float(top[0]), float(top[1]))))
    for name, line in ((WIDTH, outer), ("opening of the cavity in z = 0, along x", inner)):
        start, end = line[[0, -1], 1].tolist()
        yield Dimension(name, end - start, "section", ((0.0, start), (0.0, end)), upright=True)
    ends = (float(left[0]), float(left[1])), (float(right[0]), float(right[1]))
    yield Dimension("largest width, along x", ends[1][1] - ends[0][1], "section", ends, upright=True)


def _height_on_axis(lens: Lens, medium: str) -> float:
    return float(points_along(lens.body.arcs(medium), np.zeros(1))[0, 1])


def _of_creases(lens: Lens) -> Iterator[Dimension]:
    """Height of each crease, and the width between those of the same faces."""
    for medium in (BODY, CAVITY):
        ends = list(_creases(lens, medium))
        for (name, left), (_, right) in zip(ends[: len(ends) // 2], ends[::-1], strict=False):
            across = (float(left[0]), float(left[1])), (float(right[0]), float(right[1]))
            yield Dimension(f"{name}, along x", across[1][1] - across[0][1], "section", across, upright=True)
            for side, place in zip(("x < 0", "x > 0"), across, strict=True):
                yield Dimension(f"{name} above z = 0, {side}", place[0], "section", ((0.0, place[1]), place))
