"""SPEOS text ray files: a line with the number of rays, then `i x y z l m n wavelength energy`. Experimental.

The layout is known from a description and from no sample file. Rows may have five more numbers, which are not used.
There is no header with a power: energies are taken as W, with a warning.
"""

from collections.abc import Iterator

import numpy as np

from lensforge.sources.rayfiles.ray_file import HEAD_BYTES, Format, RayFile
from lensforge.sources.rayfiles.ray_file_bytes import FileImage
from lensforge.sources.rayfiles.ray_file_text import cut_warnings, numbers, opening_lines, parse_rows, print_rows
from lensforge.sources.rayfiles.speos import require_watts_and_wavelengths

_WIDTHS = (9, 14)


def _matches(head: bytes, size: int) -> bool:
    lines = opening_lines(head)
    if lines is None:
        return False
    count, ray = numbers(lines[0]), numbers(lines[1])
    return (
        count is not None
        and len(count) == 1
        and count[0].is_integer()
        and count[0] >= 1.0
        and ray is not None
        and len(ray) in _WIDTHS
    )


def _decode(image: FileImage) -> RayFile:
    first, _, _ = image.part(0, HEAD_BYTES).partition(b"\n")
    count = (numbers(first.decode("latin-1")) or [0.0])[0]
    rows = parse_rows(image, len(first) + 1, image.size, first_line=2)
    if rows.shape[1] not in _WIDTHS:
        raise image.refuse(f"line 2: {rows.shape[1]} numbers; {_WIDTHS[0]} or {_WIDTHS[1]}")
    if len(rows) != count:
        fault = "truncated" if len(rows) < count else "more than that"
        raise image.refuse(f"line 1 promises {count:.15g} rays, the file holds {len(rows)} ({fault}); fetch it again")
    unused = ("columns 10 to 14 are not used here, and lost when converted",) if rows.shape[1] > _WIDTHS[0] else ()
    return RayFile(
        positions_mm=rows[:, 1:4],
        directions=rows[:, 4:7],
        flux=rows[:, 8],
        flux_unit="W",
        wavelengths_nm=rows[:, 7],
        format=FORMAT.name,
        header={"unused_columns": ["10 to 14"]} if unused else {},
        warnings=(
            "SPEOS text is experimental: lengths are taken as mm and energies as W, check both",
            *unused,
            *cut_warnings(image),
        ),
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    require_watts_and_wavelengths(rayfile)
    yield f"{len(rayfile)}\n".encode("ascii")
    number = 1
    for block in rayfile.absolute_blocks():
        numbered = np.arange(number, number + len(block), dtype=np.float64)
        yield print_rows(numbered, block.positions_mm, block.directions, block.wavelengths_nm, block.flux)
        number += len(block)


FORMAT = Format("speos_text", "SPEOS text (experimental)", (".txt",), _matches, _decode, _encode)
