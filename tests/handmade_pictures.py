"""Picture files written by hand, from the standards alone: no library of pictures has a part in them."""

import struct
import zlib
from itertools import pairwise

import numpy as np

ADAM7 = (
    (0, 0, 8, 8),
    (4, 0, 8, 8),
    (0, 4, 4, 8),
    (2, 0, 4, 4),
    (0, 2, 2, 4),
    (1, 0, 2, 2),
    (0, 1, 1, 2),
)  # x, y, steps
_COLOUR_TYPES = {"grey": 0, "rgb": 2, "palette": 3, "grey_alpha": 4, "rgb_alpha": 6}


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(samples, layout="grey", depth=8, interlaced=False, extra=()):
    """``samples``: [row, column, channel]; ``extra``: (kind, data) of chunks before the pixels."""
    samples = np.atleast_3d(samples)
    height, width, _ = samples.shape
    header = struct.pack(">IIBBBBB", width, height, depth, _COLOUR_TYPES[layout], 0, 0, int(interlaced))
    passes = ADAM7 if interlaced else ((0, 0, 1, 1),)
    raw = b"".join(_scanlines(samples[y::dy, x::dx], depth) for x, y, dx, dy in passes)
    chunks = [(b"IHDR", header), *extra, (b"IDAT", zlib.compress(raw)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*each) for each in chunks)


def _scanlines(samples, depth):
    """Rows of one pass, each with another of the five filters."""
    height, width, channels = samples.shape
    if width == 0 or height == 0:
        return b""
    if depth == 16:
        rows = samples.astype(">u2").reshape(height, -1).view(np.uint8)
    elif depth == 8:
        rows = samples.astype(np.uint8).reshape(height, -1)
    else:
        bits = (samples.reshape(height, -1, 1).astype(np.uint8) >> np.arange(depth - 1, -1, -1)) & 1
        rows = np.packbits(bits.reshape(height, -1).astype(np.uint8), axis=1)
    step = max(1, channels * depth // 8)
    lines, above = [], np.zeros(rows.shape[1], dtype=int)
    for number, row in enumerate(rows.astype(int)):
        left, corner = (np.concatenate([np.zeros(step, dtype=int), line])[: len(row)] for line in (row, above))
        guess = left + above - corner
        distances = np.stack([abs(guess - left), abs(guess - above), abs(guess - corner)])
        paeth = np.choose(distances.argmin(axis=0), [left, above, corner])
        kind = number % 5
        predicted = (np.zeros_like(row), left, above, (left + above) // 2, paeth)[kind]
        lines.append(bytes([kind, *((row - predicted) % 256)]))
        above = row
    return b"".join(lines)


def tiff(samples, order="<", photometric=None, extra_tags=(), deflated=False, predictor=False, rows_per_strip=None):
    """Interleaved ``samples`` [row, column, channel] of their own type; ``extra_tags``: (code, type, values)."""
    samples = np.atleast_3d(samples)
    height, width, channels = samples.shape
    kind, bits = samples.dtype.kind, samples.dtype.itemsize * 8
    stored = samples
    if predictor:
        stored = samples.copy()
        stored[:, 1:] = samples[:, 1:] - samples[:, :-1]  # modulo the size of the type
    stored = stored.astype(stored.dtype.newbyteorder(order))
    edges = [*range(0, height, rows_per_strip or height), height]
    strips = [stored[a:b].tobytes() for a, b in pairwise(edges)]
    strips = [zlib.compress(strip) for strip in strips] if deflated else strips
    tags = {
        256: (4, [width]), 257: (4, [height]), 258: (3, [bits] * channels), 259: (3, [8 if deflated else 1]),
        262: (3, [photometric if photometric is not None else (2 if channels >= 3 else 1)]),
        277: (3, [channels]), 278: (4, [rows_per_strip or height]), 279: (4, [len(strip) for strip in strips]),
        339: (3, [{"u": 1, "i": 2, "f": 3}[kind]] * channels),
    }  # fmt: skip
    if predictor:
        tags[317] = (3, [2])
    tags |= {code: (type_, values) for code, type_, values in extra_tags}
    tags[273] = (4, [0] * len(strips))
    return _with_directory(strips, tags, order)


def _with_directory(strips, tags, order):
    body, places = b"", []
    for strip in strips:
        places.append(8 + len(body))
        body += strip + b"\0" * (len(strip) % 2)
    tags = dict(sorted((tags | {273: (4, places)}).items()))
    start = 8 + len(body)
    entries, behind = b"", b""
    free = start + 2 + 12 * len(tags) + 4
    for code, (kind, values) in tags.items():
        data = struct.pack(order + str(len(values)) + {1: "B", 3: "H", 4: "I"}[kind], *values)
        if len(data) > 4:
            place, behind = struct.pack(order + "I", free + len(behind)), behind + data + b"\0" * (len(data) % 2)
        else:
            place = data.ljust(4, b"\0")
        entries += struct.pack(order + "HHI", code, kind, len(values)) + place
    mark = b"II" if order == "<" else b"MM"
    header = mark + struct.pack(order + "HI", 42, start)
    return header + body + struct.pack(order + "H", len(tags)) + entries + b"\0" * 4 + behind


def bmp(grey):
    """Rows from the bottom, each padded to four bytes, through a palette of greys."""
    height, width = grey.shape
    rows = b"".join(bytes(row).ljust(-(-width // 4) * 4, b"\0") for row in grey[::-1])
    palette = b"".join(bytes([v, v, v, 0]) for v in range(256))
    start = 14 + 40 + len(palette)
    info = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 0, len(rows), 0, 0, 256, 0)
    return struct.pack("<2sIHHI", b"BM", start + len(rows), 0, 0, start) + info + palette + rows


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
