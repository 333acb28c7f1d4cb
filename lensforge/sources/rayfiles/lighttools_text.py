"""LightTools text ray files: `key: value` lines, `lt_startofdata`, rows of numbers, `lt_endofdata`."""

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np

from lensforge.sources.rayfiles.ray_file import HEAD_BYTES, FluxUnit, Format, RayFile
from lensforge.sources.rayfiles.ray_file_bytes import FileImage, known, plain_text, scaled
from lensforge.sources.rayfiles.ray_file_text import numbers, parse_rows, print_rows

_START, _END = b"lt_startofdata", b"lt_endofdata"
_MM_PER_UNIT = {
    "system": 1.0, "millimeters": 1.0, "centimeters": 10.0, "meters": 1000.0,
    "inches": 25.4, "feet": 304.8, "microns": 1e-3, "micrometers": 1e-3, "nanometers": 1e-6,
}  # fmt: skip
_UNITS: dict[str, FluxUnit] = {"luminous_flux": "lm", "radiant_power": "W"}
_FAR_FIELD = {"no": False, "yes": True}
_COLOUR = {"none": False, "wavelength": True}
_Choice = TypeVar("_Choice")
_DEFAULTS = {"lt_far_field_data": "no", "lt_color_info": "none", "lt_length_units": "millimeters"}


def _matches(head: bytes, size: int) -> bool:
    return b"lt_rdf_version" in head or _START in head


def _decode(image: FileImage) -> RayFile:
    head, marker, _ = image.part(0, HEAD_BYTES).partition(_START)
    ending = image.part(max(image.size - HEAD_BYTES, 0), image.size).rpartition(_END)
    if not marker or not ending[1]:
        raise image.refuse("truncated: lt_startofdata or lt_endofdata is missing; fetch or export it again")
    header = _header(head)
    unit = _choice(image, header, "lt_datatype", _UNITS)
    far_field = _choice(image, header, "lt_far_field_data", _FAR_FIELD)
    coloured = _choice(image, header, "lt_color_info", _COLOUR)
    mm_per_unit = _choice(image, header, "lt_length_units", _MM_PER_UNIT)
    begin = len(head) + len(_START)
    end = image.size - len(ending[2]) - len(_END)
    rows = parse_rows(image, begin, end, first_line=head.count(b"\n") + 2)
    expected = 7 - 3 * far_field + coloured
    if rows.shape[1] != expected:
        raise image.refuse(f"rows of {rows.shape[1]} numbers, its header announces {expected}; export it again")
    flux = known((numbers(header.get("lt_radiant_flux", "")) or [0.0])[0])
    start = 0 if far_field else 3
    return RayFile(
        positions_mm=_origin(image, header, len(rows)) if far_field else scaled(rows[:, 0:3], mm_per_unit),
        directions=rows[:, start : start + 3],
        flux=rows[:, start + 3],
        flux_unit=unit,
        wavelengths_nm=rows[:, start + 4] if coloured else None,
        format=FORMAT.name,
        header_flux_w=flux if unit == "W" else None,
        header_flux_lm=flux if unit == "lm" else None,
        header={**header, "mm_per_unit": mm_per_unit},
        warnings=("far-field data: all rays start at the file's data origin",) if far_field else (),
    )


def _header(head: bytes) -> dict[str, str]:
    """The `key: value` lines; comments start with `#`."""
    lines = (plain_text(line, "latin-1") for line in head.splitlines() if not line.startswith(b"#"))
    pairs = (line.partition(":") for line in lines if ":" in line)
    return {key.strip(): value.strip() for key, _, value in pairs}


def _choice(image: FileImage, header: dict[str, str], key: str, choices: Mapping[str, _Choice]) -> _Choice:
    value = header.get(key, _DEFAULTS.get(key, "")).lower()
    if value not in choices:
        raise image.refuse(f"{key}: {value[:40] or 'missing'}; one of {', '.join(choices)} can be read")
    return choices[value]


def _origin(image: FileImage, header: dict[str, str], count: int) -> np.ndarray:
    point = numbers(header.get("lt_data_origin", "0 0 0"))
    if point is None or len(point) != 3:
        raise image.refuse("lt_data_origin: three numbers; export it again")
    return np.broadcast_to(np.array(point), (count, 3))


def _encode(rayfile: RayFile) -> Iterator[bytes]:
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


FORMAT = Format("lighttools_text", "LightTools text", (".ray", ".txt"), _matches, _decode, _encode)
