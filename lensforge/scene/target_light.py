"""Relative light of targets at places about their centre: those read from a file or drawn in a font, and all others.

Text is drawn in a font that comes with a dependency: no font of the system has a part in it. Tables of light are a text
with a line for each row from the top, or an npz file with one array [row, column].
"""

import unicodedata
import warnings
from collections.abc import Callable, Collection
from functools import partial, singledispatch
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont, features

from lensforge.errors import FileWarning, InputError, remedy
from lensforge.optics.image_reading import read_light
from lensforge.results.files import MIB, read_file
from lensforge.results.json_npz import arrays_in
from lensforge.results.record import LARGEST
from lensforge.results.text_dialect import shown
from lensforge.results.text_table import TextTable
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.sources.light_files import read_photometric
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.photometric_file import far_field_warnings, turned_over
from lensforge.spec import ArrayTarget, ImageTarget, TableTarget, TargetSection, TextTarget
from lensforge.spec.far_field_targets import PhotometricTarget
from lensforge.spec.picture_targets import PictureTarget
from lensforge.spec.target_sections import Places

LightAt = Callable[[Places, Places], Places]
MISSING = "give an image file"


@singledispatch
def light_of(target: TargetSection, grid: PixelGrid) -> LightAt:
    """Light of a target, by x and y about its centre; a kind whose light is read from a file has a function here.

    ``grid``: of its receiver, which a picture must fit. Raises :class:`InputError` for a file that cannot be used.
    """
    return target.light


@light_of.register
def _(target: PictureTarget, grid: PixelGrid) -> LightAt:
    picture = picture_of(target)
    width, height = target.size_of(*picture.shape)
    if target.rotation_deg == 0.0 and (width > grid.width or height > grid.height) and target.unit == "mm":
        fits = f"{grid.width:g}" if grid.width == grid.height else f"{grid.width:g} x {grid.height:g}"
        raise InputError(
            f"target.width_mm = {target.size('width')}: the pattern is {width:g} x {height:g} mm, "
            f"it must fit into receiver_mm = {fits}"
        )
    return partial(target.shown, picture)


@light_of.register
def _(target: PhotometricTarget, grid: PixelGrid) -> LightAt:
    with remedy("correct target.file"):
        file = read_photometric(target.file)
    for warning in far_field_warnings(file):
        warnings.warn(f"{target.file}: {warning}", FileWarning, stacklevel=1)
    return partial(photometric, turned_over(file.intensity))


@singledispatch
def picture_of(target: PictureTarget) -> Float[np.ndarray, "h w"]:
    """The picture itself, row 0 at the top."""
    raise NotImplementedError(f"a target of kind {target.kind} has no picture")


picture_of.register(TextTarget, lambda target: drawn_text(target.text))
picture_of.register(ArrayTarget, lambda target: target.values)


@picture_of.register
def _(target: ImageTarget) -> Float[np.ndarray, "h w"]:
    with remedy("correct target.file"):
        return read_light(target.file, target.luminance, missing=MISSING)


@picture_of.register
def _(target: TableTarget) -> Float[np.ndarray, "h w"]:
    with remedy("correct target.file"):
        return read_table(target.file)


def photometric(intensity: CandelaTable, x: Places, y: Places) -> Places:
    """A table of intensities, bilinear over C and gamma, 0 beyond its last gamma."""
    gamma = np.hypot(x, y)
    azimuth = np.degrees(np.arctan2(y, x)) % 360.0
    angles = intensity.gamma_deg
    planes = intensity.c_deg
    row = np.interp(gamma, angles, np.arange(len(angles)))
    column = np.interp(azimuth, planes, np.arange(len(planes))) if len(planes) > 1 else np.zeros_like(gamma)
    low = np.minimum(row.astype(int), len(angles) - 2)
    left = np.minimum(column.astype(int), max(len(planes) - 2, 0))
    up = row - low
    right = column - left
    beside = np.minimum(left + 1, len(planes) - 1)
    values = intensity.values
    light = (1.0 - right) * ((1.0 - up) * values[left, low] + up * values[left, low + 1])
    light = light + right * ((1.0 - up) * values[beside, low] + up * values[beside, low + 1])
    return np.where((gamma >= angles[0]) & (gamma <= angles[-1]), light, 0.0)


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


_MOST_BYTES = 64 * MIB  # a text of 2000 x 2000 numbers of 16 characters
_ZIP = b"PK\x03\x04"  # begins every npz file


def read_table(path: Path) -> Float[np.ndarray, "h w"]:
    """Light (relative) in ``path``. Raises :class:`InputError` for anything that is no table of numbers from 0 up."""
    content = read_file(path, missing="give a CSV or npz file", most_bytes=_MOST_BYTES)
    values = _from_npz(content, path) if content.startswith(_ZIP) else _from_text(content, path)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"{path}: shape {values.shape}, must be a table of rows and columns")
    if not (values.min() >= 0.0 and 1.0 / LARGEST <= values.max() <= LARGEST):
        extremes = f"{values.min():.4g} to {values.max():.4g}"
        raise InputError(
            f"{path}: {extremes}; must be 0 or above, and its largest from {1.0 / LARGEST:g} to {LARGEST:g}"
        )
    return values


def _from_npz(content: bytes, path: Path) -> np.ndarray:
    try:
        arrays = arrays_in(content, None, 4 * _MOST_BYTES)
    except ValueError as error:
        raise InputError(f"{path}: {error}; save it again with numpy.savez") from None
    if len(arrays) != 1:
        raise InputError(f"{path}: holds {len(arrays)} arrays, must hold one; save it with numpy.savez(path, values)")
    return next(iter(arrays.values())).astype(np.float64)


def _from_text(content: bytes, path: Path) -> np.ndarray:
    table = TextTable.of(content, str(path))
    if table.header:
        line = table.header[0]
        raise InputError(f"{path}, line {line.number}: {shown(line.text)}: must be rows of numbers alone; leave it out")
    return table.numbers()
