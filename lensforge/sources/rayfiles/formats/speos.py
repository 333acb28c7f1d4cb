"""SPEOS ray files, binary (`.ray`) and text (`.txt`); both hold W and a wavelength for each ray.

- Binary: seven float32, then rows `x y z l m n wavelength energy`. The header has no magic word: total W, five times
  2.0, total lm. Energies are relative to each other; the power of a ray is its share of the header's W. The header has
  no count: a file cut between two rays looks whole.
- Text: a line with the number of rays, then `i x y z l m n wavelength energy`. Experimental: the layout is known from
  a description and from no sample file. Rows may have five more numbers, which are not used. There is no header with a
  power: energies are taken as W, with a warning.
"""

import struct
from collections.abc import Iterator

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file import Format, RayFile, register
from lensforge.sources.rayfiles.ray_file_rows import (
    FileImage,
    counted_rows,
    cut_warnings,
    float_rows,
    is_counted_text,
    known,
    print_rows,
)

_HEADER = struct.Struct("<7f")
_MARK = struct.pack("<5f", *(2.0,) * 5)


def _require_watts_and_wavelengths(rayfile: RayFile) -> None:
    if rayfile.flux_unit != "W" or rayfile.wavelengths_nm is None:
        have = "lm" if rayfile.flux_unit != "W" else "no wavelengths"
        raise InputError(
            f"SPEOS files hold W and a wavelength for each ray, these rays have {have}; convert to tm25 instead"
        )


def _is_binary(head: bytes, size: int) -> bool:
    return head[4:24] == _MARK


def _decode_binary(image: FileImage) -> RayFile:
    watts, *_, lumens = image.unpack(_HEADER)
    rows = image.rows_to_end(_HEADER.size, 8)
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, 7],
        flux_unit="W",
        wavelengths_nm=rows[:, 6],
        format=BINARY.name,
        header_flux_w=known(watts),
        header_flux_lm=known(lumens),
        header_role="scale",
        warnings=() if known(watts) else ("the header states no power: the energies are taken as W",),
    )


def _encode_binary(rayfile: RayFile) -> Iterator[bytes]:
    _require_watts_and_wavelengths(rayfile)
    yield _HEADER.pack(rayfile.total_flux(), *(2.0,) * 5, rayfile.header_flux_lm or 0.0)
    for block in rayfile.absolute_blocks():
        yield float_rows(block.positions_mm, block.directions, block.wavelengths_nm, block.flux)


BINARY = register(Format("speos", "SPEOS binary", (".ray",), _is_binary, _decode_binary, _encode_binary))

_WIDTHS = (9, 14)


def _is_text(head: bytes, size: int) -> bool:
    return is_counted_text(head, (1, 1), _WIDTHS)


def _decode_text(image: FileImage) -> RayFile:
    _, rows = counted_rows(image, _WIDTHS)
    unused = ("columns 10 to 14 are not used here, and lost when converted",) if rows.shape[1] > _WIDTHS[0] else ()
    return RayFile(
        positions_mm=rows[:, 1:4],
        directions=rows[:, 4:7],
        flux=rows[:, 8],
        flux_unit="W",
        wavelengths_nm=rows[:, 7],
        format=TEXT.name,
        header={"unused_columns": ["10 to 14"]} if unused else {},
        warnings=(
            "SPEOS text is experimental: lengths are taken as mm and energies as W, check both",
            *unused,
            *cut_warnings(image),
        ),
    )


def _encode_text(rayfile: RayFile) -> Iterator[bytes]:
    _require_watts_and_wavelengths(rayfile)
    yield f"{len(rayfile)}\n".encode("ascii")
    number = 1
    for block in rayfile.absolute_blocks():
        numbered = np.arange(number, number + len(block), dtype=np.float64)
        yield print_rows(numbered, block.positions_mm, block.directions, block.wavelengths_nm, block.flux)
        number += len(block)


TEXT = register(Format("speos_text", "SPEOS text (experimental)", (".txt",), _is_text, _decode_text, _encode_text))
