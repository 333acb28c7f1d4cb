"""Zemax OpticStudio source files, binary (`.dat`, `.sdf`) and text (`.txt`).

- Binary: a header of 208 bytes, then rows of 7 or 8 float32. OpticStudio uses only the number of rays, the units, the
  ray format and the flux type of the header; the power is what the rays add up to. The header's fluxes are shown and
  compared, never used.
- Text: a line `N unit [ray_format flux_type]`, then `x y z l m n flux [wavelength in µm]`. Exporters pad the first
  line with zeros to the width of the rays, so its number of columns says nothing, and only the width of a ray tells
  whether it has a wavelength.
"""

import struct
from collections.abc import Iterator

import numpy as np

from lensforge.sources.rayfiles.ray_file import (
    FluxUnit,
    Format,
    RayFile,
    register,
    require_watts_with_wavelengths,
    shared_wavelength,
)
from lensforge.sources.rayfiles.ray_file_rows import (
    FileImage,
    counted_rows,
    cut_warnings,
    float_rows,
    is_counted_text,
    known,
    plain_text,
    print_rows,
    scaled,
)

_HEADER = struct.Struct("<iI100s7fI13f4i")
_IDENTIFIERS = (1010, 8675309)
_MM_PER_UNIT = {0: 1000.0, 1: 25.4, 2: 10.0, 3: 304.8, 4: 1.0}  # m, in, cm, ft, mm
_MILLIMETRES = 4
_FLUX_ONLY = 0
_SPECTRAL = 2
NM_PER_MICRON = 1000.0
_WIDTHS = (7, 8)


def _is_binary(head: bytes, size: int) -> bool:
    return int.from_bytes(head[:4], "little") in _IDENTIFIERS or int.from_bytes(head[:4], "big") in _IDENTIFIERS


def _is_text(head: bytes, size: int) -> bool:
    return is_counted_text(head, (2, 8), _WIDTHS)


def _decode_binary(image: FileImage) -> RayFile:
    identifier, rays, description, source_flux, ray_set_flux, microns, *numbers = image.unpack(_HEADER)
    units = numbers[4]
    ray_format = numbers[18]
    flux_type = numbers[19]
    if identifier not in _IDENTIFIERS:
        raise image.refuse("its bytes are in the wrong order (big-endian); export it again, little-endian")
    if ray_format not in (_FLUX_ONLY, _SPECTRAL):
        raise image.refuse(f"ray format {ray_format}: 0 (flux) or 2 (flux and wavelength); export it again")
    mm_per_unit, unit = _units(image, units, flux_type, ray_format == _SPECTRAL)
    rows = image.rows(_HEADER.size, rays, 8 if ray_format == _SPECTRAL else 7)
    shared = known(microns)
    waves = None if shared is None else shared_wavelength(shared * NM_PER_MICRON, rays)
    return RayFile(
        positions_mm=scaled(rows[:, 0:3], mm_per_unit),
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=unit,
        wavelengths_nm=scaled(rows[:, 7], NM_PER_MICRON) if ray_format == _SPECTRAL else waves,
        format=BINARY.name,
        header_flux_w=known(ray_set_flux) if unit == "W" else None,
        header_flux_lm=known(ray_set_flux) if unit == "lm" else None,
        header_role="ignored",
        header={
            "identifier": identifier,
            "description": plain_text(description, "latin-1"),
            "source_flux": known(source_flux),
            "ray_set_flux": known(ray_set_flux),
            "mm_per_unit": mm_per_unit,
        },
        warnings=_flux_warnings(flux_type, ray_format == _SPECTRAL),
    )


def _decode_text(image: FileImage) -> RayFile:
    first, rows = counted_rows(image, _WIDTHS)
    unit_code, _, flux_type = [*first[1:], 0.0, 0.0][:3]
    spectral = rows.shape[1] == _WIDTHS[1]
    mm_per_unit, unit = _units(image, unit_code, flux_type, spectral)
    return RayFile(
        positions_mm=scaled(rows[:, 0:3], mm_per_unit),
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=unit,
        wavelengths_nm=scaled(rows[:, 7], NM_PER_MICRON) if spectral else None,
        format=TEXT.name,
        header={"mm_per_unit": mm_per_unit},
        warnings=(*_flux_warnings(flux_type, spectral), *cut_warnings(image)),
    )


def _units(image: FileImage, unit_code: float | int, flux_type: float | int, spectral: bool) -> tuple[float, FluxUnit]:
    """Length of the unit in mm, and the unit of flux: spectral rays have W, whatever the flux type says."""
    if unit_code not in _MM_PER_UNIT:
        raise image.refuse(f"length unit {unit_code:g}: 0 m, 1 in, 2 cm, 3 ft, 4 mm; export it again")
    if flux_type not in (0, 1):
        raise image.refuse(f"flux type {flux_type:g}: 0 (W) or 1 (lm); export it again")
    return _MM_PER_UNIT[int(unit_code)], "lm" if flux_type == 1 and not spectral else "W"


def _flux_warnings(flux_type: float | int, spectral: bool) -> tuple[str, ...]:
    return ("its flux type is lm, but it has wavelengths: taken as W, as OpticStudio does",) * (
        spectral and flux_type == 1
    )


def _encode_binary(rayfile: RayFile) -> Iterator[bytes]:
    single = rayfile.single_wavelength
    spectral = rayfile.wavelengths_nm is not None and single is None
    if spectral:
        require_watts_with_wavelengths(rayfile, BINARY.title)
    total = rayfile.total_flux()
    description = str(rayfile.header.get("description") or rayfile.header.get("name") or "")
    yield _HEADER.pack(
        _IDENTIFIERS[0], len(rayfile), description.encode("ascii", "replace")[:99],
        total, total, 0.0 if single is None else single / NM_PER_MICRON, 0.0, 0.0, 0.0, 0.0, _MILLIMETRES,
        *(0.0,) * 6, *(1.0,) * 3, *(0.0,) * 4,
        _SPECTRAL if spectral else _FLUX_ONLY, int(rayfile.flux_unit == "lm"), 0, 0,
    )  # fmt: skip
    for block in rayfile.absolute_blocks():
        yield float_rows(block.positions_mm, block.directions, block.flux, _microns(block) if spectral else None)


def _encode_text(rayfile: RayFile) -> Iterator[bytes]:
    require_watts_with_wavelengths(rayfile, TEXT.title)
    ray_format = _FLUX_ONLY if rayfile.wavelengths_nm is None else _SPECTRAL
    yield f"{len(rayfile)} {_MILLIMETRES} {ray_format} {int(rayfile.flux_unit == 'lm')}\n".encode("ascii")
    for block in rayfile.absolute_blocks():
        yield print_rows(block.positions_mm, block.directions, block.flux, _microns(block))


def _microns(block: RayFile) -> np.ndarray | None:
    return None if block.wavelengths_nm is None else scaled(block.wavelengths_nm, 1.0 / NM_PER_MICRON)


BINARY = register(Format("zemax_binary", "Zemax binary", (".dat", ".sdf"), _is_binary, _decode_binary, _encode_binary))
TEXT = register(Format("zemax_text", "Zemax text", (".txt",), _is_text, _decode_text, _encode_text))
