"""Target patterns as relative light on the pixels of a receiver: means over each pixel, of all targets together.

Text is drawn in a font that comes with a dependency: no font of the system has a part in it. Tables of light are a text
with a line for each row from the top, or an npz file with one array [row, column]. The regions of a receiver in
which uniformity counts, and in which light counts as in the target, follow from its targets.
"""

import hashlib
import unicodedata
import warnings
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image, ImageDraw, ImageFont, features
from scipy.ndimage import gaussian_filter, map_coordinates

from lensforge.errors import FileWarning, InputError, remedy
from lensforge.kernels.parallel import in_pieces
from lensforge.optics.image_reading import MOST_BYTES, read_light
from lensforge.results.files import MIB, read_file
from lensforge.results.json_npz import arrays_in
from lensforge.results.record import LARGEST
from lensforge.results.text_dialect import shown
from lensforge.results.text_table import TextTable
from lensforge.scene import target_shapes
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.photometric_file import far_field_warnings, turned_over
from lensforge.spec import Target
from lensforge.spec.shape_targets import FlatTopTarget
from lensforge.spec.target_sections import (
    IN_TARGET,
    ArrayTarget,
    BatwingTarget,
    BeamTarget,
    ImageTarget,
    PhotometricTarget,
    SoftTarget,
    TableTarget,
    TextTarget,
)

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


_WORTH_SHARING = 2**15  # hits: three milliseconds of work
_OVERSAMPLING = 8  # sub-pixels per side: the area average of a hard edge is right to 1/64 of a pixel
_LEAST_SUBPIXELS, _MOST_SUBPIXELS = 512, 4096  # across the receiver: to resolve small patterns, and to bound the memory
_CANVAS = 1024  # pixels across the far field on which soft edges are drawn: 0.16 degrees on that to 80 degrees
_MISSING = "give an image file"
_KEPT_PATTERNS = 16  # a design asks for those of search and evaluation again and again; 48 MB at most each

Targets = tuple[Target, ...]
TargetImage = Float[np.ndarray, "h w"]
Means = Float[np.ndarray, "p q"]


