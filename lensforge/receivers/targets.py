"""Target patterns as relative irradiance on the receiver's pixels."""

import hashlib
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse
from scipy.ndimage import gaussian_filter

from lensforge.errors import InputError, remedy
from lensforge.files import read_file
from lensforge.pictures.reading import MOST_BYTES, read_light
from lensforge.receivers.lettering import drawn_text
from lensforge.receivers.pixels import PixelGrid
from lensforge.spec import ArrayTarget, CrossTarget, FlatTopTarget, ImageTarget, Target, TextTarget

_OVERSAMPLING = 8  # sub-pixels per side: the area average of a hard edge is right to 1/64 of a pixel
_LEAST_SUBPIXELS, _MOST_SUBPIXELS = 512, 4096  # across the receiver: to resolve small patterns, and to bound the memory
_MOST_FILTERED = 2**30  # multiplications, some 1 s: above, blur and mean are one matrix, 7 times as fast at 4096^2
_BLOCK = 512  # columns multiplied at once: the rows that a block of means needs stay in the cache, 1.3 MB at 4096^2
_MISSING = "give an image file"
_KEPT_PATTERNS = 4  # a design asks for the same pattern of search and evaluation again and again; 8 MB at most each


def target_irradiance(target: Target, grid: PixelGrid) -> Float[np.ndarray, "p p"]:
    """Mean of the target irradiance over each pixel [row y, column x], with sum 1 over the receiver.

    Raises :class:`InputError` when the target is dark everywhere on the receiver.
    """
    return _irradiance(target, grid, _content(target)).copy()


def _content(target: Target) -> str:
    """SHA-256 of the picture of a target, empty without one: another picture of the same name is another target."""
    if not isinstance(target, ImageTarget):
        return ""
    with remedy("correct target.file"):
        return hashlib.sha256(read_file(target.file, missing=_MISSING, most_bytes=MOST_BYTES)).hexdigest()


@lru_cache(maxsize=_KEPT_PATTERNS)
def _irradiance(target: Target, grid: PixelGrid, content: str) -> Float[np.ndarray, "p p"]:
    n = grid.pixels
    k = max(1, min(max(_OVERSAMPLING, _LEAST_SUBPIXELS // n), _MOST_SUBPIXELS // n))
    fine = PixelGrid(grid.side_mm, n * k)
    edge = 0.0 if isinstance(target, FlatTopTarget) else target.edge_mm / fine.pitch_mm
    coarse = _softened_means(_pattern(target, fine), edge, k)
    total = float(coarse.sum())
    if not total >= np.finfo(np.float64).tiny:
        raise InputError("target: it is dark everywhere on the receiver; check the image, width_mm, receiver_mm")
    return coarse / total


def _pattern(target: Target, fine: PixelGrid) -> Float[np.ndarray, "q q"]:
    match target:
        case FlatTopTarget():
            return _flat_top(target, fine)
        case CrossTarget():
            lying = fine.rectangle_mask(target.length_mm, target.stroke_mm)
            cross: Bool[np.ndarray, "q q"] = lying | fine.rectangle_mask(target.stroke_mm, target.length_mm)
            return cross.astype(np.float64)
        case TextTarget():
            return _place(drawn_text(target.text), target.width_mm, fine)
        case ImageTarget():
            with remedy("correct target.file"):
                picture = read_light(target.file, target.luminance, missing=_MISSING)
            return _place(picture, target.width_mm, fine)
        case ArrayTarget():
            return _place(target.values, target.width_mm, fine)


def _softened_means(image: Float[np.ndarray, "q q"], edge: float, k: int) -> Float[np.ndarray, "p p"]:
    """Means over k x k of ``image`` convolved with a Gaussian of standard deviation ``edge``, dark outside it."""
    n = len(image) // k
    if len(image) ** 2 * 2 * _gaussian_reach(edge) > _MOST_FILTERED:
        return _softened_rows(_softened_rows(image, edge, k).T, edge, k).T
    means: Float[np.ndarray, "p p"]
    if edge > 0.0:
        image = gaussian_filter(image, edge, mode="constant")
    means = image.reshape(n, k, n, k).mean(axis=(1, 3))
    return means


def _gaussian_reach(edge: float) -> int:
    """Taps of scipy's Gaussian filter on each side of the middle."""
    return int(4.0 * edge + 0.5)


def _softened_rows(image: Float[np.ndarray, "q r"], edge: float, k: int) -> Float[np.ndarray, "p r"]:
    """Blur along the columns, and means over ``k`` rows, as one product."""
    size, reach = len(image), _gaussian_reach(edge)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / edge) ** 2)
    both = np.pad(np.convolve(taps / taps.sum(), np.full(k, 1.0 / k)), size)
    # sparse: the full product of numpy would have other last digits for other numbers of threads
    lit = np.arange(size)[_around(image, 1)]
    matrix = sparse.csr_array(both[size + reach - k * np.arange(size // k)[:, None] + lit])
    means = np.zeros((size // k, image.shape[1]))
    within = _around(image, 0)
    for first in range(within.start, within.stop, _BLOCK):
        columns = slice(first, min(first + _BLOCK, within.stop))
        means[:, columns] = matrix @ np.ascontiguousarray(image[lit, columns])
    return means


def _around(image: Float[np.ndarray, "q r"], axis: int) -> slice:
    """Rows (``axis`` 1) or columns (0) outside of which all is dark."""
    places = np.flatnonzero(image.any(axis=axis))
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0, 0)


def _flat_top(target: FlatTopTarget, grid: PixelGrid) -> Float[np.ndarray, "p p"]:
    with np.errstate(over="ignore"):  # far outside a narrow pattern: exp(-inf) is the 0 that is meant
        profile = np.exp(-(np.abs(grid.axis_mm() / target.half_width_mm) ** target.exponent))
    return profile[:, None] * profile[None, :]


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
