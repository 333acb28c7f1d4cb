"""Reading of an image file of any origin: recognised by its first bytes, bounded, decoded, and turned upright.

Chunks of PNG (W3C, Portable Network Graphics, third edition) and tags of TIFF and EXIF are checked before any decoder
sees them, each with its bound.
"""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped, UInt

from lensforge.errors import InputError
from lensforge.optics.image import Luminance, Picture, not_srgb
from lensforge.optics.image_decoding import Pixels, decoded
from lensforge.results.files import MIB, read_file

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


BITS, PHOTOMETRIC, SAMPLES, PLANAR, EXTRA_SAMPLES, SAMPLE_FORMAT = 258, 262, 277, 284, 338, 339
_SUBFILE, _ORIENTATION = 254, 274
_STRIPS = (273, 279, 324, 325)  # offsets and byte counts of strips and tiles
_MOST_STRIPS = 2**17  # tiles of 32 x 32 in the largest picture are half as many; each costs some 20 microseconds
_MOST_PAGES = 16  # smaller copies of the picture behind it
_REDUCED = 1  # the subfile type of a smaller copy
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_NUMBERS = {1: "B", 3: "H", 4: "I"}


@dataclass(frozen=True)
class Tag:
    """The place of a tag's values in the file: their type, how many they are, and where they begin."""

    kind: int
    count: int
    start: int

    @property
    def size(self) -> int:
        """Bytes of all values; 0 for a type that no version of TIFF has."""
        return _SIZES.get(self.kind, 0) * self.count


@dataclass(frozen=True)
class Directory:
    """The tags of one picture of ``content``, and where the next picture's begin, 0 for none."""

    content: bytes
    order: str
    tags: dict[int, Tag]
    following: int

    def number(self, code: int, default: int) -> int:
        """First whole number of a tag, ``default`` where it is not there. Raises :class:`ValueError` out of bounds."""
        tag = self.tags.get(code)
        if tag is None or tag.count == 0 or tag.kind not in _NUMBERS:
            return default
        try:
            return int(struct.unpack_from(self.order + _NUMBERS[tag.kind], self.content, tag.start)[0])
        except struct.error:
            raise ValueError(f"tag {code} lies outside the file") from None

    @property
    def orientation(self) -> int:
        """EXIF orientation, 1 to 8; a number that the standard does not have counts as 1."""
        found = self.number(_ORIENTATION, 1)
        return found if 1 <= found <= 8 else 1


def exif_orientation(block: bytes) -> int:
    """Orientation by an EXIF block. Raises :class:`ValueError` for one that is damaged."""
    return _first_directory(block.removeprefix(b"Exif\0\0")).orientation


def tiff_directory(content: bytes) -> Directory:
    """Tags of the only picture of a TIFF file.

    Raises :class:`ValueError` where there are several pictures or so many strips, or tags so large, that reading them
    would take the machine.
    """
    found = _first_directory(content)
    outside = [code for code, tag in found.tags.items() if tag.start + tag.size > len(content)]
    if outside:
        raise ValueError(f"truncated: tag {outside[0]} lies outside the file")
    if sum(tag.size for tag in found.tags.values()) > len(content):
        raise ValueError("its tags together are larger than the file")
    strips = max((found.tags[code].count for code in _STRIPS if code in found.tags), default=0)
    if strips > _MOST_STRIPS:
        raise ValueError(f"{strips} strips or tiles, at most {_MOST_STRIPS}")
    following, seen = found.following, 0
    while following:
        page, seen = _directory(content, found.order, following), seen + 1
        if page.number(_SUBFILE, 0) != _REDUCED or seen > _MOST_PAGES:
            raise ValueError("it holds several pictures, must be one")
        following = page.following
    return found


def upright(directory: Directory) -> bytes:
    """The file with orientation 1, so that no decoder turns the picture by itself."""
    tag = directory.tags.get(_ORIENTATION)
    if tag is None or directory.orientation == 1:
        return directory.content
    changed = bytearray(directory.content)
    struct.pack_into(directory.order + _NUMBERS[tag.kind], changed, tag.start, 1)
    return bytes(changed)


