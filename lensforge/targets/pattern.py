"""Target patterns as relative light on the pixels of a receiver: means over each pixel, of all targets together."""

import hashlib
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.ndimage import gaussian_filter, map_coordinates

from lensforge.errors import InputError, remedy
from lensforge.files import read_file
from lensforge.pictures.reading import MOST_BYTES, read_light
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.receiver import Receiver
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.orientation import turned_over
from lensforge.spec import Target
from lensforge.spec.beams import BatwingTarget, BeamTarget, PhotometricTarget
from lensforge.spec.picture_targets import ArrayTarget, ImageTarget, TableTarget, TextTarget
from lensforge.spec.shapes import FlatTopTarget
from lensforge.spec.target import SoftTarget
from lensforge.targets import beams, shapes
from lensforge.targets.lettering import drawn_text
from lensforge.targets.tables import read_table

_OVERSAMPLING = 8  # sub-pixels per side: the area average of a hard edge is right to 1/64 of a pixel
_LEAST_SUBPIXELS, _MOST_SUBPIXELS = 512, 4096  # across the receiver: to resolve small patterns, and to bound the memory
_MOST_FILTERED = 2**30  # multiplications, some 1 s: above, blur and mean are one matrix, 7 times as fast at 4096^2
_BLOCK = 512  # columns multiplied at once: the rows that a block of means needs stay in the cache, 1.3 MB at 4096^2
_CANVAS = 1024  # pixels across the far field on which soft edges are drawn: 0.16 degrees on that to 80 degrees
_MISSING = "give an image file"
_KEPT_PATTERNS = 8  # a design asks for the same pattern of search and evaluation again and again; 8 MB at most each

Targets = tuple[Target, ...]
Image = Float[np.ndarray, "h w"]
Means = Float[np.ndarray, "p q"]


def target_light(targets: Targets, receiver: Receiver) -> Image:
    """Mean of the light wanted over each pixel [row y, column x], irradiance or intensity, with sum 1.

    Raises :class:`InputError` when the targets are dark everywhere on the receiver.
    """
    return _light(targets, receiver, tuple(_content(target) for target in targets)).copy()


def _content(target: Target) -> str:
    """SHA-256 of the file of a target, empty without one: another picture of the same name is another target."""
    if not isinstance(target, ImageTarget | TableTarget | PhotometricTarget):
        return ""
    with remedy("correct target.file"):
        return hashlib.sha256(read_file(target.file, missing=_MISSING, most_bytes=MOST_BYTES)).hexdigest()


