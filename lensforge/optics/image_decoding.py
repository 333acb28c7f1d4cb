"""Pixels of an image file by Pillow's decoders, with all the bits that are stored.

libtiff writes its complaints to the process's standard error and then gives what it has: here they are errors.
"""

import logging
import os
import re
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import Real, Shaped, UInt
from PIL.BmpImagePlugin import BmpImageFile
from PIL.ImageFile import ImageFile
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.TiffImagePlugin import TiffImageFile

_STANDARD_ERROR = 2  # of the process: Python's own may be another
# "TIFFFillStrip: Read error on strip 0": the name of a function of libtiff or of one of its codecs, or of the file.
_COMPLAINT = re.compile(
    rb"^(?:tempfile\.tif|\w*(?:TIFF|Decode|Setup|Predictor|Required|Fax|JPEG|LZW|LZMA|ZIP|ZSTD|LogL)\w*): .*",
    re.MULTILINE,
)


@contextmanager
def as_errors() -> Iterator[None]:
    """Turn what libtiff complains of inside the block into a :class:`ValueError`; other text goes on its way.

    Other threads may write to the standard error at the same time: what has not the form of a complaint is theirs.
    """
    with _held_back() as held:
        yield
    if complaint := _COMPLAINT.search(bytes(held)):
        raise ValueError(f"damaged: {complaint.group().decode('ascii', 'replace').strip()}")


@contextmanager
def _held_back() -> Iterator[bytearray]:
    """Hold back the text that goes to the standard error in the block; pass it on after it, but for complaints."""
    held = bytearray()
    try:
        before = os.dup(_STANDARD_ERROR)
    except OSError:  # it is closed, and nobody reads it
        yield held
        return
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), _STANDARD_ERROR)
        try:
            yield held
        finally:
            os.dup2(before, _STANDARD_ERROR)
            file.seek(0)
            held += file.read()
            with suppress(OSError):  # a standard error that nobody can write to any more
                os.write(before, _COMPLAINT.sub(b"", bytes(held)).lstrip(b"\n"))
            os.close(before)


logging.getLogger("PIL").addHandler(logging.NullHandler())  # its errors are raised, too; it need not print them
# By name, so that Pillow looks for no other: it has some forty, for formats that are rarely attacked and mended.
_DECODERS: dict[str, type[ImageFile]] = {
    "PNG": PngImageFile,
    "TIFF": TiffImageFile,
    "JPEG": JpegImageFile,
    "BMP": BmpImageFile,
}
MOST_PIXELS = 2**26  # 8192 x 8192: of 16-bit colours some 1.3 GB while they are read
_LONGEST_SIDE = 2**16
_COLOURS = {"CMYK": "the four inks of print (CMYK)", "YCbCr": "YCbCr", "LAB": "CIE L*a*b*"}
_EACH_BYTE = {"L": "B", "B": "L", "N": "B" if sys.byteorder == "little" else "L"}
_BIG_ENDIAN_FLOAT, _NATIVE_FLOAT = "F;32BF", "F;32F" if sys.byteorder == "little" else "F;32BF"
_MODES_OF_16_BITS = ("RGB", "RGBA")  # Pillow keeps the upper byte of each


@dataclass(frozen=True)
class Pixels:
    """Samples [row, column, channel] as stored: grey, or red, green and blue; of a palette its indices, too.

    ``exif``, ``profile``: blocks of the file, empty where there is none.
    """

    samples: Real[np.ndarray, "h w c"]
    opacity: UInt[np.ndarray, "h w"] | None
    indices: UInt[np.ndarray, "h w"] | None
    exif: bytes
    profile: bytes


