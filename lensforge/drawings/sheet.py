"""The sheet: one description of the drawing, from which its pictures, its PDF and its DXF are made.

All places are on paper, in mm from the lower left corner of the sheet; the part appears ``scale`` times as large as it
is. Pens, arrows and letters have sizes of ISO 128 and ISO 3098 on A3, and are smaller by the square root of 2 on A4.
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
