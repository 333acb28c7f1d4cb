"""PNG files, chunk by chunk with their right sums: sizes, depths, colours, texts, profiles, and pixels that unpack."""

import struct
import zlib
from functools import cache

from fuzzing.chance import Chance
from fuzzing.extremes import INTEGERS, packed
from fuzzing.noise import damaged

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = "IIBBBBB"  # width, height, depth, colour, compression, filter, interlace
_SIDE = 8
_COLOURS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_NAMES = (
    b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"tEXt", b"zTXt", b"iTXt", b"bKGD",
    b"pHYs", b"sBIT", b"eXIf", b"acTL", b"fcTL", b"fdAT", b"cICP", b"ABCD", b"abcd", b"a\0cd",
)  # fmt: skip
_BLOCK = 2**20
_LINES = 2**16  # bytes of scan lines at most that are repeated up to 3,000 times
_BLOCKS = (1, 30, 400, 3000)  # of a MiB of zeros each, in a stream that unpacks to them

Chunks = list[tuple[bytes, bytes]]


def png(chunks: Chunks, right_sums: bool = True) -> bytes:
    """A PNG file of ``chunks``: name and content of each."""
    parts = [_SIGNATURE]
    for name, content in chunks:
        crc = zlib.crc32(name + content) if right_sums else 0
        parts += [struct.pack(">I", len(content) % 2**32), name, content, struct.pack(">I", crc)]
    return b"".join(parts)


@cache
def png_samples() -> list[bytes]:
    """A picture of every kind of colour and depth, and a few with transparency, gamma or an orientation."""
    found = [_chunks(colour, depth) for colour, depths in _COLOURS.items() for depth in depths]
    extra: Chunks = [(b"gAMA", struct.pack(">I", 45455)), (b"tEXt", b"Comment\0sample"), (b"pHYs", bytes(9))]
    found.append([found[3][0], *extra, *found[3][1:]])
    found.append([found[3][0], (b"tRNS", b"\0\x40"), *found[3][1:]])
    found.append(
        [found[3][0], (b"eXIf", b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"), *found[3][1:]]
    )
    return [png(chunks) for chunks in found]


def _chunks(colour: int, depth: int) -> Chunks:
    row_bytes = (_SIDE * _CHANNELS[colour] * depth + 7) // 8
    rows = b"".join(b"\0" + bytes((17 * (x + y)) % 256 for x in range(row_bytes)) for y in range(_SIDE))
    head = struct.pack(f">{_HEADER}", _SIDE, _SIDE, depth, colour, 0, 0, 0)
    palette = [(b"PLTE", bytes((5 * k) % 256 for k in range(3 * min(2**depth, 256))))] if colour == 3 else []
    return [(b"IHDR", head), *palette, (b"IDAT", zlib.compress(rows, 0)), (b"IEND", b"")]


def changed_png(chance: Chance) -> bytes:
    """One of the pictures with a few chunks changed."""
    content = chance.pick(png_samples())
    if chance.share(0.1):
        return damaged(chance, content, png_samples())
    chunks = split_chunks(content)
    for _ in range(chance.few(3)):
        chunks = chance.apply(_CHANGES, chunks)
    return png(chunks, right_sums=not chance.share(0.05))


def split_chunks(content: bytes) -> Chunks:
    """Name and content of each chunk."""
    chunks, at = [], len(_SIGNATURE)
    while at + 8 <= len(content):
        size = int.from_bytes(content[at : at + 4], "big")
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + size]))
        at += 12 + size
    return chunks


def _header(chance: Chance, chunks: Chunks) -> Chunks:
    """Another size, depth or colour."""
    at = next((k for k, (name, _) in enumerate(chunks) if name == b"IHDR"), None)
    if at is None:
        return chunks
    head, field = bytearray(chunks[at][1].ljust(13, b"\0")), chance.below(7)
    offset = struct.calcsize(f">{_HEADER[:field]}")
    code = _HEADER[field]
    near = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 32, 64, 1000, 8192, 20_000, 100_000)
    value = chance.pick(near) if chance.share(0.7) else chance.pick(INTEGERS)
    head[offset : offset + struct.calcsize(f">{code}")] = packed(code, value, ">")
    return [*chunks[:at], (b"IHDR", bytes(head)), *chunks[at + 1 :]]


def _pixels(chance: Chance, chunks: Chunks) -> Chunks:
    """Other bytes in the scan lines, packed again; or a stream that unpacks to gigabytes."""
    kind = chance.below(6)
    content = b"".join(data for name, data in chunks if name == b"IDAT")
    try:
        rows = zlib.decompressobj().decompress(content, _BLOCK)  # an earlier change may have put gigabytes there
    except zlib.error:
        rows = content
    if kind < 3:
        content = zlib.compress(damaged(chance, rows), 0)
    elif kind == 3:
        content = deflated_zeros(chance.pick(_BLOCKS))
    elif kind == 4:
        content = damaged(chance, content)
    else:
        content = zlib.compress(rows[:_LINES] * chance.below(3000), 1)
    rest = [each for each in chunks if each[0] != b"IDAT"]
    at = max(len(rest) - 1, 0)
    return [*rest[:at], (b"IDAT", content), *rest[at:]]


@cache
def deflated_zeros(mebibytes: int) -> bytes:
    """A zlib stream of zeros, a thousandth of their size; its check sum is that of one MiB."""
    packer = zlib.compressobj(9)
    head = packer.compress(bytes(_BLOCK)) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(bytes(_BLOCK)) + packer.flush(zlib.Z_FULL_FLUSH)
    return head + again * (mebibytes - 1) + packer.flush(zlib.Z_FINISH)


def _added(chance: Chance, chunks: Chunks) -> Chunks:
    """One chunk more, known or not, with content of its kind or noise."""
    name = chance.pick(_NAMES)
    kind = chance.below(5)
    if kind == 0:
        content = chance.bytes(chance.below(40))
    elif kind == 1:
        content = b"x\0" + b"y" * chance.pick((10, 10_000, 3_000_000))
    elif kind == 2:
        content = b"Comment\0\0" + deflated_zeros(chance.pick(_BLOCKS))
    elif kind == 3:
        content = struct.pack(">II", chance.pick((0, 1, 2, 1000)), chance.below(3)).ljust(26, b"\0")
    else:
        content = b"".join(data for other, data in chunks if other == b"IHDR")
    at = chance.below(len(chunks) + 1)
    return [
        *chunks[:at],
        *[(name, content)] * (1 if chance.share(0.8) else 2000 if len(content) < 99 else 3),
        *chunks[at:],
    ]


def _moved(chance: Chance, chunks: Chunks) -> Chunks:
    if not chunks:
        return chunks
    rest, at = list(chunks), chance.below(len(chunks))
    taken = rest.pop(at)
    return rest if chance.share(0.4) else [*rest[: (to := chance.below(len(rest) + 1))], taken, *rest[to:]]


def _damaged_chunk(chance: Chance, chunks: Chunks) -> Chunks:
    if not chunks:
        return chunks
    at = chance.below(len(chunks))
    name, content = chunks[at]
    return [*chunks[:at], (name, damaged(chance, content)), *chunks[at + 1 :]]


_CHANGES = (_header, _header, _pixels, _added, _added, _moved, _damaged_chunk)
