"""Damaged files of every kind end in rays or in one line, never in anything else.

Run as a script for the long run: `python tests/sources/test_rayfiles_fuzz.py 100000`.
"""

import json
import struct
import sys
import warnings

import numpy as np
from rayfile_samples import CASES, SHARED, encoded, image, with_spectrum_numbers

from lensforge.errors import InputError
from lensforge.sources.rayfiles import FORMATS, describe
from lensforge.sources.rayfiles.ray_file import usable_rays
from lensforge.sources.rayfiles.ray_file_io import decode
from lensforge.sources.rayfiles.stored_rays import wavelengths_of

SPECIAL_WORDS = [
    struct.pack("<i", value) for value in (0, 1, 2, 3, 7, -1, 2**31 - 1, -(2**31), 2013, 1010, 0x7F800001)
] + [struct.pack("<f", value) for value in (2.0, 1e38, -1e38, 1e-38, float("nan"), float("inf"))]
SPECIAL_TEXT = [
    b"nan",
    b"inf",
    b"-1e308",
    b"1e308",
    b"1e-320",
    b"\n",
    b",",
    b" ",
    b"#",
    b"0",
    b"9" * 40,
    b"\0",
    b"\xff",
]
SMALL = 2000  # bytes
HEADER_BYTES = 300  # where most fields are: mutated more often than the rest


def seeds():
    """One file of each conformance case, and the small real ones where they are."""
    ours = [encoded(name, case) for name, cases in CASES.items() for case in cases]
    small = [path for path in sorted(SHARED.glob("*/*")) if path.parent.name in ("tiny", "pairs")]
    real = [path.read_bytes() for path in small if path.stat().st_size < SMALL]
    return [*ours, with_spectrum_numbers([1, 2, 1]), *real]


def mutate(content, random):
    data = bytearray(content)
    for _ in range(int(random.integers(1, 6))):
        reach = min(len(data), HEADER_BYTES) if random.random() < 0.6 else len(data)
        at = int(random.integers(0, max(reach, 1)))
        kind = int(random.integers(0, 7))
        if kind == 0:
            data[at : at + 1] = random.bytes(1)
        elif kind == 1:
            at -= at % 4
            data[at : at + 4] = SPECIAL_WORDS[random.integers(len(SPECIAL_WORDS))]
        elif kind == 2:
            data[at : at + 1] = SPECIAL_TEXT[random.integers(len(SPECIAL_TEXT))]
        elif kind == 3:
            del data[at:]
        elif kind == 4:
            data[at:at] = random.bytes(int(random.integers(1, 64)))
        elif kind == 5:
            del data[at : at + int(random.integers(1, 64))]
        else:
            at -= at % 4
            data[at : at + 4] = data[at : at + 4][::-1]
    return bytes(data)


def _not_json(constant):
    raise AssertionError(f"{constant} in a summary")


def survive(content, random):
    """Whether ``content`` is read; anything but rays or one line is a failure of the test."""
    try:
        rayfile = decode(image(content))
        json.loads(describe(rayfile).model_dump_json(), parse_constant=_not_json)
        wavelengths_of(rayfile, usable_rays(rayfile))
        encoded(list(FORMATS)[random.integers(len(FORMATS))], rayfile)
    except InputError as error:
        line = str(error)
    else:
        return True
    assert line.isprintable()  # so it is one line
    assert len(line) < 600
    return False


def fuzz(cases, seed):
    """How many of ``cases`` mutated files were read as rays."""
    random = np.random.default_rng(seed)
    originals = seeds()
    read = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for case in range(cases):
            original = originals[case % len(originals)]
            content = mutate(original, random) if random.random() < 0.97 else random.bytes(len(original) % 4096)
            try:
                read += survive(content, random)
            except Exception as error:
                raise AssertionError(f"seed {seed}, case {case}: {type(error).__name__}: {error}") from error
    return read


def test_mutated_files_end_in_rays_or_in_one_line():
    read = fuzz(1500, seed=7)
    assert 50 < read < 1450  # both ends are reached


if __name__ == "__main__":
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 11
    print(f"{count} mutated files, seed {seed}: {fuzz(count, seed)} read as rays, the others refused in one line")
