"""Target patterns as relative irradiance on the receiver's pixels."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont, UnidentifiedImageError
from scipy.ndimage import gaussian_filter

from lensforge.errors import InputError
from lensforge.receivers.pixels import PixelGrid
from lensforge.spec import ArrayTarget, CrossTarget, FlatTopTarget, ImageTarget, Target, TextTarget

_OVERSAMPLING = 8  # sub-pixels per side: the area average of a hard edge is right to 1/64 of a pixel
_LEAST_SUBPIXELS, _MOST_SUBPIXELS = 512, 4096  # across the receiver: to resolve small patterns, and to bound the memory
_GLYPH_PIXELS = 1024  # font size at which text is drawn before it is scaled


def target_irradiance(target: Target, grid: PixelGrid) -> Float[np.ndarray, "p p"]:
    """Mean of the target irradiance over each pixel [row y, column x], with sum 1 over the receiver.

    Raises :class:`InputError` when the target is dark everywhere on the receiver.
    """
    n = grid.pixels
    k = max(1, min(max(_OVERSAMPLING, _LEAST_SUBPIXELS // n), _MOST_SUBPIXELS // n))
    fine = PixelGrid(grid.side_mm, n * k)
    match target:
        case FlatTopTarget():
            image = _flat_top(target, fine)
        case CrossTarget():
            image = (
                fine.rectangle_mask(target.length_mm, target.stroke_mm)
                | fine.rectangle_mask(target.stroke_mm, target.length_mm)
            ).astype(np.float64)
        case TextTarget():
            image = _place(_draw_text(target), target.width_mm, fine)
        case ImageTarget():
            image = _place(_read_image(target), target.width_mm, fine)
        case ArrayTarget():
            image = _place(target.values, target.width_mm, fine)
    if not isinstance(target, FlatTopTarget) and target.edge_mm > 0.0:
        image = gaussian_filter(image, target.edge_mm / fine.pitch_mm, mode="constant")
    coarse: Float[np.ndarray, "p p"] = image.reshape(n, k, n, k).mean(axis=(1, 3))
    total = float(coarse.sum())
    if not total > 0.0:
        raise InputError("target: it is dark everywhere on the receiver; check the image, width_mm, receiver_mm")
    return coarse / total


def _flat_top(target: FlatTopTarget, grid: PixelGrid) -> Float[np.ndarray, "p p"]:
    with np.errstate(over="ignore"):  # far outside a narrow pattern: exp(-inf) is the 0 that is meant
        profile = np.exp(-(np.abs(grid.axis_mm() / target.half_width_mm) ** target.exponent))
    return profile[:, None] * profile[None, :]


def _draw_text(target: TextTarget) -> Float[np.ndarray, "h w"]:
    """The text in matplotlib's bundled font (no system font, so every machine draws the same), cropped to its ink."""
    from matplotlib import get_data_path

    font = ImageFont.truetype(str(Path(get_data_path()) / "fonts/ttf/DejaVuSans.ttf"), _GLYPH_PIXELS)
    left, top, right, bottom = font.getbbox(target.text)
    canvas = Image.new("L", (int(right - left) + 4, int(bottom - top) + 4))
    ImageDraw.Draw(canvas).text((2 - left, 2 - top), target.text, fill=255, font=font)
    box = canvas.getbbox()
    if box is None:
        raise InputError(f"target.text = {target.text!r}: nothing to draw; give visible characters")
    return np.asarray(canvas.crop(box), dtype=np.float64) / 255.0


def _read_image(target: ImageTarget) -> Float[np.ndarray, "h w"]:
    try:
        with Image.open(target.file) as picture:
            return np.asarray(picture.convert("L"), dtype=np.float64) / 255.0
    except FileNotFoundError:
        raise InputError(f"target.file = {target.file}: no such file") from None
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise InputError(f"target.file = {target.file}: not a readable image ({error})") from None


def _place(picture: Float[np.ndarray, "h w"], width_mm: float, grid: PixelGrid) -> Float[np.ndarray, "p p"]:
    """The picture centred on the receiver, ``width_mm`` wide, nearest sub-pixel; row 0 of a picture is its top."""
    height, width = picture.shape
    if width_mm * max(1.0, height / width) > grid.side_mm:
        raise InputError(
            f"target.width_mm = {width_mm}: the pattern is {width_mm:g} x {width_mm * height / width:g} mm, "
            f"it must fit into receiver_mm = {grid.side_mm:g}"
        )
    scale = width / width_mm
    # clipped to just outside the picture: far from a narrow one the index would overflow
    column = np.clip(np.floor(grid.axis_mm() * scale + width / 2.0), -1, width).astype(int)
    row = np.clip(np.floor(-grid.axis_mm() * scale + height / 2.0), -1, height).astype(int)
    inside = ((row >= 0) & (row < height))[:, None] & ((column >= 0) & (column < width))[None, :]
    sampled = picture[np.clip(row, 0, height - 1)[:, None], np.clip(column, 0, width - 1)[None, :]]
    return np.where(inside, sampled, 0.0)
