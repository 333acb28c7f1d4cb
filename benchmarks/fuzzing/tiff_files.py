"""TIFF files of both byte orders, tag by tag: sizes, depths, kinds of number, strips, loops of directories."""

import struct
from dataclasses import dataclass, replace
from functools import cache

from fuzzing.chance import Chance
from fuzzing.extremes import INTEGERS
from fuzzing.noise import damaged

_SIDE = 8
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 16: 8}
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _OFFSETS = 256, 257, 258, 259, 262, 273
_SAMPLES, _ROWS, _COUNTS, _FORMAT = 277, 278, 279, 339
_TAGS = (
    254, 255, 256, 257, 258, 259, 262, 266, 270, 273, 274, 277, 278, 279, 282, 283, 284, 290, 296, 301, 305, 306,
    317, 320,
    322, 323, 324, 325, 330, 332, 338, 339, 340, 341, 347, 529, 530, 531, 532, 700, 33432, 34377, 34665, 34675,
    37724, 50838,
)  # fmt: skip
_VALUES = (0, 1, 2, 3, 4, 5, 6, 7, 8, 16, 24, 32, 64, 5, 7, 8, 32773, 32946, 34712, 50000, 1000, 8192, 20_000, 100_000)

Tag = tuple[int, tuple[int, ...]]  # type, values


@dataclass(frozen=True)
class Tiff:
    """Byte order, the tags of one directory, the strip of pixels, and the offset of the next directory."""

    order: str
    tags: dict[int, Tag]
    strip: bytes
    following: int = 0

    @property
    def readable(self) -> bool:
        """False for double precision, and for 32 bits in the order that Pillow does not know."""
        bits, layout = self.tags[_BITS][1][0], self.tags[_FORMAT][1][0]
        return bits < 32 or (bits == 32 and (layout == 3 or self.order == "<"))

    def content(self) -> bytes:
        """The file: header, strip, long values, directory."""
        body = bytearray(struct.pack(f"{self.order}2sHI", b"II" if self.order == "<" else b"MM", 42, 0))
        start = len(body)
        body += self.strip
        entries = []
        for tag, (kind, values) in sorted(self.tags.items()):
            values = (start,) if tag == _OFFSETS and values == (-1,) else values
            field = b"".join(self._number(kind, value) for value in values)
            if len(field) > 4:
                body += bytes(len(body) % 2)
                field, at = struct.pack(f"{self.order}I", len(body)), field
                body += at
            entries.append(struct.pack(f"{self.order}HHI", tag, kind, len(values)) + field.ljust(4, b"\0"))
        body += bytes(len(body) % 2)
        body[4:8] = struct.pack(f"{self.order}I", len(body))
        body += struct.pack(f"{self.order}H", len(entries)) + b"".join(entries)
        return bytes(body) + struct.pack(f"{self.order}I", self.following % 2**32)

    def _number(self, kind: int, value: int) -> bytes:
        size = _SIZES.get(kind, 1)
        return (int(value) % 256**size).to_bytes(size, "little" if self.order == "<" else "big")


@cache
def tiff_samples() -> list[Tiff]:
    """Grey of 1, 8, 16 and 32 bits, floats, colours, and both byte orders."""
    found = []
    for order in "<>":
        for bits, layout, samples in (
            (1, 1, 1),
            (8, 1, 1),
            (16, 1, 1),
            (32, 1, 1),
            (32, 3, 1),
            (64, 3, 1),
            (8, 1, 3),
            (16, 1, 3),
            (8, 1, 4),
        ):
            if layout == 3:
                strip = b"".join(struct.pack(f"{order}{'f' if bits == 32 else 'd'}", k / 64.0) for k in range(64))
            else:
                strip = bytes((7 * k) % 256 for k in range((_SIDE * samples * bits + 7) // 8 * _SIDE))
            tags: dict[int, Tag] = {
                _WIDTH: (3, (_SIDE,)), _HEIGHT: (3, (_SIDE,)), _BITS: (3, (bits,) * samples), _COMPRESSION: (3, (1,)),
                _PHOTOMETRIC: (3, (2 if samples >= 3 else 1,)), _OFFSETS: (4, (-1,)), _SAMPLES: (3, (samples,)),
                _ROWS: (3, (_SIDE,)), _COUNTS: (4, (len(strip),)), _FORMAT: (3, (layout,) * samples),
            }  # fmt: skip
            if samples == 4:
                tags[338] = (3, (2,))
            found.append(Tiff(order, tags, strip))
    return found


def changed_tiff(chance: Chance) -> bytes:
    """One of the pictures with a few tags changed, added or left out."""
    tiff = chance.pick(tiff_samples())
    if chance.share(0.15):
        return damaged(chance, tiff.content(), [other.content() for other in tiff_samples()[:4]])
    tags = dict(tiff.tags)
    for _ in range(chance.few(3)):
        _change(chance, tags)
    tiff = replace(tiff, tags=tags)
    if chance.share(0.1):
        tiff = replace(tiff, strip=damaged(chance, tiff.strip))
    if chance.share(0.1):  # another directory: this one again, none, or beyond the end
        size = len(tiff.content())
        tiff = replace(tiff, following=chance.pick((8, size - 6 - 12 * len(tags), size, 2**32 - 1, 1)))
    return tiff.content()


def _change(chance: Chance, tags: dict[int, Tag]) -> None:
    kind = chance.below(6)
    if not tags or kind == 5:
        tags[chance.pick(_TAGS)] = (chance.pick(list(_SIZES)), (chance.pick(_VALUES),))
        return
    tag = chance.pick(sorted(tags))
    number_kind, values = tags[tag]
    if kind == 0:
        del tags[tag]
    elif kind == 1:
        tags[tag] = (chance.pick((*_SIZES, 0, 13, 255)), values)
    elif kind == 2:
        tags[tag] = (number_kind, values * chance.pick((0, 2, 3, 1000)))
    elif kind == 3:
        tags[tag] = (number_kind, (chance.pick(INTEGERS), *values[1:]))
    else:
        tags[tag] = (number_kind, (chance.pick(_VALUES),) * len(values))
