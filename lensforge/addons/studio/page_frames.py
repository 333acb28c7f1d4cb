"""Frames for the page: a head of JSON with arrays behind it, in one run of bytes.

A length (uint32, little-endian), so many bytes of JSON, and the arrays as float32, each where the head says. The same
bytes go through the pipe of the search and to the page; ``page/frames.js`` reads them.
"""

import json
from collections.abc import Mapping, MutableMapping
from typing import Any

import numpy as np

Fields = MutableMapping[str, Any]  # of JSON


def packed(head: Mapping[str, object], arrays: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of a frame."""
    parts = list[bytes]()
    places = dict[str, object]()
    start = 0
    for name, array in arrays.items():
        content = np.ascontiguousarray(array, dtype="<f4").tobytes()
        places[name] = {"start": start, "shape": list(array.shape)}
        parts.append(content)
        start += len(content)
    text = json.dumps({**head, "arrays": places}, allow_nan=False, default=str).encode()
    text += b" " * (-len(text) % 4)  # arrays begin at multiples of their size
    return len(text).to_bytes(4, "little") + text + b"".join(parts)


def head_of(frame: bytes) -> Fields:
    """The head of a frame."""
    return dict(json.loads(frame[4 : 4 + int.from_bytes(frame[:4], "little")]))
