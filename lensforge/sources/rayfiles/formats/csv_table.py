"""Rays in a table with a line of column names, for spreadsheets and scripts.

`x_mm,y_mm,z_mm,kx,ky,kz,flux_w` or `flux_lm`, and perhaps `wavelength_nm`; any order, further columns are ignored.
Lines that start with `#` before the names are comments. Written with commas and points, read in any dialect of a
spreadsheet.
"""

import warnings
from collections.abc import Iterator

import numpy as np

from lensforge.errors import FileWarning, InputError
from lensforge.results.table_names import MILLIMETRES, NANOMETRES, Column, header_cells
from lensforge.results.text_table import TextTable
from lensforge.sources.rayfiles.ray_file import FluxUnit, Format, RayFile, register
from lensforge.sources.rayfiles.ray_file_rows import (
    HEAD_BYTES,
    FileImage,
    cut_warnings,
    parse_rows,
    plain_text,
    print_rows,
)

_MM = {unit: factor for unit, factor in MILLIMETRES.items() if unit}  # a place without a unit may be in any
_RAY = (
    *(Column((axis,), _MM) for axis in "xyz"),
    *(Column((f"k{axis}", cosine)) for axis, cosine in zip("xyz", "lmn", strict=True)),
)
_COLUMNS = (
    *_RAY,
    Column(("flux", "power"), {"w": 1.0, "mw": 1e-3}, needed=False),
    Column(("flux", "luminous flux"), {"lm": 1.0}, needed=False),
    Column(("wavelength", "lambda"), NANOMETRES, needed=False),
)
_TELLING = 4  # columns of a ray's place and direction that tell the format, so that a refusal names the missing ones
_FLUX: dict[FluxUnit, int] = {"W": 6, "lm": 7}  # places in these columns
_WAVELENGTH = 8


def _table_of(head: bytes, name: str = "") -> TextTable:
    """The first lines of a file as a table; the last one may be cut, and is left out where it is not the only row."""
    lines = head.removeprefix(b"\xef\xbb\xbf").decode("latin-1").splitlines(keepends=True)
    try:
        return TextTable.of("".join(lines[:-1]), name)
    except InputError:
        return TextTable.of("".join(lines), name)


def _matches(head: bytes, size: int) -> bool:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FileWarning)  # who reads the file tells, with its name
            table = _table_of(head)
        rows = [header_cells(line, table.dialect, "") for line in (*table.header, *table.remarks)]
    except InputError:
        return False
    return any(
        sum(any(column.factor_of(name) is not None for name in cells) for column in _RAY) >= _TELLING for cells in rows
    )


def _decode(image: FileImage) -> RayFile:
    head = image.part(0, HEAD_BYTES)
    table = _table_of(head, str(image.path))
    names = table.names(_COLUMNS)
    if names is None:
        raise image.refuse(f"must have a line of {table.width} names above its rays; export it again")
    columns = names.places(_COLUMNS)
    names.require(columns, _COLUMNS)
    units = [unit for unit, at in _FLUX.items() if at in columns]
    if len(units) != 1:
        raise image.refuse(f"columns {','.join(names.cells)[:120]!r}: must have exactly one of flux_w and flux_lm")
    order = [*range(6), _FLUX[units[0]], *([_WAVELENGTH] if _WAVELENGTH in columns else [])]
    places = [columns[at][0] for at in order]
    line = table.rows[0].number
    begin = sum(len(text_line) for text_line in head.splitlines(keepends=True)[: line - 1])
    rows = parse_rows(image, begin, image.size, line, table.dialect, places, width=len(names.cells))
    factors = np.array([columns[at][1] for at in order])
    if (factors != 1.0).any():
        rows = rows * factors
    left_over = names.left_over(columns)
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=units[0],
        wavelengths_nm=rows[:, 7] if _WAVELENGTH in columns else None,
        format=TEXT.name,
        header={"columns": [plain_text(name.encode("latin-1"), "latin-1") for name in names.cells]},
        warnings=(*cut_warnings(image), *([left_over] if left_over else [])),
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    waves = [] if rayfile.wavelengths_nm is None else [_WAVELENGTH]
    names = [_COLUMNS[at].title for at in (*range(6), _FLUX[rayfile.flux_unit], *waves)]
    yield (",".join(names) + "\n").encode("ascii")
    for block in rayfile.absolute_blocks():
        yield print_rows(block.positions_mm, block.directions, block.flux, block.wavelengths_nm, delimiter=",")


TEXT = register(Format("csv", "comma-separated values", (".csv",), _matches, _decode, _encode))