def _first_directory(content: bytes) -> Directory:
    order = {b"II": "<", b"MM": ">"}.get(content[:2])
    if order is None or len(content) < 8 or struct.unpack_from(order + "H", content, 2)[0] != 42:
        raise ValueError("neither a TIFF file nor an EXIF block begins like this")
    return _directory(content, order, struct.unpack_from(order + "I", content, 4)[0])


def _directory(content: bytes, order: str, start: int) -> Directory:
    try:
        (count,) = struct.unpack_from(order + "H", content, start)
        entries = [struct.unpack_from(order + "HHI", content, start + 2 + 12 * i) for i in range(count)]
        end = start + 2 + 12 * count
        following = struct.unpack_from(order + "I", content, end)[0] if end + 4 <= len(content) else 0
        tags = {}
        for i, (code, kind, number) in enumerate(entries):
            inline = start + 2 + 12 * i + 8
            large = Tag(kind, number, 0).size > 4
            tags[code] = Tag(kind, number, struct.unpack_from(order + "I", content, inline)[0] if large else inline)
    except struct.error:
        raise ValueError("truncated: its tags lie outside the file") from None
    return Directory(content, order, tags, following)


MOST_BYTES = 512 * MIB  # the largest picture, three colours of 16 bits, has 384 MiB where nothing is compressed
_MOST_SCANS = 6 * 10**8  # times pixels: each scan of a progressive JPEG is a pass over all; 10 of 60 million are usual
_SCAN = b"\xff\xda"  # inside a scan, 0xff is followed by 0
_UNCOMPRESSED_BMP = (0, 3, 6)  # plain, and plain with masks
_SIGNED, _FLOATING, _WHITE_IS_ZERO, _SEPARATE, _ASSOCIATED = 2, 3, 0, 2, 1  # values of TIFF's tags