@lru_cache(maxsize=_KEPT_PATTERNS)
def _light(targets: Targets, receiver: Receiver, contents: tuple[str, ...]) -> Image:
    grid = receiver.grid
    longest = max(grid.shape)
    times = max(1, min(max(_OVERSAMPLING, _LEAST_SUBPIXELS // longest), _MOST_SUBPIXELS // longest))
    images = [_means(target, receiver, times) for target in targets]
    if len(images) > 1:  # one alone keeps its scale, to the last bit
        images = [target.level / (image.max() or np.inf) * image for target, image in zip(targets, images, strict=True)]
    wanted: Image = sum(images[1:], start=images[0])
    total = float(wanted.sum())
    if not total >= np.finfo(np.float64).tiny:
        raise InputError("target: it is dark everywhere on the receiver; check the image, its size, and the receiver's")
    return wanted / total


def _means(target: Target, receiver: Receiver, times: int) -> Image:
    """Means of one target over the pixels."""
    grid, fine = receiver.grid, receiver.grid.finer(times)
    edge = target.edge if isinstance(target, SoftTarget) and not isinstance(target, BatwingTarget) else 0.0
    if receiver.kind == "far_field":
        return _far_field_means(target, receiver, fine, edge, times)
    pattern = _pattern(target, fine.x()[None, :], fine.y()[:, None], grid)
    sub_width, sub_height = fine.pixel
    return _softened_means(np.broadcast_to(pattern, fine.shape), (edge / sub_height, edge / sub_width), times)


def _far_field_means(target: Target, receiver: Receiver, fine: PixelGrid, edge: float, times: int) -> Image:
    """Means on the equal-area chart; soft edges are drawn, and blurred, over angles along x and y."""
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
    return _block_means(np.where(within, light, 0.0), times)


def _pattern(target: Target, x: shapes.Places, y: shapes.Places, grid: PixelGrid) -> shapes.Places:
    """A target with sharp edges at places (mm or degrees) on the receiver."""
    x, y = target.about_centre(x, y)
    match target:
        case FlatTopTarget():
            return shapes.flat_top(target, x, y)
        case TextTarget() | ImageTarget() | ArrayTarget() | TableTarget():
            picture = _picture(target)
            size = target.size_of(*picture.shape)
            _require_room(target, size, grid)
            return shapes.in_picture(picture, size, x, y)
        case BeamTarget():
            return beams.beam(target, x, y)
        case BatwingTarget():
            return beams.batwing(target, x, y)
        case PhotometricTarget():
            with remedy("correct target.file"):
                table = turned_over(read_photometric(target.file).intensity)
            return beams.photometric(table, x, y)
    return shapes.in_shape(target, x, y).astype(np.float64)


def _picture(target: shapes.PictureTarget) -> Image:
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


def _require_room(target: shapes.PictureTarget, size: tuple[float, float], grid: PixelGrid) -> None:
    if target.rotation_deg == 0.0 and (size[0] > grid.width or size[1] > grid.height) and target.unit == "mm":
        fits = f"{grid.width:g}" if grid.width == grid.height else f"{grid.width:g} x {grid.height:g}"
        raise InputError(
            f"target.width_mm = {target.size('width')}: the pattern is {size[0]:g} x {size[1]:g} mm, "
            f"it must fit into receiver_mm = {fits}"
        )


def _softened_means(image: Image, edge: tuple[float, float], times: int) -> Means:
    """Means over ``times`` x ``times`` of ``image`` convolved with a Gaussian, dark outside it.

    ``edge``: its standard deviations along the rows' and the columns' number.
    """
    if image.size * 2 * _gaussian_reach(max(edge)) > _MOST_FILTERED:
        return _softened_rows(_softened_rows(image, edge[0], times).T, edge[1], times).T
    return _block_means(gaussian_filter(image, edge, mode="constant") if max(edge) > 0.0 else image, times)


def _block_means(image: Image, times: int) -> Means:
    rows, columns = (size // times for size in image.shape)
    means: Means = image.reshape(rows, times, columns, times).mean(axis=(1, 3))
    return means


def _gaussian_reach(edge: float) -> int:
    """Taps of scipy's Gaussian filter on each side of the middle."""
    return int(4.0 * edge + 0.5)


def _softened_rows(image: Float[np.ndarray, "q r"], edge: float, times: int) -> Float[np.ndarray, "p r"]:
    """Blur along the columns, and means over ``times`` rows, as one product."""
    size, reach = len(image), _gaussian_reach(edge)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / edge) ** 2)
    both = np.pad(np.convolve(taps / taps.sum(), np.full(times, 1.0 / times)), size)
    # sparse: the full product of numpy would have other last digits for other numbers of threads
    lit = np.arange(size)[_around(image, 1)]
    matrix = sparse.csr_array(both[size + reach - times * np.arange(size // times)[:, None] + lit])
    means = np.zeros((size // times, image.shape[1]))
    within = _around(image, 0)
    for first in range(within.start, within.stop, _BLOCK):
        columns = slice(first, min(first + _BLOCK, within.stop))
        means[:, columns] = matrix @ np.ascontiguousarray(image[lit, columns])
    return means


def _around(image: Image, axis: int) -> slice:
    """Rows (``axis`` 1) or columns (0) outside of which all is dark."""
    places = np.flatnonzero(image.any(axis=axis))
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0, 0)
