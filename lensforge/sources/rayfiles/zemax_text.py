"""Zemax text source files: a line `N unit [ray_format flux_type]`, then `x y z l m n flux [wavelength in µm]`.

Exporters pad the first line with zeros to the width of the rays, so its number of columns says nothing, and only the
width of a ray tells whether it has a wavelength.
"""

from collections.abc import Iterator

from lensforge.sources.rayfiles.ray_file import HEAD_BYTES, FluxUnit, Format, RayFile, require_watts_with_wavelengths
from lensforge.sources.rayfiles.ray_file_bytes import FileImage, scaled
from lensforge.sources.rayfiles.ray_file_text import cut_warnings, numbers, opening_lines, parse_rows, print_rows
from lensforge.sources.rayfiles.zemax_binary import MILLIMETRES, MM_PER_UNIT, NM_PER_MICRON


def _matches(head: bytes, size: int) -> bool:
    lines = opening_lines(head)
    if lines is None:
        return False
    counts, ray = numbers(lines[0]), numbers(lines[1])
    return (
        counts is not None
        and 2 <= len(counts) <= 8
        and all(number.is_integer() for number in counts)
        and counts[0] >= 1.0
        and ray is not None
        and len(ray) in (7, 8)
    )


def _decode(image: FileImage) -> RayFile:
    first, _, _ = image.part(0, HEAD_BYTES).partition(b"\n")
    rays, unit_code, _, flux_type = [*(numbers(first.decode("latin-1")) or []), 0.0, 0.0][:4]
    if unit_code not in MM_PER_UNIT:
        raise image.refuse(f"line 1: length unit {unit_code:g}: 0 m, 1 in, 2 cm, 3 ft, 4 mm; correct it")
    if flux_type not in (0.0, 1.0):
        raise image.refuse(f"line 1: flux type {flux_type:g}: 0 (W) or 1 (lm); correct it")
    rows = parse_rows(image, len(first) + 1, image.size, first_line=2)
    if rows.shape[1] not in (7, 8):
        raise image.refuse(f"line 2: {rows.shape[1]} numbers; 7, or 8 with a wavelength")
    if len(rows) != rays:
        fault = "truncated" if len(rows) < rays else "more than that"
        raise image.refuse(f"line 1 promises {rays:.15g} rays, the file holds {len(rows)} ({fault}); fetch it again")
    spectral = rows.shape[1] == 8
    unit: FluxUnit = "lm" if flux_type == 1.0 and not spectral else "W"
    mm_per_unit = MM_PER_UNIT[int(unit_code)]
    return RayFile(
        positions_mm=scaled(rows[:, 0:3], mm_per_unit),
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=unit,
        wavelengths_nm=scaled(rows[:, 7], NM_PER_MICRON) if spectral else None,
        format=FORMAT.name,
        header={"mm_per_unit": mm_per_unit},
        warnings=cut_warnings(image),
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    require_watts_with_wavelengths(rayfile, FORMAT.title)
    spectral = rayfile.wavelengths_nm is not None
    yield f"{len(rayfile)} {MILLIMETRES} {2 if spectral else 0} {int(rayfile.flux_unit == 'lm')}\n".encode("ascii")
    for block in rayfile.absolute_blocks():
        microns = None if block.wavelengths_nm is None else scaled(block.wavelengths_nm, 1.0 / NM_PER_MICRON)
        yield print_rows(block.positions_mm, block.directions, block.flux, microns)


FORMAT = Format("zemax_text", "Zemax text", (".txt",), _matches, _decode, _encode)
