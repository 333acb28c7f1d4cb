"""Reading of an image file of any origin: recognised by its first bytes, bounded, decoded, and turned upright.

Chunks of PNG (W3C, Portable Network Graphics, third edition) and tags of TIFF and EXIF are checked before any decoder
sees them, each with its bound.
"""

import logging
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from itertools import islice
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Real, Shaped, UInt
from PIL.BmpImagePlugin import BmpImageFile
from PIL.ImageFile import ImageFile
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from tifffile import PHOTOMETRIC, TiffFile, TiffPage

from lensforge.errors import InputError
from lensforge.optics.image import (
    MOST_PIXELS,
    Luminance,
    Picture,
    Refused,
    damage,
    not_srgb,
    picture_of,
    require_small,
    wrong_colours,
)
from lensforge.results.files import MIB, read_file

for _name in ("PIL", "tifffile"):
    logging.getLogger(_name).addHandler(logging.NullHandler())  # their errors are raised, too; they need not print them

MOST_BYTES = 512 * MIB  # the largest picture, three colours of 16 bits, has 384 MiB where nothing is compressed
_SHOWN = 300  # characters of what a damaged file says
_MOST_SCANS = 6 * 10**8  # times pixels: each scan of a progressive JPEG is a pass over all; 10 of 60 million are usual
_SCAN = b"\xff\xda"  # inside a scan, 0xff is followed by 0
_UNCOMPRESSED_BMP = (0, 3, 6)  # plain, and plain with masks
_SRGB_CODES = b"\x01\x0d\x00"  # of a PNG's cICP chunk, ITU-T H.273: primaries of BT.709, curve of sRGB, RGB
_SRGB_GAMMAS = (0.45, 0.46)  # 1/2.2 is what writers give for sRGB
_ORIENTATION = 274  # a tag of EXIF and of TIFF


def read_light(path: Path | str, luminance: Luminance, *, missing: str) -> Float[np.ndarray, "h w"]:
    """Relative light that the picture ``path`` stands for, row 0 at the top, 1 at its full scale.

    Raises :class:`InputError` as :func:`read_picture` does, and if values to be decoded as sRGB are not.
    """
    picture = read_picture(path, missing=missing)
    if luminance == "srgb" and picture.not_srgb:
        raise InputError(f'{path}: {picture.not_srgb}; for luminance = "srgb" convert it to sRGB, or leave that out')
    return picture.light(luminance)


def read_picture(path: Path | str, *, missing: str, orientation: int | None = None) -> Picture:
    """Read a PNG, TIFF, JPEG or BMP file of 1 to 32 bits, grey, colours or a palette, upright by its EXIF orientation.

    ``orientation``: instead of the file's own. Of a JPEG file that holds several pictures the first is read. Raises
    :class:`InputError` for what is not such a file, for several frames or pages, for more than 67 million pixels, for
    damage, for colours other than grey and RGB, and for values below 0 or not finite; ``missing`` is the remedy where
    there is no file.
    """
    content = read_file(path, missing=missing, most_bytes=MOST_BYTES)
    read = next((reader for begin, reader in _READERS.items() if content.startswith(begin)), None)
    if read is None:
        raise InputError(f"{path}: not a readable image, must be PNG, TIFF, JPEG or BMP; convert it")
    try:
        picture = read(content)
    except ValueError as error:
        raise InputError(f"{path}: {str(error)[:_SHOWN]}") from None
    if picture.values.dtype.kind == "f" and not (np.isfinite(picture.values).all() and picture.values.min() >= 0.0):
        raise InputError(f"{path}: pixels must be finite, and none below 0")
    return _upright(picture if orientation is None else replace(picture, orientation=orientation))


def _png(content: bytes) -> Picture:
    header = _opened(PngImageFile, content)
    import imagecodecs

    with damage("PNG"):
        samples = imagecodecs.png_decode(_pixels_only(content))  # a palette is looked up, transparency a channel
        orientation = _exif_orientation(header)
    values, opacity = _separate(np.atleast_3d(samples))
    reason = _png_not_srgb(header, content) or _profile_not_srgb(header)
    return picture_of(values, opacity, not_srgb=reason, orientation=orientation)


