"""Picture files: PNG written from the standard, with chunks of one's own; TIFF by tifffile; BMP and EXIF by Pillow."""

import io
import struct
import zlib

import numpy as np
import tifffile
from PIL import Image

_COLOUR_TYPES = {"grey": 0, "rgb": 2, "palette": 3, "grey_alpha": 4, "rgb_alpha": 6}


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(samples, layout="grey", depth=8, extra=()):
    """``samples``: [row, column, channel]; ``extra``: (kind, data) of chunks before the pixels."""
    samples = np.atleast_3d(samples)
    height, width, _ = samples.shape
    if depth >= 8:
        rows = samples.astype(f">u{depth // 8}").reshape(height, -1).view(np.uint8)
    else:
        bits = (samples.reshape(height, -1, 1) >> np.arange(depth - 1, -1, -1)) & 1
        rows = np.packbits(bits.reshape(height, -1).astype(np.uint8), axis=1)
    header = struct.pack(">IIBBBBB", width, height, depth, _COLOUR_TYPES[layout], 0, 0, 0)
    pixels = zlib.compress(np.pad(rows, ((0, 0), (1, 0))).tobytes())  # no filter before each row
    chunks = [(b"IHDR", header), *extra, (b"IDAT", pixels), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*fields) for fields in chunks)


def tiff(samples, order="<", orientation=1, **options):
    """Interleaved ``samples`` [row, column, channel] of their own type; ``options``: of tifffile."""
    file, samples = io.BytesIO(), np.atleast_3d(samples)
    kind = "rgb" if samples.shape[2] >= 3 else "minisblack"
    flat = samples if samples.shape[2] > 1 else samples[..., 0]
    turned = [(274, "H", 1, orientation, True)]
    settings = {"photometric": kind, "metadata": None, "extratags": turned} | options
    tifffile.imwrite(file, flat, byteorder=order, **settings)
    return file.getvalue()


def with_tag(content, code, value):
    """A little-endian TIFF file, one number of whose directory is another."""
    (first,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, first)
    places = range(first + 2, first + 2 + 12 * count, 12)
    place = next(place for place in places if struct.unpack_from("<H", content, place)[0] == code)
    return content[: place + 8] + struct.pack("<I", value) + content[place + 12 :]


def bmp(grey):
    file = io.BytesIO()
    Image.fromarray(grey).save(file, "BMP")
    return file.getvalue()


def exif(orientation, order="<"):
    """An EXIF block of this one tag."""
    mark = b"II" if order == "<" else b"MM"
    entry = struct.pack(order + "HHIHH", 274, 3, 1, orientation, 0)
    return mark + struct.pack(order + "HIH", 42, 8, 1) + entry + struct.pack(order + "I", 0)


RNG = np.random.default_rng(16)


def numbers(kind, channels, shape=(13, 17)):
    if kind.startswith("f"):
        return RNG.random((*shape, channels)).astype(kind)
    return RNG.integers(0, np.iinfo(kind).max, (*shape, channels), dtype=kind, endpoint=True)