def read_light(path: Path | str, luminance: Luminance, *, missing: str) -> Float[np.ndarray, "h w"]:
    """Relative light that the picture ``path`` stands for, row 0 at the top, 1 at its full scale.

    Raises :class:`InputError` as :func:`read_picture` does, and where values to be decoded as sRGB are not.
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
    read = next((each for begin, each in _READERS.items() if content.startswith(begin)), None)
    if read is None:
        raise InputError(f"{path}: not a readable image, must be PNG, TIFF, JPEG or BMP; convert it")
    try:
        picture = read(content)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if picture.values.dtype.kind == "f" and not (np.isfinite(picture.values).all() and picture.values.min() >= 0.0):
        raise InputError(f"{path}: pixels must be finite, and none below 0")
    return _upright(picture if orientation is None else replace(picture, orientation=orientation))


def _png(content: bytes) -> Picture:
    chunks = png_chunks(content)
    pixels = decoded("PNG", chunks.pixels_only)
    samples = pixels.samples.astype(np.uint16) if chunks.depth == 16 else pixels.samples
    orientation = _orientation(chunks.exif) if chunks.exif else 1
    reason = chunks.not_srgb or _reason(chunks.profile)
    opacity = _png_opacity(chunks, pixels, samples) if b"tRNS" in chunks.others else pixels.opacity
    return _picture(samples, opacity, not_srgb=reason, orientation=orientation)


def _png_opacity(chunks: PngChunks, pixels: Pixels, samples: UInt[np.ndarray, "h w c"]) -> UInt[np.ndarray, "h w"]:
    """Opacity by the tRNS chunk: of each colour of the palette, or 0 for the one colour that it names."""
    stated = chunks.others[b"tRNS"]
    if pixels.indices is not None:
        table = np.full(256, 255, dtype=np.uint8)
        table[: len(stated)] = np.frombuffer(stated[:256], dtype=np.uint8)
        opacity: UInt[np.ndarray, "h w"] = table[pixels.indices]
        return opacity
    if pixels.opacity is not None or len(stated) != 2 * samples.shape[2]:
        raise ValueError("damaged: a transparency of another kind of picture")
    most = 2**chunks.depth - 1
    named = np.frombuffer(stated, dtype=">u2").astype(np.int64) & most
    clear = (samples == named * (int(np.iinfo(samples.dtype).max) // most)).all(axis=2)
    return np.where(clear, 0, 255).astype(np.uint8)


def _tiff(content: bytes) -> Picture:
    tags = tiff_directory(content)
    bits, layout = tags.number(BITS, 1), tags.number(SAMPLE_FORMAT, 1)
    if layout == _SIGNED:
        raise ValueError("its values are signed numbers, must be unsigned or floating-point; convert it")
    if bits > 8 and tags.number(PLANAR, 1) == _SEPARATE and tags.number(SAMPLES, 1) > 1:
        raise ValueError("its colours of more than 8 bits are in separate planes; save them interleaved")
    pixels = decoded("TIFF", upright(tags))
    samples = pixels.samples.view(np.uint32) if pixels.samples.dtype == np.int32 else pixels.samples
    full_scale = float(2**bits - 1) if bits > 8 and samples.dtype.kind == "u" else None
    if bits > 8 and tags.number(PHOTOMETRIC, 1) == _WHITE_IS_ZERO:
        if full_scale is None:
            raise ValueError("its floating-point values say that white is 0; invert it")
        samples = samples.dtype.type(full_scale) - samples
    reason = _reason(lambda: pixels.profile)
    if full_scale is None and samples.dtype.kind == "f":
        reason = "floating-point values are linear by convention"
    associated = pixels.opacity is not None and tags.number(EXTRA_SAMPLES, 0) == _ASSOCIATED
    found = _picture(samples, pixels.opacity, not_srgb=reason, orientation=tags.orientation)
    return replace(
        found, premultiplied=associated and found.opacity is not None, full_scale=full_scale or found.full_scale
    )


def _jpeg(content: bytes) -> Picture:
    pixels = decoded("JPEG", content, most_pixels=_MOST_SCANS // max(1, content.count(_SCAN)))
    orientation = _orientation(pixels.exif) if pixels.exif else 1
    return _picture(pixels.samples, None, not_srgb=_reason(lambda: pixels.profile), orientation=orientation)


def _bmp(content: bytes) -> Picture:
    if (
        int.from_bytes(content[14:18], "little") >= 40
        and int.from_bytes(content[30:34], "little") not in _UNCOMPRESSED_BMP
    ):
        raise ValueError("a compressed BMP file; save it as PNG")
    pixels = decoded("BMP", content)
    return _picture(pixels.samples, pixels.opacity)


_READERS: dict[bytes, Callable[[bytes], Picture]] = {
    SIGNATURE: _png,
    b"II*\0": _tiff,
    b"MM\0*": _tiff,
    b"\xff\xd8\xff": _jpeg,
    b"BM": _bmp,
}


def _picture(
    samples: Shaped[np.ndarray, "h w c"],
    opacity: UInt[np.ndarray, "h w"] | None,
    *,
    not_srgb: str = "",
    orientation: int = 1,
) -> Picture:
    if opacity is not None and (opacity == np.iinfo(opacity.dtype).max).all():
        opacity = None
    full_scale = 1.0 if samples.dtype.kind == "f" else float(np.iinfo(samples.dtype).max)
    return Picture(samples, full_scale, opacity, not_srgb=not_srgb, orientation=orientation)


def _orientation(exif: bytes) -> int:
    try:
        return exif_orientation(exif)
    except ValueError:
        raise ValueError("its EXIF block is damaged, so that its orientation is not known; save it again") from None


def _reason(profile: Callable[[], bytes]) -> str:
    """Say why the values are not those of sRGB by the colour profile; it counts only where they are to be decoded."""
    try:
        found = profile()
        return not_srgb(found) if found else ""
    except ValueError as error:
        return str(error)


def _upright(picture: Picture) -> Picture:
    """The picture turned or mirrored as its orientation states (CIPA DC-008, tag 274)."""
    opacity = None if picture.opacity is None else _turned(picture.opacity, picture.orientation)
    return replace(picture, values=_turned(picture.values, picture.orientation), opacity=opacity)


def _turned(values: Shaped[np.ndarray, "h w *c"], orientation: int) -> Shaped[np.ndarray, "a b *c"]:
    if orientation >= 5:
        values = values.swapaxes(0, 1)
    flips_rows, flips_columns = orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)
    return values[:: -1 if flips_rows else 1, :: -1 if flips_columns else 1]
