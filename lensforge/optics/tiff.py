"""Pictures in TIFF files, by tifffile: grey, colours and palettes of 1 to 32 bits, whole or floating-point numbers."""

from dataclasses import replace
from io import BytesIO
from itertools import islice
from math import prod

import numpy as np
from jaxtyping import Real
from tifffile import PHOTOMETRIC, TiffFile, TiffPage

from lensforge.optics.image import (
    MOST_PIXELS,
    Picture,
    Refused,
    damage,
    not_srgb,
    picture_of,
    require_small,
    wrong_colours,
)

_OF_THREE = ("RGB", "YCBCR")  # the second is decoded to the first where it is packed as JPEG, else refused by tifffile
# None, fax, LZW, JPEG, deflate, PackBits, LZMA, Zstandard; others may take any memory to unpack.
_COMPRESSIONS = (1, 2, 3, 4, 5, 7, 8, 32773, 32946, 34925, 50000)
_MOST_STRIPS = 2**17  # tiles of 32 x 32 in the largest picture are half as many
_MOST_PAGES = 16  # smaller copies of the picture behind it
_SIGNED = 2  # a sample format
_ORIENTATION = 274  # a tag


def read_tiff(content: bytes) -> Picture:
    """Read the only picture of a TIFF file. Raises :class:`ValueError`, one line, for what is refused or damaged."""
    with damage("TIFF"), TiffFile(BytesIO(content)) as file:
        page = _only_page(file)
        colours = PHOTOMETRIC(page.photometric).name
        _require_readable(page, colours, len(content))
        stored = page.asarray(maxworkers=1).reshape(page.shape)
        samples = np.atleast_3d(np.moveaxis(stored, page.axes.find("S"), -1))
        values, full_scale = _tiff_values(page, colours, samples)
        opacity = samples[:, :, -1] if page.extrasamples and page.extrasamples[0] in (1, 2) else None
        orientation = int(page.tags.valueof(_ORIENTATION, default=1))
        floating = "floating-point values are linear by convention" if values.dtype.kind == "f" else ""
        reason = floating or not_srgb(page.iccprofile or b"")
    picture = picture_of(values, opacity, not_srgb=reason, orientation=orientation, full_scale=full_scale)
    return replace(picture, premultiplied=picture.opacity is not None and page.extrasamples[0] == 1)


def _tiff_values(
    page: TiffPage, colours: str, samples: Real[np.ndarray, "h w c"]
) -> tuple[Real[np.ndarray, "h w d"], float]:
    """Grey, or red, green and blue, of all channels as stored, and the full scale."""
    if colours == "PALETTE":
        assert page.colormap is not None
        table = page.colormap >> 8  # writers fill the lower byte with zeros, or with the upper one
        return np.moveaxis(table[:, samples[:, :, 0].astype(np.intp)], 0, -1), 255.0
    values = samples[:, :, : 3 if colours in _OF_THREE else 1]
    full_scale = 1.0 if values.dtype.kind == "f" else float(2**page.bitspersample - 1)
    if colours == "MINISWHITE":
        values = (values.dtype.type(full_scale) - values).astype(values.dtype)
    return values, full_scale


def _only_page(file: TiffFile) -> TiffPage:
    """The only picture of a TIFF file; smaller copies of it do not count."""
    pages = [page.aspage() for page in islice(file.pages, _MOST_PAGES + 2)]
    if len(pages) > _MOST_PAGES + 1 or any(not page.is_reduced for page in pages[1:]):
        raise Refused("it holds several pictures, must be one")
    return pages[0]


def _require_readable(page: TiffPage, colours: str, size: int) -> None:
    """Refuse a picture whose pixels would fill the memory, are not all in the file of ``size``, or are no light."""
    require_small(page.imagewidth, page.imagelength, MOST_PIXELS)
    if colours not in ("MINISWHITE", "MINISBLACK", "PALETTE", *_OF_THREE):
        raise Refused(wrong_colours(colours))
    if page.samplesperpixel > 5 or page.imagedepth != 1:
        raise Refused(f"{page.samplesperpixel} samples for each pixel, must be grey or RGB")
    if page.dtype is None or 0 in page.shape or page.samplesperpixel < (3 if colours in _OF_THREE else 1):
        raise Refused("it holds no pixels of this kind")
    if page.sampleformat == _SIGNED:
        raise Refused("its values are signed numbers, must be unsigned or floating-point; convert it")
    if page.dtype.kind == "f" and (colours == "MINISWHITE" or page.extrasamples):
        raise Refused("its floating-point values have an opacity, or say that white is 0; save them without")
    if page.compression not in _COMPRESSIONS:
        raise Refused(f"its compression {page.compression} is not read; save it with LZW or deflate")
    if len(page.dataoffsets) > _MOST_STRIPS:
        raise Refused(f"{len(page.dataoffsets)} strips or tiles, at most {_MOST_STRIPS}")
    ends = [start + count for start, count in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if len(ends) != prod(page.chunked) or max(ends) > size or min(page.databytecounts) == 0:
        raise Refused("truncated: some of its pixels lie outside the file")