def _pixels_only(content: bytes) -> bytes:
    """The PNG file without text and profiles, of which libpng may complain on the terminal."""
    pieces = [content[:8]]
    position = 8
    while position + 12 <= len(content):
        end = position + 12 + int.from_bytes(content[position : position + 4], "big")
        if content[position + 4 : position + 8] in (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"):
            pieces.append(content[position:end])
        position = end
    return b"".join(pieces)


def _png_not_srgb(header: ImageFile, content: bytes) -> str:
    """Reason why the values are not sRGB, by numeric chunks; "" if they may be."""
    codes = content.find(b"cICP", 0, content.find(b"IDAT"))
    if codes >= 0:
        return "" if content[codes + 4 : codes + 7] == _SRGB_CODES else "its cICP chunk states another encoding"
    gamma = header.info.get("gamma")
    if gamma is None or "srgb" in header.info or "icc_profile" in header.info:
        return ""
    return "" if _SRGB_GAMMAS[0] <= gamma <= _SRGB_GAMMAS[1] else f"its gAMA chunk states {gamma:g}"


def _jpeg(content: bytes) -> Picture:
    return _eight_bits(JpegImageFile, content, most_pixels=_MOST_SCANS // max(1, content.count(_SCAN)))


def _bmp(content: bytes) -> Picture:
    return _eight_bits(BmpImageFile, content)


def _eight_bits(kind: type[ImageFile], content: bytes, most_pixels: int = MOST_PIXELS) -> Picture:
    file = _opened(kind, content, most_pixels)
    if file.mode in ("CMYK", "YCbCr", "LAB"):
        raise ValueError(wrong_colours(file.mode))
    if kind is BmpImageFile and file.info.get("compression", 0) not in _UNCOMPRESSED_BMP:
        raise ValueError("a compressed BMP file; save it as PNG")
    with damage(str(file.format)):
        samples = np.asarray(file.convert({"1": "L", "P": "RGB"}.get(file.mode, file.mode)))
        orientation = _exif_orientation(file)
    values, opacity = _separate(np.atleast_3d(samples))
    return picture_of(values, opacity, not_srgb=_profile_not_srgb(file), orientation=orientation)


def _opened(kind: type[ImageFile], content: bytes, most_pixels: int = MOST_PIXELS) -> ImageFile:
    """The file with only its header read; by its class, so that Pillow tries no other format."""
    with damage(kind.format or ""):
        file = kind(BytesIO(content))
        require_small(*file.size, min(most_pixels, MOST_PIXELS))
        if kind is PngImageFile and getattr(file, "n_frames", 1) > 1:
            raise Refused("it holds several frames, must be one picture")
    return file


def _separate(samples: UInt[np.ndarray, "h w c"]) -> tuple[UInt[np.ndarray, "h w d"], UInt[np.ndarray, "h w"] | None]:
    """Grey or colours, and the opacity if it is the last channel."""
    if samples.shape[2] in (2, 4):
        return samples[:, :, :-1], samples[:, :, -1]
    return samples, None


def _exif_orientation(file: ImageFile) -> int:
    orientation: Any = file.getexif().get(_ORIENTATION, 1)
    return orientation if isinstance(orientation, int) else 1


def _profile_not_srgb(file: ImageFile) -> str:
    profile = file.info.get("icc_profile")
    return not_srgb(profile if isinstance(profile, bytes) else b"")


def _upright(picture: Picture) -> Picture:
    """The picture turned or mirrored as its orientation states (CIPA DC-008, tag 274)."""
    opacity = None if picture.opacity is None else _turned(picture.opacity, picture.orientation)
    return replace(picture, values=_turned(picture.values, picture.orientation), opacity=opacity)


def _turned(values: Shaped[np.ndarray, "h w *c"], orientation: int) -> Shaped[np.ndarray, "a b *c"]:
    if orientation >= 5:
        values = values.swapaxes(0, 1)
    flips_rows = orientation in (3, 4, 7, 8)
    flips_columns = orientation in (2, 3, 6, 7)
    return values[:: -1 if flips_rows else 1, :: -1 if flips_columns else 1]


_OF_THREE = ("RGB", "YCBCR")  # the second is decoded to the first where it is packed as JPEG, else refused by tifffile
# None, fax, LZW, JPEG, deflate, PackBits, LZMA, Zstandard; others may take any memory to unpack.
_COMPRESSIONS = (1, 2, 3, 4, 5, 7, 8, 32773, 32946, 34925, 50000)
_MOST_STRIPS = 2**17  # tiles of 32 x 32 in the largest picture are half as many
_MOST_PAGES = 16  # smaller copies of the picture behind it
_SIGNED = 2  # a sample format


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
        raise Refused(f"its compression {str(page.compression)!a} is not read; save it with LZW or deflate")
    if len(page.dataoffsets) > _MOST_STRIPS:
        raise Refused(f"{len(page.dataoffsets)} strips or tiles, at most {_MOST_STRIPS}")
    ends = [start + count for start, count in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if len(ends) != prod(page.chunked) or max(ends) > size or min(page.databytecounts) == 0:
        raise Refused("truncated: some of its pixels lie outside the file")


_READERS: dict[bytes, Callable[[bytes], Picture]] = {
    b"\x89PNG\r\n\x1a\n": _png,
    b"II*\0": read_tiff,
    b"MM\0*": read_tiff,
    b"\xff\xd8\xff": _jpeg,
    b"BM": _bmp,
}