def decoded(kind: str, content: bytes, most_pixels: int = MOST_PIXELS) -> Pixels:
    """Decode the file ``content`` of the format ``kind``; a palette is looked up.

    Raises :class:`ValueError` for a picture that is too large, for colours that have no one luminance, and for
    whatever the decoder does not read.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on tags and chunks that hold no pixels; what pixels lack is an error
        picture = _opened(kind, content, most_pixels)
        if picture.mode in _COLOURS:
            raise ValueError(f"its colours are {_COLOURS[picture.mode]}, must be grey or RGB")
        rawmode = _rawmode(picture)
        _keep_premultiplied(picture, rawmode)
        if rawmode == _BIG_ENDIAN_FLOAT and picture.tile[0][0] == "libtiff":
            _set_rawmode(picture, _NATIVE_FLOAT)  # libtiff swaps the bytes itself, and Pillow would do it again
        with as_errors() if kind == "TIFF" else nullcontext():
            samples = _loaded(picture)
        if picture.mode in _MODES_OF_16_BITS and rawmode.rstrip("LBN").endswith(";16"):
            lower = _opened(kind, content)
            _keep_premultiplied(lower, rawmode)
            samples = _with_lower_bytes(samples, lower)
        return _channels(picture, samples)


def _opened(kind: str, content: bytes, most_pixels: int = MOST_PIXELS) -> ImageFile:
    """The file with its header read, and no pixel. Raises :class:`ValueError`."""
    try:
        picture = _DECODERS[kind](BytesIO(content))
    except Exception as error:  # Pillow's parsers raise whatever a damaged file makes them
        raise ValueError(f"not readable as {kind}: {_reason(error)}") from None
    width, height = picture.size
    most = min(most_pixels, MOST_PIXELS)
    if width * height > most or max(width, height) > _LONGEST_SIDE:
        raise ValueError(
            f"{width} x {height} pixels, must be at most {most / 1e6:.3g} million of them and {_LONGEST_SIDE} on a "
            "side; make it smaller, or save it as PNG"
        )
    return picture


def _loaded(picture: ImageFile) -> Shaped[np.ndarray, "..."]:
    try:
        return np.asarray(picture)
    except Exception as error:  # as above
        raise ValueError(f"not readable as {picture.format}: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__


def _rawmode(picture: ImageFile) -> str:
    """Pillow's name of the layout of the stored samples."""
    if not picture.tile:
        raise ValueError(f"not readable as {picture.format}: it holds no pixels")
    arguments = picture.tile[0][3]
    return str(arguments[0] if isinstance(arguments, tuple) else arguments)


def _set_rawmode(picture: ImageFile, rawmode: str) -> None:
    tiles: list[Any] = []
    for tile in picture.tile:
        arguments = tile[3]
        changed = (rawmode, *arguments[1:]) if isinstance(arguments, tuple) else rawmode
        tiles.append(tile._replace(args=changed) if hasattr(tile, "_replace") else (*tile[:3], changed))
    picture.tile = tiles


def _keep_premultiplied(picture: ImageFile, rawmode: str) -> None:
    """Have colours that are multiplied by their opacity decoded as they are: divided, they would lose bits."""
    if rawmode.startswith("RGBa"):
        _set_rawmode(picture, rawmode.replace("RGBa", "RGBA"))


def _with_lower_bytes(upper: UInt[np.ndarray, "h w c"], picture: ImageFile) -> UInt[np.ndarray, "h w d"]:
    """Samples of 16 bits: Pillow decodes their upper bytes, and the lower ones when told the other byte order."""
    rawmode = _rawmode(picture)
    if rawmode == "LA;16B":  # grey and opacity, which together are four bytes
        _set_rawmode(picture, "RGBA")
        four = _loaded(picture).astype(np.uint16)
        return four[:, :, 0::2] << 8 | four[:, :, 1::2]
    _set_rawmode(picture, rawmode[:-1] + _EACH_BYTE[rawmode[-1]])
    samples = upper.astype(np.uint16)
    samples <<= 8
    samples |= _loaded(picture)
    return samples


def _channels(picture: ImageFile, samples: Shaped[np.ndarray, "..."]) -> Pixels:
    """Separate the opacity, look up the palette, and have every sample in the machine's byte order."""
    if picture.mode == "1":
        samples = samples.astype(np.uint8) * np.uint8(255)
    elif not samples.dtype.isnative:
        samples = samples.astype(samples.dtype.newbyteorder("="))
    opacity = indices = None
    if samples.ndim == 3 and samples.shape[2] in (2, 4):
        opacity, samples = samples[:, :, -1], samples[:, :, :-1]
    if picture.mode in ("P", "PA"):
        indices = samples.reshape(samples.shape[:2])
        samples = _looked_up(picture, indices)
    exif, profile = (_block(picture, name) for name in ("exif", "icc_profile"))
    return Pixels(samples.reshape(*samples.shape[:2], -1), opacity, indices, exif, profile)


def _block(picture: ImageFile, name: str) -> bytes:
    found = picture.info.get(name)
    return found if isinstance(found, bytes) else b""


def _looked_up(picture: ImageFile, indices: UInt[np.ndarray, "h w"]) -> UInt[np.ndarray, "h w 3"]:
    palette = np.array(picture.getpalette("RGB") or [], dtype=np.uint8).reshape(-1, 3)
    if int(indices.max()) >= len(palette):
        raise ValueError(f"damaged: colour {indices.max()} of a palette of {len(palette)}")
    looked_up: UInt[np.ndarray, "h w 3"] = palette[indices]
    return looked_up
