"""Binary files of a header and rows of float32: fields by place and type, the count with and without its rows."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from fuzzing.chance import Chance
from fuzzing.extremes import FLOATS, INTEGERS, NAN_SIGNALLING, NO_NUMBERS, packed
from fuzzing.noise import damaged

_MOST_ROWS = 3000


@dataclass(frozen=True)
class Layout:
    """A header: ``fields`` by offset and ``struct`` code, which of them is the ``count``; rows end at ``tail``."""

    fields: tuple[tuple[int, str], ...]
    count: int | None
    row_bytes: int
    tail: int = 0

    @classmethod
    def of(cls, codes: str, count: int | None, row_bytes: int, tail: int = 0) -> "Layout":
        """The layout of a header of ``codes``, without alignment; bytes and padding are skipped."""
        fields, offset = [], 0
        for number, code in _parts(codes):
            if code not in "sx":
                fields += [(offset + k * struct.calcsize(f"<{code}"), code) for k in range(number)]
            offset += struct.calcsize(f"<{number}{code}")
        return cls(tuple(fields), count, row_bytes, tail)

    @property
    def header_bytes(self) -> int:
        """Bytes up to the end of the last field."""
        offset, code = self.fields[-1]
        return offset + struct.calcsize(f"<{code}")


def _parts(codes: str) -> list[tuple[int, str]]:
    parts, digits = [], ""
    for character in codes:
        if character.isdigit():
            digits += character
        else:
            parts.append((int(digits or 1), character))
            digits = ""
    return parts


def changed_fields(chance: Chance, samples: Sequence[bytes], layout: Layout) -> bytes:
    """One of the files with a few fields or numbers of its rows changed, or rows added or left out."""
    content = chance.pick(samples)
    if chance.share(0.2):
        return damaged(chance, content, samples)
    data = bytearray(content)
    for _ in range(chance.few()):
        kind = chance.below(10)
        if kind < 5:
            _set_field(chance, data, layout)
        elif kind < 8:
            _set_number(chance, data, layout)
        elif kind == 8:
            _resize(chance, data, layout)
        else:
            at = chance.below(len(data))
            data[at : at + 1] = chance.bytes(1)
    return bytes(data)


def _set_field(chance: Chance, data: bytearray, layout: Layout) -> None:
    offset, code = chance.pick(layout.fields)
    if layout.count is not None and chance.share(0.15):
        offset, code = layout.fields[layout.count]
    size = struct.calcsize(f"<{code}")
    if len(data) < offset + size:
        return
    if chance.share(0.3):
        (value,) = struct.unpack_from(f"<{code}", data, offset)
        value = value + (1 if chance.share(0.5) else -1) if abs(value) < 2**62 else 0
    else:
        value = chance.pick(INTEGERS if code not in "fd" or chance.share(0.3) else (*FLOATS, *NO_NUMBERS))
    data[offset : offset + size] = packed(code, value, ">" if chance.share(0.05) else "<")


def _set_number(chance: Chance, data: bytearray, layout: Layout) -> None:
    """Another float32 in a row, a whole row, or a whole column of rows."""
    words = max((len(data) - layout.tail - layout.header_bytes) // 4, 1)
    word = NAN_SIGNALLING if chance.share(0.05) else packed("f", chance.pick((*FLOATS, *NO_NUMBERS)))
    first = chance.below(words)
    step, count = chance.pick(((1, 1), (1, 1), (1, 8), (layout.row_bytes // 4, words)))
    start = len(data) - layout.tail - 4 * words
    for k in range(first % step if count == words else first, min(first + count * step, words), step):
        data[start + 4 * k : start + 4 * k + 4] = word


def _resize(chance: Chance, data: bytearray, layout: Layout) -> None:
    """Rows left out or repeated; with the count that says so, or without."""
    rows = max((len(data) - layout.tail - layout.header_bytes) // layout.row_bytes, 1)
    end = len(data) - layout.tail
    wanted = chance.pick((0, 1, 2, rows - 1, rows + 1, _MOST_ROWS))
    row = bytes(data[max(end - layout.row_bytes, 0) : end])
    if wanted < rows:
        del data[max(end - (rows - wanted) * layout.row_bytes, 0) : end]
    else:
        data[end:end] = row * (wanted - rows)
    if layout.count is not None and chance.share(0.7):
        offset, code = layout.fields[layout.count]
        if len(data) >= offset + struct.calcsize(f"<{code}"):
            (value,) = struct.unpack_from(f"<{code}", data, offset)
            size = struct.calcsize(f"<{code}")
            data[offset : offset + size] = packed(code, -wanted if value < 0 else wanted)
