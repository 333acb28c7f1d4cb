"""Text as a picture, in a font that comes with a dependency: no font of the system has a part in it."""

import unicodedata
from collections.abc import Collection
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont, features

from lensforge.errors import InputError

_GLYPH_PIXELS = 1024  # font size at which text is drawn before it is scaled
_WRITTEN_LEFTWARDS = ("R", "AL", "AN")  # bidirectional classes of Hebrew, Arabic and its numbers


def drawn_text(text: str) -> Float[np.ndarray, "h w"]:
    """``text`` in matplotlib's DejaVu Sans, 0 to 1, anti-aliased and cropped to its ink.

    Raises :class:`InputError` where the font lacks a character, where there is nothing to see, and for letters that
    are placed by their neighbours where the library for it is not installed.
    """
    from matplotlib import get_data_path
    from matplotlib.ft2font import FT2Font

    path = str(Path(get_data_path()) / "fonts/ttf/DejaVuSans.ttf")
    _require_glyphs(text, FT2Font(path).get_charmap())
    _require_layout(text)
    font = ImageFont.truetype(path, _GLYPH_PIXELS)
    left, top, right, bottom = font.getbbox(text)
    canvas = Image.new("L", (int(right - left), int(bottom - top)))
    ImageDraw.Draw(canvas).text((-left, -top), text, fill=255, font=font)
    box = canvas.getbbox()
    if box is None:
        raise InputError(f"target.text = {text!r}: nothing to draw; give visible characters")
    return np.asarray(canvas.crop(box), dtype=np.float64) / 255.0


def _require_glyphs(text: str, known: Collection[int]) -> None:
    for character in text:
        if ord(character) not in known:
            raise InputError(
                f"target.text = {text!r}: the font, DejaVu Sans, has no {character!r} (U+{ord(character):04X}); use "
                'another character, or draw it as a picture, target.kind = "image"'
            )


def _require_layout(text: str) -> None:
    """Refuse marks on letters and scripts from right to left where only Pillow's basic layout is there."""
    if features.check("raqm"):
        return
    for character in text:
        if unicodedata.combining(character) or unicodedata.bidirectional(character) in _WRITTEN_LEFTWARDS:
            raise InputError(
                f"target.text = {text!r}: {character!r} needs the FriBiDi library, which Pillow does not find; install "
                'it, or draw the text as a picture, target.kind = "image"'
            )
