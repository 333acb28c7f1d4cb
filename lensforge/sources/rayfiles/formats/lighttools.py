"""LightTools ray files, binary (`.ray`) and text (`.ray`, `.txt`).

- Binary: `LTRF`, a header of 44 bytes, rows of float32, `LTRFEND`; the number of rays follows from the file's size.
- Text: `key: value` lines, `lt_startofdata`, rows of numbers, `lt_endofdata`.

LightTools writes ray fluxes that add up to the number of rays times the flux in the header; the header counts, and
files written here keep that convention. Tristimulus and polarised rays have no public layout and are refused.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file import FluxUnit, Format, HeaderValue, RayFile, register
from lensforge.sources.rayfiles.ray_file_rows import (
    HEAD_BYTES,
    FileImage,
    float_rows,
    known,
    numbers,
    parse_rows,
    plain_text,
    print_rows,
    scaled,
)


def _rayfile(
    format: str,
    rows: np.ndarray,
    unit: FluxUnit,
    origin: Sequence[float] | None,
    mm_per_unit: float,
    flux: float | None,
    header: Mapping[str, HeaderValue],
) -> RayFile:
    """Rays by the columns of both formats; ``origin``: of far-field data, whose rows have no start points.

    All rays of a far field start there; its unit is not documented, so it is taken as mm.
    """
    if origin is None:
        start = 3
        positions_mm = scaled(rows[:, 0:3], mm_per_unit)
    else:  # a view that takes no memory
        start = 0
        positions_mm = np.broadcast_to(np.array(origin, dtype=rows.dtype), (len(rows), 3))
    return RayFile(
        positions_mm=positions_mm,
        directions=rows[:, start : start + 3],
        flux=rows[:, start + 3],
        flux_unit=unit,
        wavelengths_nm=rows[:, start + 4] if rows.shape[1] > start + 4 else None,
        format=format,
        header_flux_w=flux if unit == "W" else None,
        header_flux_lm=flux if unit == "lm" else None,
        header_role="mean",
        header={**header, "mm_per_unit": mm_per_unit},
        warnings=("far-field data: all rays start at the file's data origin",) * (origin is not None),
    )


_HEADER = struct.Struct("<4s6I4f")
_MAGIC = b"LTRF"
_BINARY_END = b"LTRFEND"
_SEARCHED = 4096  # bytes at the end in which the mark is looked for
_MM_BY_CODE = {0: 1.0, 1: 1.0, 2: 10.0, 3: 1000.0, 4: 25.4, 5: 304.8, 6: 1e-3, 7: 1e-6}  # 0 is the model's own unit
_SYSTEM_UNIT = 0
_MILLIMETRES = 1
_NO_COLOUR = 0
_WAVELENGTH = 2


def _is_binary(head: bytes, size: int) -> bool:
    return head[:4] == _MAGIC


def _decode_binary(image: FileImage) -> RayFile:
    _, major, minor, flux_type, far_field, colour, unit_code, *origin, flux = image.unpack(_HEADER)
    for name, value, allowed in (
        ("major version", major, (2,)),
        ("flux type", flux_type, (0, 1)),
        ("far-field flag", far_field, (0, 1)),
        ("colour information", colour, (_NO_COLOUR, _WAVELENGTH)),
        ("length unit", unit_code, tuple(_MM_BY_CODE)),
    ):
        if value not in allowed:
            raise image.refuse(
                f"{name} {value}: only {', '.join(map(str, allowed))} can be read; export it so, or as TM-25"
            )
    if image.part(image.size - len(_BINARY_END), image.size) != _BINARY_END:
        raise _wrong_end(image)
    rows = image.rows_to_end(_HEADER.size, 7 - 3 * far_field + (colour == _WAVELENGTH), tail=len(_BINARY_END))
    header: dict[str, HeaderValue] = {
        "version": f"{major}.{minor}",
        "data_origin": [value if np.isfinite(value) else None for value in origin],
    }
    unit: FluxUnit = "lm" if flux_type else "W"
    start = origin if far_field else None
    rayfile = _rayfile(BINARY.name, rows, unit, start, _MM_BY_CODE[unit_code], known(flux), header)
    if unit_code != _SYSTEM_UNIT:
        return rayfile
    warning = "lengths are in the unit of the model that wrote it: taken as mm"
    return replace(rayfile, warnings=(*rayfile.warnings, warning))


def _wrong_end(image: FileImage) -> InputError:
    """Tell bytes behind the end mark from rays without one."""
    _, mark, behind = image.part(image.size - _SEARCHED, image.size).rpartition(_BINARY_END)
    if mark:
        return image.refuse(f"{len(behind)} bytes behind LTRFEND, where it should end; fetch or export it again")
    return image.refuse("truncated: it does not end with LTRFEND; fetch or export it again")


def _encode_binary(rayfile: RayFile) -> Iterator[bytes]:
    colour = _NO_COLOUR if rayfile.wavelengths_nm is None else _WAVELENGTH
    total = rayfile.total_flux()
    yield _HEADER.pack(_MAGIC, 2, 0, int(rayfile.flux_unit == "lm"), 0, colour, _MILLIMETRES, 0.0, 0.0, 0.0, total)
    for block in rayfile.absolute_blocks(total * len(rayfile)):
        yield float_rows(block.positions_mm, block.directions, block.flux, block.wavelengths_nm)
    yield _BINARY_END


BINARY = register(
    Format("lighttools_binary", "LightTools binary", (".ray",), _is_binary, _decode_binary, _encode_binary)
)

_START = b"lt_startofdata"
_END = b"lt_endofdata"
_MM_PER_UNIT = {
    "system": 1.0, "millimeters": 1.0, "centimeters": 10.0, "meters": 1000.0,
    "inches": 25.4, "feet": 304.8, "microns": 1e-3, "micrometers": 1e-3, "nanometers": 1e-6,
}  # fmt: skip
_UNITS: dict[str, FluxUnit] = {"luminous_flux": "lm", "radiant_power": "W"}
_FAR_FIELD = {"no": False, "yes": True}
_COLOUR = {"none": False, "wavelength": True}
_Choice = TypeVar("_Choice")
_DEFAULTS = {"lt_far_field_data": "no", "lt_color_info": "none", "lt_length_units": "millimeters"}


def _is_text(head: bytes, size: int) -> bool:
    return b"lt_rdf_version" in head or _START in head


def _decode_text(image: FileImage) -> RayFile:
    head, marker, _ = image.part(0, HEAD_BYTES).partition(_START)
    ending = image.part(max(image.size - HEAD_BYTES, 0), image.size).rpartition(_END)
    if not marker or not ending[1]:
        raise image.refuse("truncated: lt_startofdata or lt_endofdata is missing; fetch or export it again")
    lines = (plain_text(line, "latin-1") for line in head.splitlines() if not line.startswith(b"#"))
    pairs = (line.partition(":") for line in lines if ":" in line)
    header = {key.strip(): value.strip() for key, _, value in pairs}
    unit = _choice(image, header, "lt_datatype", _UNITS)
    far_field = _choice(image, header, "lt_far_field_data", _FAR_FIELD)
    coloured = _choice(image, header, "lt_color_info", _COLOUR)
    mm_per_unit = _choice(image, header, "lt_length_units", _MM_PER_UNIT)
    end = image.size - len(ending[2]) - len(_END)
    rows = parse_rows(image, len(head) + len(_START), end, first_line=head.count(b"\n") + 1)
    expected = 7 - 3 * far_field + coloured
    if rows.shape[1] != expected:
        raise image.refuse(f"rows of {rows.shape[1]} numbers, its header announces {expected}; export it again")
    origin = numbers(header.get("lt_data_origin", "0 0 0")) if far_field else None
    if far_field and (origin is None or len(origin) != 3):
        raise image.refuse("lt_data_origin: three numbers; export it again")
    flux = known((numbers(header.get("lt_radiant_flux", "")) or [0.0])[0])
    return _rayfile(TEXT.name, rows, unit, origin, mm_per_unit, flux, header)


def _choice(image: FileImage, header: dict[str, str], key: str, choices: Mapping[str, _Choice]) -> _Choice:
    value = header.get(key, _DEFAULTS.get(key, "")).lower()
    if value not in choices:
        raise image.refuse(f"{key}: {value[:40] or 'missing'}; one of {', '.join(choices)} can be read")
    return choices[value]


def _encode_text(rayfile: RayFile) -> Iterator[bytes]:
    total = rayfile.total_flux()
    header = {
        "lt_rdf_version": "2.0",
        "dataname": str(rayfile.header.get("dataname") or rayfile.header.get("name") or "rays"),
        "lt_datatype": "radiant_power" if rayfile.flux_unit == "W" else "luminous_flux",
        "lt_far_field_data": "no",
        "lt_color_info": "none" if rayfile.wavelengths_nm is None else "wavelength",
        "lt_length_units": "millimeters",
        "lt_data_origin": "0 0 0",
        "lt_radiant_flux": f"{total:.9g}",
    }
    lines = [f"{key}: {value}" for key, value in header.items()]
    yield "\n".join([*lines, "lt_startofdata", ""]).encode("ascii", "replace")
    for block in rayfile.absolute_blocks(total * len(rayfile)):
        yield print_rows(block.positions_mm, block.directions, block.flux, block.wavelengths_nm)
    yield _END + b"\n"


TEXT = register(Format("lighttools_text", "LightTools text", (".ray", ".txt"), _is_text, _decode_text, _encode_text))