@dataclass(frozen=True)
class DrawnTarget:
    """The targets of a receiver: ``light`` on its pixels [row y, column x], relative, with sum 1.

    ``inside``: sub-pixels of ``fine`` in which they are above a tenth of their largest pixel.
    """

    light: TargetImage
    fine: PixelGrid
    inside: Bool[np.ndarray, "q r"]

    def contains(self, hits: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """True for hits in the target, to a sub-pixel."""
        grid, found = self.fine, np.empty(len(hits), dtype=bool)

        def work(part: slice) -> None:
            column, row = np.floor((hits[part] / grid.size + 0.5) * (grid.columns, grid.rows)).T
            within = (column >= 0.0) & (column < grid.columns) & (row >= 0.0) & (row < grid.rows)
            within[within] = self.inside[row[within].astype(np.intp), column[within].astype(np.intp)]
            found[part] = within

        in_pieces(work, len(hits), worth=_WORTH_SHARING)
        return found

    @cached_property
    def coverage(self) -> TargetImage:
        """Share of each pixel's area that is in the target."""
        return _block_means(self.inside.astype(np.float64), self.fine.columns // self.light.shape[1])


def target_light(targets: Targets, receiver: PosedReceiver) -> TargetImage:
    """Mean of the light wanted over each pixel [row y, column x], irradiance or intensity, with sum 1.

    Raises :class:`InputError` when the targets are dark everywhere on the receiver.
    """
    return drawn_target(targets, receiver).light.copy()


def drawn_target(targets: Targets, receiver: PosedReceiver) -> DrawnTarget:
    """The light wanted, and where the target is. Raises :class:`InputError` as :func:`target_light`."""
    return _drawn(targets, receiver, tuple(_content(target) for target in targets), _subpixels(receiver))


def coarser_target(targets: Targets, receiver: PosedReceiver) -> DrawnTarget:
    """The light wanted, on half as many pixels and with sub-pixels twice as wide: it shows what a raster changes."""
    half = replace(receiver, grid=receiver.grid.halved())
    return _drawn(targets, half, tuple(_content(target) for target in targets), _subpixels(receiver))


def _subpixels(receiver: PosedReceiver) -> int:
    """Sub-pixels along a side of each pixel."""
    longest = max(receiver.grid.shape)
    return max(1, min(max(_OVERSAMPLING, _LEAST_SUBPIXELS // longest), _MOST_SUBPIXELS // longest))


def _content(target: Target) -> str:
    """SHA-256 of the file of a target, empty without one: another picture of the same name is another target."""
    if not isinstance(target, ImageTarget | TableTarget | PhotometricTarget):
        return ""
    with remedy("correct target.file"):
        return hashlib.sha256(read_file(target.file, missing=_MISSING, most_bytes=MOST_BYTES)).hexdigest()


@lru_cache(maxsize=_KEPT_PATTERNS)
def _drawn(targets: Targets, receiver: PosedReceiver, contents: tuple[str, ...], times: int) -> DrawnTarget:
    fine = receiver.grid.finer(times)
    wanted, lit = np.zeros(receiver.grid.shape), np.zeros(fine.shape)
    for target in targets:
        means, image = _softened(*_drawn_sharp(target, receiver, fine), times)
        # one alone keeps its scale, to the last bit
        scale = target.level / (means.max() or np.inf) if len(targets) > 1 else 1.0
        wanted += scale * means
        lit += scale * image
    total = float(wanted.sum())
    if not total >= np.finfo(np.float64).tiny:
        raise InputError("target: it is dark everywhere on the receiver; check the image, its size, and the receiver's")
    return DrawnTarget(wanted / total, fine, lit > IN_TARGET * wanted.max())


def _drawn_sharp(target: Target, receiver: PosedReceiver, fine: PixelGrid) -> tuple[TargetImage, tuple[float, float]]:
    """One target on the sub-pixels, and the soft edge that it still needs, in sub-pixels along rows and columns."""
    edge = target.edge if isinstance(target, SoftTarget) and not isinstance(target, BatwingTarget) else 0.0
    if receiver.kind == "far_field":
        return _on_far_field(target, receiver, fine, edge), (0.0, 0.0)
    pattern = _pattern(target, fine.x()[None, :], fine.y()[:, None], receiver.grid)
    sub_width, sub_height = fine.pixel
    return np.broadcast_to(pattern, fine.shape), (edge / sub_height, edge / sub_width)


def _on_far_field(target: Target, receiver: PosedReceiver, fine: PixelGrid, edge: float) -> TargetImage:
    """Light on the equal-area chart; soft edges are drawn, and blurred, over angles along x and y."""
    x, y = receiver.target_coordinates(*np.meshgrid(fine.x(), fine.y()))
    within = receiver.window.pixels(fine)
    if edge == 0.0:
        light = _pattern(target, x, y, receiver.grid)
    else:
        reach = float(np.hypot(x, y)[within].max()) + 4.0 * edge
        canvas = PixelGrid.square(2.0 * reach, _CANVAS)
        drawn = np.broadcast_to(_pattern(target, canvas.x()[None, :], canvas.y()[:, None], canvas), canvas.shape)
        blurred = gaussian_filter(drawn, edge / canvas.pixel[0], mode="constant")
        places = (np.stack([y, x]) / (2.0 * reach) + 0.5) * _CANVAS - 0.5
        light = map_coordinates(blurred, places, order=1, mode="constant")
    return np.where(within, light, 0.0)


def _pattern(target: Target, x: target_shapes.Places, y: target_shapes.Places, grid: PixelGrid) -> target_shapes.Places:
    """A target with sharp edges at places (mm or degrees) on the receiver."""
    x, y = target.about_centre(x, y)
    match target:
        case FlatTopTarget():
            return target_shapes.flat_top(target, x, y)
        case TextTarget() | ImageTarget() | ArrayTarget() | TableTarget():
            picture = _picture(target)
            size = target.size_of(*picture.shape)
            _require_room(target, size, grid)
            return target_shapes.in_picture(picture, size, x, y)
        case BeamTarget():
            return target_shapes.beam(target, x, y)
        case BatwingTarget():
            return target_shapes.batwing(target, x, y)
        case PhotometricTarget():
            with remedy("correct target.file"):
                file = read_photometric(target.file)
            for words in far_field_warnings(file):
                warnings.warn(f"{target.file}: {words}", FileWarning, stacklevel=1)
            return target_shapes.photometric(turned_over(file.intensity), x, y)
    return target_shapes.in_shape(target, x, y).astype(np.float64)


def _picture(target: target_shapes.PictureTarget) -> TargetImage:
    match target:
        case TextTarget():
            return drawn_text(target.text)
        case ImageTarget():
            with remedy("correct target.file"):
                return read_light(target.file, target.luminance, missing=_MISSING)
        case TableTarget():
            with remedy("correct target.file"):
                return read_table(target.file)
        case ArrayTarget():
            return target.values


def _require_room(target: target_shapes.PictureTarget, size: tuple[float, float], grid: PixelGrid) -> None:
    if target.rotation_deg == 0.0 and (size[0] > grid.width or size[1] > grid.height) and target.unit == "mm":
        fits = f"{grid.width:g}" if grid.width == grid.height else f"{grid.width:g} x {grid.height:g}"
        raise InputError(
            f"target.width_mm = {target.size('width')}: the pattern is {size[0]:g} x {size[1]:g} mm, "
            f"it must fit into receiver_mm = {fits}"
        )


def _softened(image: TargetImage, edge: tuple[float, float], times: int) -> tuple[Means, TargetImage]:
    """``image`` convolved with a Gaussian, dark outside it: means over ``times`` x ``times``, and itself.

    ``edge``: its standard deviations along the rows' and the columns' number.
    """
    blurred = gaussian_filter(image, edge, mode="constant") if max(edge) > 0.0 else image
    return _block_means(blurred, times), blurred


def _block_means(image: TargetImage, times: int) -> Means:
    rows, columns = (size // times for size in image.shape)
    means: Means = image.reshape(rows, times, columns, times).mean(axis=(1, 3))
    return means


def uniform_region(
    targets: tuple[Target, ...], receiver: PosedReceiver, wider_by_pixels: float = 0.0
) -> Bool[np.ndarray, "h w"] | None:
    """Pixels whose centres lie in the region of uniform light of any of ``targets``; None where none has one."""
    grid, region = receiver.grid, None
    for target in targets:
        sides = target.pair("uniform")
        if sides is None:
            continue
        x, y = receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
        x, y = target.about_centre(x, y)
        to_degrees = 180.0 / np.pi if receiver.kind == "far_field" else 1.0
        width, height = (
            side + wider_by_pixels * to_degrees * pixel for side, pixel in zip(sides, grid.pixel, strict=True)
        )
        inside = (np.abs(y) <= height / 2.0) & (np.abs(x) <= width / 2.0)
        region = inside if region is None else region | inside
    return region


def in_target(light: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels in the target: where it is above a tenth of its maximum."""
    inside: Bool[np.ndarray, "h w"] = light > IN_TARGET * light.max()
    return inside
