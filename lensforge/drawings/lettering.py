"""Sizes of texts in the typeface of the drawing, which comes with matplotlib: no text is wider on any machine.

CAD programs show the DXF in a typeface of their own, of which the usual ones (ISO 3098, Arial) are narrower.
"""

from functools import cache

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextToPath

from lensforge.drawings.sheet import Box, Words

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


def box_of(words: Words) -> Box:
    """The rectangle on paper (mm) that a text needs."""
    width, half = width_of(words.text, words.height_mm), 0.5 * _ROOM * words.height_mm
    start = {"left": 0.0, "center": -0.5 * width, "right": -width}[words.anchor]
    x, y = words.at
    if words.turned_deg == 0:
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
    """``text``, its end replaced by an ellipsis where it is wider than ``width_mm``."""
    if width_of(text, height_mm) <= width_mm:
        return text
    kept = text
    while kept and width_of(kept + "…", height_mm) > width_mm:
        kept = kept[:-1]
    return kept.rstrip() + "…"


def _cut(word: str, height_mm: float, width_mm: float) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and width_of(pieces[-1] + letter, height_mm) > width_mm:
            pieces.append("")
        pieces[-1] += letter
    return pieces
