"""LightTools binary ray files (`.ray`): `LTRF`, a header of 44 bytes, rows of float32, `LTRFEND`.

The number of rays follows from the size of the file. LightTools writes ray fluxes that add up to the number of rays
times the flux in the header; the header counts, and files written here keep that convention.
Tristimulus and polarised rays have no public layout and are refused.
"""

import struct
from collections.abc import Iterator

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file import Format, RayFile
from lensforge.sources.rayfiles.ray_file_bytes import FileImage, float_rows, known, scaled

_HEADER = struct.Struct("<4s6I4f")
_MAGIC, _END = b"LTRF", b"LTRFEND"
_SEARCHED = 4096  # bytes at the end in which the mark is looked for
_MM_PER_UNIT = {0: 1.0, 1: 1.0, 2: 10.0, 3: 1000.0, 4: 25.4, 5: 304.8, 6: 1e-3, 7: 1e-6}  # 0 is the model's own unit
_SYSTEM_UNIT, _MILLIMETRES = 0, 1
_NO_COLOUR, _WAVELENGTH = 0, 2


def _matches(head: bytes, size: int) -> bool:
    return head[:4] == _MAGIC


def _decode(image: FileImage) -> RayFile:
    _, major, minor, flux_type, far_field, colour, unit_code, *origin, flux = image.unpack(_HEADER)
    for name, value, allowed in (
        ("major version", major, (2,)),
        ("flux type", flux_type, (0, 1)),
        ("far-field flag", far_field, (0, 1)),
        ("colour information", colour, (_NO_COLOUR, _WAVELENGTH)),
        ("length unit", unit_code, tuple(_MM_PER_UNIT)),
    ):
        if value not in allowed:
            raise image.refuse(
                f"{name} {value}: only {', '.join(map(str, allowed))} can be read; export it so, or as TM-25"
            )
    if image.part(image.size - len(_END), image.size) != _END:
        raise _wrong_end(image)
    columns = 7 - 3 * far_field + (colour == _WAVELENGTH)
    rows = image.rows_to_end(_HEADER.size, columns, tail=len(_END))
    warnings = ["far-field data: all rays start at the file's data origin"] * bool(far_field)
    if unit_code == _SYSTEM_UNIT:
        warnings.append("lengths are in the unit of the model that wrote it: taken as mm")
    start = 0 if far_field else 3
    return RayFile(
        positions_mm=_starts(origin, rows) if far_field else scaled(rows[:, 0:3], _MM_PER_UNIT[unit_code]),
        directions=rows[:, start : start + 3],
        flux=rows[:, start + 3],
        flux_unit="lm" if flux_type else "W",
        wavelengths_nm=rows[:, start + 4] if colour == _WAVELENGTH else None,
        format=FORMAT.name,
        header_flux_w=None if flux_type else known(flux),
        header_flux_lm=known(flux) if flux_type else None,
        header={
            "version": f"{major}.{minor}",
            "data_origin": [value if np.isfinite(value) else None for value in origin],
            "mm_per_unit": _MM_PER_UNIT[unit_code],
        },
        warnings=tuple(warnings),
    )


def _wrong_end(image: FileImage) -> InputError:
    """Tell bytes behind the end mark from rays without one."""
    _, mark, behind = image.part(image.size - _SEARCHED, image.size).rpartition(_END)
    if mark:
        return image.refuse(f"{len(behind)} bytes behind LTRFEND, where it should end; fetch or export it again")
    return image.refuse("truncated: it does not end with LTRFEND; fetch or export it again")


def _starts(origin: list[float], rows: np.ndarray) -> np.ndarray:
    """All rays from one point, as a view that takes no memory; its unit is not documented, so it is taken as mm."""
    return np.broadcast_to(np.array(origin, dtype=np.float32), (len(rows), 3))


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    colour = _NO_COLOUR if rayfile.wavelengths_nm is None else _WAVELENGTH
    total = rayfile.total_flux()
    yield _HEADER.pack(_MAGIC, 2, 0, int(rayfile.flux_unit == "lm"), 0, colour, _MILLIMETRES, 0.0, 0.0, 0.0, total)
    for block in rayfile.absolute_blocks(total * len(rayfile)):
        yield float_rows(block.positions_mm, block.directions, block.flux, block.wavelengths_nm)
    yield _END


FORMAT = Format("lighttools_binary", "LightTools binary", (".ray",), _matches, _decode, _encode)
