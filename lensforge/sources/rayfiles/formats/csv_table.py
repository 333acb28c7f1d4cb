"""Rays in a table with a line of column names, for spreadsheets and scripts.

`x_mm,y_mm,z_mm,kx,ky,kz,flux_w` or `flux_lm`, and perhaps `wavelength_nm`; any order, further columns are ignored.
Lines that start with `#` before the names are comments. Written with commas and points, read in any dialect of a
spreadsheet.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lensforge.errors import InputError
from lensforge.results.text_dialect import Dialect, Line, lines_of
from lensforge.results.text_table import Column, header_cells, named_columns, require_columns
from lensforge.sources.rayfiles.ray_file import FluxUnit, Format, RayFile, register
from lensforge.sources.rayfiles.ray_file_rows import (
    HEAD_BYTES,
    FileImage,
    cut_warnings,
    parse_rows,
    plain_text,
    print_rows,
)

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4}
_RAY = (
    *(Column((axis,), _MM) for axis in "xyz"),
    *(Column((f"k{axis}", cosine)) for axis, cosine in zip("xyz", "lmn", strict=True)),
)
_COLUMNS = (
    *_RAY,
    Column(("flux", "power"), {"w": 1.0, "mw": 1e-3}, needed=False),
    Column(("flux", "luminous flux"), {"lm": 1.0}, needed=False),
    Column(("wavelength", "lambda"), {"nm": 1.0, "": 1.0, "um": 1e3}, needed=False),
)
_TELLING = 4  # columns of a ray's place and direction that tell the format, so that a refusal names the missing ones
_FLUX: dict[FluxUnit, int] = {"W": 6, "lm": 7}  # places in these columns
_WAVELENGTH = 8


@dataclass(frozen=True)
class _Head:
    """Names of the columns, the dialect of the rows, and the first of them: its line, and its first byte."""

    names: Sequence[str]
    line: int
    begin: int
    dialect: Dialect

    @staticmethod
    def of(head: bytes, name: str = "") -> "_Head":
        """Read the lines up to the first row, and the rows behind it that are whole."""
        lines = lines_of(head.removeprefix(b"\xef\xbb\xbf").decode("latin-1"), comments_behind=False)
        stated = lines[0].text[4:5] if lines and lines[0].text.lower().startswith("sep=") else None
        place = 1 if stated else 0
        header = lines[place] if place < len(lines) else Line(1, "")
        marks = (stated or "", ";", "\t", ",")
        separator = next((mark for mark in marks if mark and mark in header.text), " ")
        rows = lines[place + 1 : -1] or lines[place + 1 :]
        names = header_cells(header, Dialect(separator), name)
        begin = sum(len(line) for line in head.splitlines(keepends=True)[: header.number])
        return _Head(names, header.number + 1, begin, Dialect.of(rows, name, separator) if rows else Dialect(separator))


def _matches(head: bytes, size: int) -> bool:
    try:
        names = _Head.of(head).names
    except InputError:
        return False
    return sum(any(column.factor_of(name) is not None for name in names) for column in _RAY) >= _TELLING


def _decode(image: FileImage) -> RayFile:
    head = _Head.of(image.part(0, HEAD_BYTES), str(image.path))
    where = f"{image.path}, line {head.line - 1}"
    found = named_columns(head.names, _COLUMNS, where)
    require_columns(found, head.names, _COLUMNS, where)
    units = [unit for unit, at in _FLUX.items() if at in found]
    if len(units) != 1:
        raise image.refuse(f"columns {','.join(head.names)[:120]!r}: must have exactly one of flux_w and flux_lm")
    order = [*range(6), _FLUX[units[0]], *([_WAVELENGTH] if _WAVELENGTH in found else [])]
    places = [found[at][0] for at in order]
    rows = parse_rows(image, head.begin, image.size, head.line, head.dialect, places, width=len(head.names))
    factors = np.array([found[at][1] for at in order])
    if (factors != 1.0).any():
        rows = rows * factors
    return RayFile(
        positions_mm=rows[:, 0:3],
        directions=rows[:, 3:6],
        flux=rows[:, 6],
        flux_unit=units[0],
        wavelengths_nm=rows[:, 7] if _WAVELENGTH in found else None,
        format=TEXT.name,
        header={"columns": [plain_text(name.encode("latin-1"), "latin-1") for name in head.names]},
        warnings=cut_warnings(image),
    )


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    waves = [] if rayfile.wavelengths_nm is None else [_WAVELENGTH]
    names = [_COLUMNS[at].title for at in (*range(6), _FLUX[rayfile.flux_unit], *waves)]
    yield (",".join(names) + "\n").encode("ascii")
    for block in rayfile.absolute_blocks():
        yield print_rows(block.positions_mm, block.directions, block.flux, block.wavelengths_nm, delimiter=",")


TEXT = register(Format("csv", "comma-separated values", (".csv",), _matches, _decode, _encode))
