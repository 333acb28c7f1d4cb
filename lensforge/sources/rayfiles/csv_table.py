"""Comma-separated rays with a line of column names, for spreadsheets and scripts.

`x_mm,y_mm,z_mm,kx,ky,kz,flux_w` or `flux_lm`, and perhaps `wavelength_nm`; any order, further columns are ignored.
Lines that start with `#` before the names are comments.
"""

from collections.abc import Iterator
from itertools import takewhile

from lensforge.sources.rayfiles.ray_file import FluxUnit, Format, RayFile
from lensforge.sources.rayfiles.ray_file_rows import (
    HEAD_BYTES,
    FileImage,
    cut_warnings,
    parse_rows,
    plain_text,
    print_rows,
)

_POSITION = ("x_mm", "y_mm", "z_mm")
_DIRECTION = ("kx", "ky", "kz")
_FLUX: dict[str, FluxUnit] = {"flux_w": "W", "flux_lm": "lm"}
_WAVELENGTH = "wavelength_nm"


def _names(head: bytes) -> tuple[list[str], int]:
    """The column names, and the number of lines up to them."""
    lines = head.removeprefix(b"\xef\xbb\xbf").splitlines()
    comments = len(list(takewhile(lambda line: line.startswith(b"#"), lines)))
    names = lines[comments].decode("latin-1").lower().split(",") if comments < len(lines) else []
    return [name.strip().strip('"') for name in names], comments + 1


def _matches(head: bytes, size: int) -> bool:
    names, _ = _names(head)
    return set(_POSITION + _DIRECTION) <= set(names)


def _decode(image: FileImage) -> RayFile:
    head = image.part(0, HEAD_BYTES)
    names, header_lines = _names(head)
    flux_names = [name for name in names if name in _FLUX]
    if len(flux_names) != 1 or len(set(names)) != len(names):
        raise image.refuse(f"columns {','.join(names)[:120]!r}: exactly one of flux_w and flux_lm, and no name twice")
    begin = sum(len(line) for line in head.splitlines(keepends=True)[:header_lines])
    kept = [*_POSITION, *_DIRECTION, *flux_names, *([_WAVELENGTH] if _WAVELENGTH in names else [])]
    order = [names.index(name) for name in kept]
    rows = parse_rows(image, begin, image.size, header_lines + 1, ",", order, width=len(names))
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=_FLUX[flux_names[0]],
        wavelengths_nm=rows[:, 7] if _WAVELENGTH in names else None,
        format=TEXT.name,
        header={"columns": [plain_text(name.encode("latin-1"), "latin-1") for name in names]},
        warnings=cut_warnings(image),
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    flux_name = next(name for name, unit in _FLUX.items() if unit == rayfile.flux_unit)
    names = [*_POSITION, *_DIRECTION, flux_name, *([] if rayfile.wavelengths_nm is None else [_WAVELENGTH])]
    yield (",".join(names) + "\n").encode("ascii")
    for block in rayfile.absolute_blocks():
        yield print_rows(block.positions_mm, block.directions, block.flux, block.wavelengths_nm, delimiter=",")


TEXT = Format("csv", "comma-separated values", (".csv",), _matches, _decode, _encode)
