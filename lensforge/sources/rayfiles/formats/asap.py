"""ASAP binary ray files (`.dis`): five records of 28 bytes, then rows `x y z l m n flux` of float32. Experimental.

The layout is known from one public reader and from no sample file: word 0 of record 1 encodes the length of a record
(`(word - 247) / 1024` = 7 words), record 2 begins with a title of 24 characters, and the last word of record 4 is minus
the number of rays. The header names neither the unit of length nor that of flux; both are assumed, with a warning.
ASAP may want more in the records than the zeros written here: files written here are known to be read here only.
"""

import struct
from collections.abc import Iterator

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file import Format, RayFile, register
from lensforge.sources.rayfiles.ray_file_rows import FileImage, float_rows, plain_text

_HEADER = struct.Struct("<i24x24s4x28x24xi28x")
_WORDS = 7  # of a ray, and of each record of the header
_MARK = 1024 * _WORDS + 247


def _matches(head: bytes, size: int) -> bool:
    return head[:4] == _MARK.to_bytes(4, "little") and size > _HEADER.size


def _decode(image: FileImage) -> RayFile:
    _, title, minus_rays = image.unpack(_HEADER)
    rows = image.rows(_HEADER.size, -minus_rays, _WORDS)
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit="W",
        format=BINARY.name,
        header={"name": plain_text(title, "latin-1")},
        warnings=("ASAP is experimental: lengths are taken as mm and fluxes as W, check both",),
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    if rayfile.flux_unit != "W":
        raise InputError(f"{BINARY.title} files name no unit, and these rays are in lm; convert to tm25 instead")
    if len(rayfile) >= 2**31:
        raise InputError(f"{BINARY.title} files count to {2**31 - 1} rays, these are {len(rayfile)}; convert to tm25")
    title = str(rayfile.header.get("name") or rayfile.header.get("description") or "")
    yield _HEADER.pack(_MARK, title.encode("latin-1", "replace")[:24].ljust(24), -len(rayfile))
    for block in rayfile.absolute_blocks():
        yield float_rows(block.positions_mm, block.directions, block.flux)


BINARY = register(Format("asap", "ASAP binary (experimental)", (".dis",), _matches, _decode, _encode))
