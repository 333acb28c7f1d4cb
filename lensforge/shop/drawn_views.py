"""Views and sizes of a linear lens: its section, and broken views from below and from above.

The section is the same at every y. A part that is longer than a few of its widths is drawn as two ends between zigzag
lines, the interrupted view of ISO 128-3.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lensforge.cad.section import body_outlines
from lensforge.scene.lens import Lens
from lensforge.shop.dimensions import Dimension, without_repeats
from lensforge.shop.sheet import Points
from lensforge.shop.view_lines import SectionView, ViewLine
from lensforge.surfaces.drawn_profile import DrawnFace

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
    """Lines of the part seen from below, as (y, x): its feet, and the silhouette of its outer profile beyond them."""
    lines = [*_feet_mm(lens, "outer"), *_feet_mm(lens, "inner")]
    return _along_y(lens, [*lines, *_ends_mm(lens, "outer")])


def drawn_dome_lines(lens: Lens) -> list[ViewLine]:
    """Lines of the part seen along -z, as (-y, x): the silhouette of its outer profile."""
    return _along_y(lens, _ends_mm(lens, "outer"))


def drawn_dimensions(lens: Lens) -> list[Dimension]:
    """Sizes of the section, and the length."""
    half = _shown_half_mm(lens)
    length = Dimension(LENGTH, _length_mm(lens), "length", ((-half, 0.0), (half, 0.0)), "base")
    return without_repeats([*_of_section(lens), length])


def _profile(lens: Lens, face: str, angles_rad: Float[np.ndarray, " n"]) -> Points:
    """Points (z, x) of a profile at angles from z."""
    surface = lens.surfaces[face]
    assert isinstance(surface, DrawnFace)
    return surface.points(angles_rad)[:, ::-1]


def _feet_mm(lens: Lens, face: str) -> list[float]:
    """x of both feet of a profile."""
    feet = _profile(lens, face, np.array([-_FOOT_RAD, _FOOT_RAD]))
    return [float(x) for x in feet[:, 1]]


def drawn_width_mm(lens: Lens, face: str) -> float:
    """Width (mm) of a profile along x."""
    low, high = _ends_mm(lens, face)
    return high - low


def _ends_mm(lens: Lens, face: str) -> list[float]:
    """Least and largest x of a profile."""
    across = _profile(lens, face, _DENSE_RAD)[:, 1]
    return [float(across.min()), float(across.max())]


def _length_mm(lens: Lens) -> float:
    length_mm = lens.spec.lens.drawn_mm
    assert length_mm is not None
    return length_mm


def _is_broken(lens: Lens) -> bool:
    """True for a part that is too long for whole views along y."""
    return _length_mm(lens) > _WHOLE * drawn_width_mm(lens, "outer")


def _shown_half_mm(lens: Lens) -> float:
    """Half of the length (mm) on paper of a view along y."""
    return _SHOWN * drawn_width_mm(lens, "outer") if _is_broken(lens) else 0.5 * _length_mm(lens)


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
    gap = lens.spec.part_tolerances.amount("outer", "gap_mm")
    low, high = (float(_profile(lens, face, np.zeros(1))[0, 0]) for face in ("inner", "outer"))
    feet = {face: _feet_mm(lens, face) for face in ("outer", "inner")}
    side = feet["outer"][0]
    outline = _profile(lens, "outer", _DENSE_RAD)
    top = outline[np.argmax(outline[:, 0])]
    left, right = (outline[k(outline[:, 1])] for k in (np.argmin, np.argmax))
    yield Dimension("outer apex above z = 0", high, "axis", ((0.0, side), (high, 0.0)))
    yield Dimension("apex of the cavity above z = 0", low, "axis", ((0.0, side), (low, 0.0)))
    yield Dimension("thickness on the axis", high - low, "axis", ((low, 0.0), (high, 0.0)), tolerance_mm=gap or None)
    yield Dimension("overall height", float(top[0]), "section", ((0.0, side), (float(top[0]), float(top[1]))))
    for name, face in ((WIDTH, "outer"), ("opening of the cavity in z = 0, along x", "inner")):
        start, end = feet[face]
        yield Dimension(name, end - start, "section", ((0.0, start), (0.0, end)), upright=True)
    ends = (float(left[0]), float(left[1])), (float(right[0]), float(right[1]))
    yield Dimension("largest width, along x", ends[1][1] - ends[0][1], "section", ends, upright=True)
