"""Tags of a TIFF file or an EXIF block, read before any decoder sees them, each with its bound."""

import struct
from dataclasses import dataclass

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
