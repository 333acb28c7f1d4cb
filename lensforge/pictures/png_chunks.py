"""Chunks of a PNG file: checked by their sums before any decoder sees them, and without what is no picture.

W3C, Portable Network Graphics, third edition.
"""

import struct
import zlib
from dataclasses import dataclass

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_KEPT = (b"IHDR", b"PLTE", b"IDAT", b"IEND")  # what the pixels need; text and profiles may be large and harm
_LAYOUT = struct.Struct(">IIBBBBB")
_MOST_CHUNKS = 2**17  # the largest picture in pieces of 8 KiB, as the common writers make, has half as many
_MOST_PROFILE_BYTES = 2**22  # of a colour profile when unpacked; the largest in use have about 3 MB
_SRGB_GAMMA = range(45000, 46001)  # 1/2.2 in units of 1e-5, which is what writers give for sRGB
_SRGB_CODES = b"\x01\x0d\x00"  # ITU-T H.273: primaries of BT.709, curve of sRGB, RGB


@dataclass(frozen=True)
class PngChunks:
    """The header, the transparency and the colour chunks of a PNG file, and the file of its pixels alone."""

    depth: int
    colour_type: int
    pixels_only: bytes
    others: dict[bytes, bytes]

    @property
    def exif(self) -> bytes:
        """The EXIF block, empty where there is none."""
        return self.others.get(b"eXIf", b"")

    @property
    def not_srgb(self) -> str:
        """Reason why the values are not those of sRGB, "" where they may be; a colour profile is another matter."""
        codes, gamma = self.others.get(b"cICP"), self.others.get(b"gAMA")
        if codes is not None:
            return "" if codes[:3] == _SRGB_CODES else "its cICP chunk states another encoding"
        if b"sRGB" in self.others or b"iCCP" in self.others or gamma is None:
            return ""
        stated = int.from_bytes(gamma[:4], "big")
        return "" if stated in _SRGB_GAMMA else f"its gAMA chunk states {stated / 1e5:g}"

    def profile(self) -> bytes:
        """The colour profile, unpacked, empty where there is none. Raises :class:`ValueError` for a damaged one."""
        chunk = b"" if b"cICP" in self.others else self.others.get(b"iCCP", b"")
        if not chunk:
            return b""
        packed = chunk[chunk.find(b"\0") + 2 :]
        try:
            unpacker = zlib.decompressobj()
            found = unpacker.decompress(packed, _MOST_PROFILE_BYTES)
        except zlib.error as error:
            raise ValueError(f"its colour profile is damaged ({error})") from None
        if not unpacker.eof:
            raise ValueError(f"its colour profile is truncated or larger than {_MOST_PROFILE_BYTES >> 20} MiB")
        return found


def png_chunks(content: bytes) -> PngChunks:
    """Check every chunk. Raises :class:`ValueError` for damage, for an animation, and for too many chunks."""
    pieces, position, seen = [SIGNATURE], len(SIGNATURE), 0
    others: dict[bytes, bytes] = {}
    header, kind = b"", b""
    while kind != b"IEND":
        kind, data, whole = _chunk(content, position)
        position, seen = position + len(whole), seen + 1
        if seen > _MOST_CHUNKS:
            raise ValueError(f"more than {_MOST_CHUNKS} chunks")
        if (seen == 1) != (kind == b"IHDR"):
            raise ValueError("damaged: its header is not where it must be")
        if kind in _KEPT:
            pieces.append(whole)
            header = data if kind == b"IHDR" else header
        elif kind == b"acTL" and int.from_bytes(data[:4], "big") > 1:
            raise ValueError("it holds several frames, must be one picture")
        elif kind[:1].isupper():
            raise ValueError(f"chunk {kind!r}, which PNG does not have")
        else:
            others.setdefault(kind, data)
    if len(header) != _LAYOUT.size:
        raise ValueError("damaged: a header of another size")
    _, _, depth, colour_type, *_ = _LAYOUT.unpack(header)
    return PngChunks(depth, colour_type, b"".join(pieces), others)


def _chunk(content: bytes, start: int) -> tuple[bytes, bytes, bytes]:
    """Kind, data and all bytes of the chunk at ``start``."""
    if start + 12 > len(content):
        raise ValueError("truncated")
    size = int.from_bytes(content[start : start + 4], "big")
    whole = content[start : start + 12 + size]
    if len(whole) < 12 + size:
        raise ValueError("truncated")
    if zlib.crc32(memoryview(whole)[4:-4]) != int.from_bytes(whole[-4:], "big"):
        raise ValueError("damaged: the checksum of a chunk is wrong")
    return whole[4:8], whole[8:-4], whole
