"""Zemax OpticStudio binary source files (`.dat`, `.sdf`): a header of 208 bytes, then rows of 7 or 8 float32.

OpticStudio uses only the number of rays, the units, the ray format and the flux type of the header; the power is
what the rays add up to. The header's fluxes are shown and compared, never used.
"""

import struct
from collections.abc import Iterator

import numpy as np

from lensforge.sources.rayfiles.ray_file import (
    FluxUnit,
    Format,
    RayFile,
    require_watts_with_wavelengths,
    shared_wavelength,
)
from lensforge.sources.rayfiles.ray_file_bytes import FileImage, float_rows, known, plain_text, scaled

_HEADER = struct.Struct("<iI100s7fI13f4i")
_IDENTIFIERS = (1010, 8675309)
MM_PER_UNIT = {0: 1000.0, 1: 25.4, 2: 10.0, 3: 304.8, 4: 1.0}  # m, in, cm, ft, mm
MILLIMETRES = 4
_FLUX_ONLY, _SPECTRAL = 0, 2
NM_PER_MICRON = 1000.0


def _matches(head: bytes, size: int) -> bool:
    return int.from_bytes(head[:4], "little") in _IDENTIFIERS or int.from_bytes(head[:4], "big") in _IDENTIFIERS


def _decode(image: FileImage) -> RayFile:
    identifier, rays, description, source_flux, ray_set_flux, microns, *numbers = image.unpack(_HEADER)
    units, ray_format, flux_type = numbers[4], numbers[18], numbers[19]
    if identifier not in _IDENTIFIERS:
        raise image.refuse("its bytes are in the wrong order (big-endian); export it again, little-endian")
    if units not in MM_PER_UNIT:
        raise image.refuse(f"length unit {units}: 0 m, 1 in, 2 cm, 3 ft, 4 mm; export it again")
    if ray_format not in (_FLUX_ONLY, _SPECTRAL):
        raise image.refuse(f"ray format {ray_format}: 0 (flux) or 2 (flux and wavelength); export it again")
    if flux_type not in (0, 1):
        raise image.refuse(f"flux type {flux_type}: 0 (W) or 1 (lm); export it again")
    spectral = ray_format == _SPECTRAL
    unit: FluxUnit = "lm" if flux_type == 1 and not spectral else "W"
    rows = image.rows(_HEADER.size, rays, 8 if spectral else 7)
    shared = known(microns)
    return RayFile(
        positions_mm=scaled(rows[:, 0:3], MM_PER_UNIT[units]),
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=unit,
        wavelengths_nm=_nanometres(rows[:, 7]) if spectral else _shared(shared, rays),
        format=FORMAT.name,
        header_flux_w=known(ray_set_flux) if unit == "W" else None,
        header_flux_lm=known(ray_set_flux) if unit == "lm" else None,
        header_role="ignored",
        header={
            "identifier": identifier,
            "description": plain_text(description, "latin-1"),
            "source_flux": known(source_flux),
            "ray_set_flux": known(ray_set_flux),
            "mm_per_unit": MM_PER_UNIT[units],
        },
    )


def _nanometres(microns: np.ndarray) -> np.ndarray:
    return scaled(microns, NM_PER_MICRON)


def _shared(microns: float | None, rays: int) -> np.ndarray | None:
    return None if microns is None else shared_wavelength(microns * NM_PER_MICRON, rays)


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    single = rayfile.single_wavelength
    spectral = rayfile.wavelengths_nm is not None and single is None
    if spectral:
        require_watts_with_wavelengths(rayfile, FORMAT.title)
    total = rayfile.total_flux()
    description = str(rayfile.header.get("description") or rayfile.header.get("name") or "")
    yield _HEADER.pack(
        _IDENTIFIERS[0], len(rayfile), description.encode("ascii", "replace")[:99],
        total, total, 0.0 if single is None else single / NM_PER_MICRON, 0.0, 0.0, 0.0, 0.0, MILLIMETRES,
        *(0.0,) * 6, *(1.0,) * 3, *(0.0,) * 4,
        _SPECTRAL if spectral else _FLUX_ONLY, int(rayfile.flux_unit == "lm"), 0, 0,
    )  # fmt: skip
    for block in rayfile.absolute_blocks():
        waves_nm = block.wavelengths_nm if spectral else None
        microns = None if waves_nm is None else scaled(waves_nm, 1.0 / NM_PER_MICRON)
        yield float_rows(block.positions_mm, block.directions, block.flux, microns)


FORMAT = Format("zemax_binary", "Zemax binary", (".dat", ".sdf"), _matches, _decode, _encode)
