"""The sheet: one description of the drawing, from which its pictures, its PDF and its DXF are made.

All places are on paper, in mm from its lower left corner. Pens, arrows and letters have the sizes of ISO 128 and ISO
3098 on A3, and are smaller by the square root of 2 on A4.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Float
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextToPath

Points = Float[np.ndarray, "n 2"]
Place = tuple[float, float]
Box = tuple[float, float, float, float]  # left, bottom, right, top
Anchor = Literal["left", "center", "right"]
PenName = Literal["outline", "thin", "hidden", "axis", "phantom", "hatch"]


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
}


@dataclass(frozen=True)
class Stroke:
    """A chain of straight lines through ``points``; ``filled``: its inside is black, as of an arrow."""

    points: Points
    pen: PenName = "thin"
    closed: bool = False
    filled: bool = False


@dataclass(frozen=True)
class SheetText:
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
        low, high = sorted((self.at(*self.start)[0], self.at(*self.end)[0]))
        return low, high

    @property
    def text(self) -> str:
        """The text as drawn."""
        return f"{self.before}{shown(self.length_mm)}{self.after}"

    def at(self, along: float, across: float) -> Place:
        """The place on paper of a place along and across the dimension line; its own inverse."""
        return (along, across) if self.turned_deg == 0 else (across, along)


@dataclass
class Marks:
    """Lines, texts and dimensions of a drawing, to which more can be added."""

    strokes: list[Stroke] = field(default_factory=list)
    texts: list[SheetText] = field(default_factory=list)
    dimensions: list[LinearDimension] = field(default_factory=list)

    def add(self, more: "Marks") -> None:
        """Add all that ``more`` holds."""
        self.strokes += more.strokes
        self.texts += more.texts
        self.dimensions += more.dimensions


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
    marks: Marks


def shown(length_mm: float) -> str:
    """A length (mm) as on the drawing and in its table: to a micrometre."""
    return f"{length_mm:.3f}"


TYPEFACE = "DejaVu Sans"
CAPITALS = 0.729  # height of its capitals as a share of its size
MM_PER_POINT = 25.4 / 72.0
_SIZE = 100.0  # points at which widths are measured
_ROOM = 1.35  # height of a line's box over that of its capitals: brackets, accents, letters that hang down


def width_of(text: str, height_mm: float) -> float:
    """Width (mm) of ``text`` with capitals of ``height_mm``."""
    return _width_points(text) / _SIZE * height_mm / CAPITALS


@cache  # the same text is tried at many heights
def _width_points(text: str) -> float:
    properties = FontProperties(family=TYPEFACE, size=_SIZE)
    width, _, _ = TextToPath().get_text_width_height_descent(text, properties, ismath=False)
    return float(width)


def points_of(height_mm: float) -> float:
    """Size of type in points whose capitals are ``height_mm`` high."""
    return height_mm / CAPITALS / MM_PER_POINT


def box_of(text: SheetText) -> Box:
    """The rectangle on paper (mm) that a text needs."""
    width = width_of(text.text, text.height_mm)
    half = 0.5 * _ROOM * text.height_mm
    start = {"left": 0.0, "center": -0.5 * width, "right": -width}[text.anchor]
    x, y = text.at
    if text.turned_deg == 0:
        return x + start, y - half, x + start + width, y + half
    return x - half, y + start, x + half, y + start + width


def wrapped(text: str, height_mm: float, width_mm: float) -> list[str]:
    """``text`` in lines that are no wider than ``width_mm``; a word that is wider is cut."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if width_of(longer, height_mm) <= width_mm:
            lines[-1] = longer
            continue
        *whole, last = _cut(word, height_mm, width_mm)
        lines += [*whole, last]
    return [line for line in lines if line]


def shortened(text: str, height_mm: float, width_mm: float) -> str:
    """``text``, with an ellipsis for its end if it is wider than ``width_mm``."""
    if width_of(text, height_mm) <= width_mm:
        return text
    shortened_text = text
    while shortened_text and width_of(shortened_text + "…", height_mm) > width_mm:
        shortened_text = shortened_text[:-1]
    return shortened_text.rstrip() + "…"


def _cut(word: str, height_mm: float, width_mm: float) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and width_of(pieces[-1] + letter, height_mm) > width_mm:
            pieces.append("")
        pieces[-1] += letter
    return pieces
