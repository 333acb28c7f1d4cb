"""Damage to bytes that knows nothing of their meaning: transfers cut short, disks gone bad, files glued together."""

import struct
from collections.abc import Sequence

from fuzzing.chance import Chance

_WORDS = [struct.pack("<i", value) for value in (0, 1, 2, -1, 2**31 - 1, -(2**31), 2**24, 0x7F800001)]
_WORDS += [struct.pack("<f", value) for value in (1e38, -1e38, 1e-38, 1e-45, float("nan"), float("inf"))]
_WORDS += [struct.pack("<d", value) for value in (1e308, 1e-320, float("nan"))]
_HEAD = 300  # bytes in which most fields lie: damaged more often than the rest


def damaged(chance: Chance, content: bytes, others: Sequence[bytes] = ()) -> bytes:
    """``content`` with a few pieces of damage; ``others``: files whose pieces may be spliced in."""
    data = bytearray(content)
    for _ in range(chance.few()):
        reach = min(len(data), _HEAD) if chance.share(0.5) else len(data)
        at = chance.below(reach)
        kind = chance.below(9 if others else 8)
        if kind == 0 and data:
            data[at] ^= 1 << chance.below(8)
        elif kind == 1 and data:
            data[at] = chance.below(256)
        elif kind == 2:
            word, at = chance.pick(_WORDS), at - at % 4
            data[at : at + len(word)] = word
        elif kind == 3:
            del data[at:]
        elif kind == 4:
            data[at:at] = chance.bytes(1 + chance.below(40))
        elif kind == 5:
            del data[at : at + 1 + chance.below(64)]
        elif kind == 6:
            block = bytes(data[at : at + 1 + chance.below(200)])
            data[at:at] = block * (1 + chance.below(20))
        elif kind == 7:
            data[at : at + 4] = data[at : at + 4][::-1]
        elif kind == 8:
            other = chance.pick(others)
            data = bytearray(data[:at] + other[chance.below(len(other)) :])
    return bytes(data)
