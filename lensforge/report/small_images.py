"""Raster images within an SVG with a palette: maps have the 256 colours of their scale, and then half the size."""

import base64
import io
import re

import numpy as np
from PIL import Image

_EMBEDDED = re.compile(r"(data:image/png;base64,)([A-Za-z0-9+/=\s]+)")
_MOST_COLOURS = 256  # of a palette


def with_palettes(svg: str) -> str:
    """``svg`` with every embedded PNG that has at most 256 colours replaced by one with a palette, pixel by pixel."""
    return _EMBEDDED.sub(lambda match: match[1] + _with_palette(match[2]), svg)


def _with_palette(encoded: str) -> str:
    """The same picture in base64; as it was where its colours are too many, or a palette saves nothing."""
    png = base64.b64decode(encoded)
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))
    colours, indices = np.unique(np.ascontiguousarray(pixels).view("<u4")[..., 0], return_inverse=True)
    if len(colours) > _MOST_COLOURS:
        return encoded
    rgba = colours.view(np.uint8).reshape(-1, 4)
    picture = Image.fromarray(indices.reshape(pixels.shape[:2]).astype(np.uint8))
    picture.putpalette(rgba[:, :3].tobytes())  # which makes it one with a palette
    buffer = io.BytesIO()
    picture.save(buffer, format="png", optimize=True, transparency=rgba[:, 3].tobytes())
    small = buffer.getvalue()
    return base64.b64encode(small).decode() if len(small) < len(png) else encoded
