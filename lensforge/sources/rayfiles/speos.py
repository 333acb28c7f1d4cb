"""SPEOS binary ray files (`.ray`): seven float32, then rows `x y z l m n wavelength energy`.

The header has no magic word: total W, five times 2.0, total lm. Energies are relative to each other; the power of a
ray is its share of the header's W. The header has no count: a file cut between two rays looks whole.
"""

import struct
from collections.abc import Iterator

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file import Format, RayFile
from lensforge.sources.rayfiles.ray_file_bytes import FileImage, float_rows, known

_HEADER = struct.Struct("<7f")
_MARK = struct.pack("<5f", *(2.0,) * 5)


def require_watts_and_wavelengths(rayfile: RayFile) -> None:
    """Refuse rays in lumens or without wavelengths, which no SPEOS format holds."""
    if rayfile.flux_unit != "W" or rayfile.wavelengths_nm is None:
        have = "lm" if rayfile.flux_unit != "W" else "no wavelengths"
        raise InputError(
            f"SPEOS files hold W and a wavelength for each ray, these rays have {have}; convert to tm25 instead"
        )


def _matches(head: bytes, size: int) -> bool:
    return head[4:24] == _MARK


def _decode(image: FileImage) -> RayFile:
    watts, *_, lumens = image.unpack(_HEADER)
    rows = image.rows_to_end(_HEADER.size, 8)
    warnings = () if known(watts) else ("the header states no power: the energies are taken as W",)
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, 7],
        flux_unit="W",
        wavelengths_nm=rows[:, 6],
        format=FORMAT.name,
        header_flux_w=known(watts),
        header_flux_lm=known(lumens),
        header_role="scale",
        warnings=warnings,
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    require_watts_and_wavelengths(rayfile)
    total = rayfile.total_flux()
    yield _HEADER.pack(total, *(2.0,) * 5, rayfile.header_flux_lm or 0.0)
    for block in rayfile.absolute_blocks():
        yield float_rows(block.positions_mm, block.directions, block.wavelengths_nm, block.flux)


FORMAT = Format("speos", "SPEOS binary", (".ray",), _matches, _decode, _encode)
