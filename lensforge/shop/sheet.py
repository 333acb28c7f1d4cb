"""The sheet: one description of the drawing, from which its pictures, its PDF and its DXF are made.

All places are on paper, in mm from the lower left corner of the sheet; the part appears ``scale`` times as large as it
is. Pens, arrows and letters have sizes of ISO 128 and ISO 3098 on A3, and are smaller by the square root of 2 on A4.
Marks are datum symbols, axes, the plane of the section, the symbol of the first angle, and the hatching of cut
material.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "n 2"]
Place = tuple[float, float]
Box = tuple[float, float, float, float]  # left, bottom, right, top
Anchor = Literal["left", "center", "right"]
PenName = Literal["outline", "thin", "hidden", "axis", "phantom", "hatch", "frame"]


@dataclass(frozen=True)
class Pen:
    """A kind of line: its width on A3 (mm), and the lengths (mm) of its dashes and gaps, none for a whole line."""

    width_mm: float
    dashes_mm: tuple[float, ...] = ()


LETTERS = 2.5  # height of all letters (mm on A3), ISO 3098

PENS: dict[PenName, Pen] = {
    "outline": Pen(0.5),
    "thin": Pen(0.18),
    "hidden": Pen(0.25, (2.0, 1.0)),
    "axis": Pen(0.18, (8.0, 1.2, 0.6, 1.2)),
    "phantom": Pen(0.18, (8.0, 1.2, 0.6, 1.2, 0.6, 1.2)),
    "hatch": Pen(0.09),
    "frame": Pen(0.5),
}


@dataclass(frozen=True)
class Stroke:
    """A chain of straight lines through ``points``; ``filled``: its inside is black, as of an arrow."""

    points: Points
    pen: PenName = "thin"
    closed: bool = False
    filled: bool = False


@dataclass(frozen=True)
class Words:
    """A line of text: capitals of ``height_mm``, its middle on the height of ``at``, turned anticlockwise."""

    at: Place
    text: str
    height_mm: float
    anchor: Anchor = "left"
    turned_deg: Literal[0, 90] = 0


@dataclass(frozen=True)
class LinearDimension:
    """A dimension between two places on paper, measured along x (``turned_deg`` = 0) or along y (90).

    ``line_mm``: y of a horizontal dimension line, x of a vertical one; ``text_mm``: where along it its text has its
    middle. The text is ``before``, the length of the part in mm, ``after``. ``name``: that of its row in the table.
    """

    name: str
    start: Place
    end: Place
    turned_deg: Literal[0, 90]
    line_mm: float
    text_mm: float
    height_mm: float
    length_mm: float
    before: str = ""
    after: str = ""

    @property
    def ends_mm(self) -> tuple[float, float]:
        """Lower and upper end along the dimension line."""
        axis = 0 if self.turned_deg == 0 else 1
        low, high = sorted((self.start[axis], self.end[axis]))
        return low, high

    @property
    def text(self) -> str:
        """Text as it is drawn."""
        return f"{self.before}{shown(self.length_mm)}{self.after}"


@dataclass(frozen=True)
class Sheet:
    """A drawing: its size (mm) and name, its scale (of the part on paper), and what is on it.

    ``unit_mm``: size of a millimetre of the A3 layout. ``origin``: of the part in the section, on paper.
    """

    name: Literal["A3", "A4"]
    size_mm: tuple[float, float]
    unit_mm: float
    scale: float
    title: str
    origin: Place
    strokes: tuple[Stroke, ...]
    words: tuple[Words, ...]
    dimensions: tuple[LinearDimension, ...]


def shown(length_mm: float) -> str:
    """A length (mm) as on the drawing and in its table: to a micrometre."""
    return f"{length_mm:.3f}"


_TRIANGLE, _BOX, _LEADER = 2.6, 5.0, 2.0  # mm on A3

Marks = tuple[list[Stroke], list[Words]]


def datum_symbol(at: Place, towards: Place, letter: str, unit: float, further_mm: float = 0.0) -> Marks:
    """A filled triangle on a line at ``at``, its leader in the unit direction ``towards``, and the letter in a box.

    ``further_mm``: length of the leader beyond the usual one.
    """
    foot, out = np.array(at), np.array(towards)
    along = np.array([-out[1], out[0]])
    size, half = unit * _TRIANGLE, 0.5 * unit * _BOX
    triangle = np.array([foot + 0.5 * size * along, foot - 0.5 * size * along, foot + 0.87 * size * out])
    start, end = foot + 0.87 * size * out, foot + (0.87 * size + unit * _LEADER + further_mm) * out
    centre = end + half * out
    corners = centre + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    strokes = [
        Stroke(triangle, closed=True, filled=True),
        Stroke(np.array([start, end])),
        Stroke(corners, closed=True),
    ]
    return strokes, [Words((float(centre[0]), float(centre[1])), letter, LETTERS * unit, "center")]


def axes_mark(at: Place, level: str, up: str, unit: float, towards: float = 1.0) -> Marks:
    """Two arrows that name the axes of a view, their corner at ``at``; the level one to the right, or left with -1."""
    corner, length = np.array(at), 7.0 * unit
    strokes, words = [], []
    for name, out in ((level, np.array([towards, 0.0])), (up, np.array([0.0, 1.0]))):
        tip = corner + length * out
        strokes += [Stroke(np.array([corner, tip])), arrow_head(tip, out, 2.0 * unit)]
        place = tip + 2.0 * unit * out
        words.append(Words((float(place[0]), float(place[1])), name, LETTERS * unit, "center"))
    return strokes, words


def turned_mark(at: Place, unit: float) -> Marks:
    """The sign of a section that is turned anticlockwise from its place (ISO 128): an arc with an arrow."""
    turn = np.linspace(-0.25 * np.pi, 0.9 * np.pi, 25)
    arc = np.array(at) + 2.2 * unit * np.column_stack([np.cos(turn), np.sin(turn)])
    out = np.array([-np.sin(turn[-1]), np.cos(turn[-1])])
    return [Stroke(arc), arrow_head(arc[-1] + 1.2 * unit * out, out, 2.0 * unit)], []


def arrow_head(tip: np.ndarray, out: np.ndarray, size: float) -> Stroke:
    """A filled head of ``size`` mm that points along the unit vector ``out``."""
    along = np.array([-out[1], out[0]])
    back = tip - size * out
    return Stroke(np.array([tip, back + size / 6.0 * along, back - size / 6.0 * along]), closed=True, filled=True)


def section_plane(centre: Place, azimuth_deg: float, half_mm: float, letter: str, unit: float) -> Marks:
    """The plane of a section in the view from the base: a chain line, thick at its ends, with arrows of the sight."""
    turn = np.radians(azimuth_deg)
    along, sight = np.array([np.sin(turn), np.cos(turn)]), np.array([-np.cos(turn), np.sin(turn)])
    middle = np.array(centre)
    strokes = [Stroke(np.array([middle - half_mm * along, middle + half_mm * along]), "axis")]
    words = []
    for way in (1.0, -1.0):
        end = middle + way * half_mm * along
        strokes.append(Stroke(np.array([end, end + way * 4.0 * unit * along]), "outline"))
        tail = end + way * 2.0 * unit * along
        tip = tail + 7.0 * unit * sight
        strokes += [Stroke(np.array([tail, tip])), arrow_head(tip, sight, LETTERS * unit)]
        place = tip + LETTERS * unit * sight
        words.append(Words((float(place[0]), float(place[1])), letter, LETTERS * unit, "center"))
    return strokes, words


def first_angle(at: Place, unit: float) -> Marks:
    """The symbol of the first-angle projection (ISO 5456-2), its middle at ``at``: a cone, and its view from the left.

    The cone's small end is on the left, so that the view from there, at its right, shows both circles.
    """
    x, y = at
    small, large, length = 1.5 * unit, 3.0 * unit, 6.0 * unit
    left = x - 8.0 * unit
    right = left + length
    cone = np.array([(left, y - small), (right, y - large), (right, y + large), (left, y + small)])
    centre = x + 4.5 * unit
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    circles = [np.column_stack([centre + r * np.cos(turn), y + r * np.sin(turn)]) for r in (small, large)]
    strokes = [Stroke(cone, closed=True), *(Stroke(circle, closed=True) for circle in circles)]
    strokes.append(Stroke(np.array([(left - 1.5 * unit, y), (left + length + 1.5 * unit, y)]), "axis"))
    strokes.append(Stroke(np.array([(centre - 4.0 * unit, y), (centre + 4.0 * unit, y)]), "axis"))
    strokes.append(Stroke(np.array([(centre, y - 4.0 * unit), (centre, y + 4.0 * unit)]), "axis"))
    return strokes, []


_HATCH_TURN = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)  # rows: along the lines, and across them


def hatch(outlines: list[Points], spacing_mm: float) -> list[Stroke]:
    """Lines ``spacing_mm`` apart inside all ``outlines`` together, inside being what an odd number of them encloses."""
    chains = [np.vstack([outline, outline[:1]]) @ _HATCH_TURN.T for outline in outlines]
    across = np.concatenate([chain[:, 1] for chain in chains])
    first, last = np.ceil(across.min() / spacing_mm), np.floor(across.max() / spacing_mm)
    found = []
    for level in spacing_mm * (np.arange(first, last + 1.0) + 0.37):  # off the places where corners are likely
        cuts = np.sort(np.concatenate([_cuts(chain, level) for chain in chains]))
        for start, end in zip(cuts[0::2], cuts[1::2], strict=False):
            found.append(Stroke(np.array([(start, level), (end, level)]) @ _HATCH_TURN, "hatch"))
    return found


def _cuts(chain: Points, level: float) -> np.ndarray:
    """Places along a level at which a chain crosses it."""
    above = chain[:, 1] > level
    changes = np.flatnonzero(above[1:] != above[:-1])
    start, end = chain[changes], chain[changes + 1]
    share = (level - start[:, 1]) / (end[:, 1] - start[:, 1])
    return np.asarray(start[:, 0] + share * (end[:, 0] - start[:, 0]))
