"""Marks in the views: datum symbols, axes, the plane of the section, and the symbol of the first angle."""

import numpy as np

from lensforge.drawings.sheet import LETTERS, Place, Stroke, Words

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
