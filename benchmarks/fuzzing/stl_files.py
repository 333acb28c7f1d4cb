"""STL files, binary and text: vertices far away or no numbers, triangles repeated, counts that are not those."""

import re
import struct
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from fuzzing.chance import Chance
from fuzzing.extremes import FLOATS, INTEGERS, NO_NUMBERS, WORDS, packed
from fuzzing.kind import Files, Kind
from fuzzing.noise import damaged

_FILE = "lens.stl"
_HEADER, _TRIANGLE = 84, 50
_RAYS = 64
_NUMBER = re.compile(rb"-?\d+\.\d*(?:[eE][-+]?\d+)?")


@cache
def _stl() -> bytes:
    """A sphere of 5 mm in 360 triangles, binary."""
    rows = [
        [
            (5.0 * np.sin(t) * np.cos(p), 5.0 * np.sin(t) * np.sin(p), 5.0 * np.cos(t))
            for p in np.linspace(0.0, 2.0 * np.pi, 21)[:-1]
        ]
        for t in np.linspace(0.0, np.pi, 11)
    ]
    rows = [[tuple(round(float(x), 4) for x in point) for point in row] for row in rows]
    triangles = []
    for upper, lower in pairwise(rows):
        for k in range(20):
            a, b, c, d = upper[k], upper[(k + 1) % 20], lower[k], lower[(k + 1) % 20]
            triangles += [t for t in ((a, c, d), (a, d, b)) if len(set(t)) == 3]
    body = b"".join(struct.pack("<12fH", 0.0, 0.0, 1.0, *(x for point in t for x in point), 0) for t in triangles)
    return b"sphere".ljust(80) + struct.pack("<I", len(triangles)) + body


@cache
def _text_stl() -> bytes:
    content, lines = _stl(), ["solid sphere"]
    for k in range(0, len(content) - _HEADER, _TRIANGLE):
        values = struct.unpack_from("<12f", content, _HEADER + k)
        vertices = (values[3 * j : 3 * j + 3] for j in range(1, 4))
        lines += [
            "facet normal 0 0 1",
            "outer loop",
            *("vertex {:.5g} {:.5g} {:.5g}".format(*v) for v in vertices),
            "endloop",
            "endfacet",
        ]
    return "\n".join([*lines, "endsolid sphere\n"]).encode()


def _changed_stl(chance: Chance) -> bytes:
    """Vertices far away, no numbers, flipped bytes, triangles repeated or turned, other counts; binary or text."""
    if chance.share(0.2):
        text = _text_stl()
        for _ in range(chance.few(20)):
            text = _other_number(chance, text, chance.pick(WORDS).encode("utf-8", "replace"))
        return damaged(chance, text) if chance.share(0.3) else text
    data = bytearray(_stl())
    for _ in range(chance.few(3)):
        kind, count = chance.below(8), (len(data) - _HEADER) // _TRIANGLE
        at = _HEADER + _TRIANGLE * chance.below(max(count, 1))
        if kind < 3:
            for _ in range(chance.pick((1, 1, 3, 100))):
                at = _HEADER + _TRIANGLE * chance.below(max(count, 1)) + 12 + 4 * chance.below(9)
                data[at : at + 4] = packed("f", chance.pick((*FLOATS, *NO_NUMBERS)))
        elif kind == 3:
            for _ in range(chance.pick((10, 2000))):
                data[_HEADER + chance.below(len(data) - _HEADER)] = chance.below(256)
        elif kind == 4:
            data += bytes(data[at : at + _TRIANGLE]) * chance.pick((1, 500, 20_000))
        elif kind == 5:
            del data[at : at + _TRIANGLE * chance.below(50)]
        elif kind == 6:
            factor = np.float32(chance.pick((1e-30, 1e-6, 1e3, 1e6, 1e30, -1.0, 0.0)))
            body = (
                np.frombuffer(bytes(data[_HEADER : _HEADER + _TRIANGLE * count]), np.uint8)
                .reshape(count, _TRIANGLE)
                .copy()
            )
            with np.errstate(over="ignore"):
                body[:, 12:48] = (np.ascontiguousarray(body[:, 12:48]).view("<f4") * factor).view(np.uint8)
            data[_HEADER:] = body.tobytes()
        else:
            data[:] = damaged(chance, bytes(data))
            return bytes(data)
    if chance.share(0.9):
        data[80:84] = struct.pack("<I", (len(data) - _HEADER) // _TRIANGLE)
    else:
        data[80:84] = packed("I", chance.pick(INTEGERS))
    return bytes(data)


def _read_stl(folder: Path) -> object:
    """Merge the triangles, fit normals to them, and cast rays at them, as the verification does."""
    from lensforge.cad.mesh_files import parse_stl
    from lensforge.proof.facet_casting import Grid, Leg
    from lensforge.proof.part_mesh import read_part_mesh

    content = (folder / _FILE).read_bytes()
    parse_stl(content)
    part = read_part_mesh(content)
    angles = np.linspace(0.0, 6.0, _RAYS)
    directions = np.stack([0.6 * np.cos(angles), 0.6 * np.sin(angles), np.full(_RAYS, 0.8)], axis=1)
    Grid(part.mesh).first_hits(Leg(np.zeros((_RAYS, 3)), directions, np.zeros(_RAYS)))
    return part.open_edges


def _other_number(chance: Chance, text: bytes, word: bytes) -> bytes:
    found = _NUMBER.search(text, chance.below(len(text)))
    return text if found is None else text[: found.start()] + word + text[found.end() :]


def _make(chance: Chance) -> Files:
    return {_FILE: _changed_stl(chance)}


KINDS = [Kind("stl", _make, _read_stl, lambda: [{_FILE: _stl()}, {_FILE: _text_stl()}], 2.0, foreign=True)]
