"""Tables in text files: numbers in rows, columns by their names and units, and lists of entries.

One reader for spectra, coatings, targets, points, roads, materials, lists of LEDs, and the names of rays. Its numbers
are read by ``numpy.loadtxt``, which is there already, reads numbers alone, and refuses rows of other lengths: polars
and pandas read four times as fast, but weigh 180 and 84 MB, fill up short rows without a word, and name no line. What
it cannot read is read cell by cell, with line and column in the refusal.
"""

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import FileWarning, InputError, refused
from lensforge.results.files import MIB, read_file
from lensforge.results.table_names import Column, Heading, Names, Places, header_cells
from lensforge.results.text_dialect import Dialect, Line, decoded_text, lines_of, remarks_above, shown

# A row of numbers begins with one, perhaps behind empty cells, or with a word for none.
_ROW = re.compile(r"[\s;,\"']*(?:[-+−]?[.,]?\d|(?:[-+]?(?:nan|inf)|n/?a)\b)", re.IGNORECASE)
_NAMED_ROW = re.compile(r".*?[\s;,\"'][-+−]?[.,]?\d")
_STATED = re.compile(r"sep=(.)$", re.IGNORECASE)
_MARKS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}


@dataclass(frozen=True, eq=False)
class TextTable:
    """Rows of the file ``name``, with the lines of text before them as its ``header``, and ``remarks`` after a #.

    ``count``: the number of rows that the file announces, alone in the line before the first; None if it does not.
    """

    name: str
    header: Sequence[Line]
    rows: Sequence[Line]
    dialect: Dialect
    count: int | None = None
    remarks: Sequence[Line] = ()

    @staticmethod
    def read(path: Path | str, *, missing: str, most_bytes: int, counted: bool = False) -> "TextTable":
        """Read the table at ``path``, of at most ``most_bytes``; ``missing``: the remedy if there is none.

        ``counted``: a lone whole number before the rows is their count. Raises :class:`InputError`, one line, for a
        file without rows of numbers.
        """
        return TextTable.of(read_file(path, missing=missing, most_bytes=most_bytes), str(path), counted=counted)

    @staticmethod
    def of(content: bytes | str, name: str, *, counted: bool = False) -> "TextTable":
        """The table in the ``content`` of the file ``name``; else as :meth:`read`."""
        text = decoded_text(content, name) if isinstance(content, bytes) else content
        lines, separator = _stated_separator(text)
        begin = _first_row(lines)
        count = _announced(lines[begin : begin + 2]) if counted else None
        rows = lines[begin + (count is not None) :]
        if not rows:
            first = f"; line {lines[0].number} begins with {shown(lines[0].text)}" if lines else ""
            raise InputError(f"{name}: has no row of numbers{first}")
        if count not in (None, len(rows)):
            raise InputError(
                f"{name}, line {lines[begin].number}: {count} rows announced, {len(rows)} found; export it again"
            )
        remarks = remarks_above(text, rows[0])
        return TextTable(name, lines[:begin], rows, Dialect.of(rows, name, separator), count, remarks)

    def refuse(self, row: int, column: int | None, fault: str) -> InputError:
        """The error at a row and a column, counted from 0."""
        place = "" if column is None else f", column {column + 1}"
        return InputError(f"{self.name}, line {self.rows[row].number}{place}: {fault}")

    @cached_property
    def cells(self) -> list[list[str]]:
        """Cells of all rows, without trailing columns that are blank throughout."""
        rows = [self.dialect.cells(line, self.name) for line in self.rows]
        width = max(max((place for place, cell in enumerate(row, start=1) if cell), default=0) for row in rows)
        return [row[:width] for row in rows]

    def numbers(
        self, *, used: Sequence[int] | None = None, blank: float | None = None, further: bool = False
    ) -> Float[np.ndarray, "n c"]:
        """Finite numbers of rows of equal length; ``used``: only these columns, in their order, from 0.

        ``blank``: value of an empty or missing cell. ``further``: rows may have any further cells. Raises
        :class:`InputError` with line and column.
        """
        table = self._plain(used) if used is None or further or self._is_even() else None
        if table is None:
            rows = [self._row(place, used, blank, further) for place in range(len(self.rows))]
            table = np.array(rows, dtype=np.float64).reshape(len(rows), -1)
        elif not np.isfinite(table).all():
            row, column = np.argwhere(~np.isfinite(table))[0]
            place = column if used is None else used[column]
            raise self.refuse(row, place, f"{shown(self.cells[row][place])} is not a finite number")
        return table

    def _plain(self, used: Sequence[int] | None) -> Float[np.ndarray, "n c"] | None:
        """The numbers if no cell needs closer inspection, else None."""
        lines = [line.text for line in self.rows]
        if self.dialect.decimal == ",":
            if any("." in line for line in lines):
                return None
            lines = [line.replace(",", ".") for line in lines]
        delimiter = None if self.dialect.separator == " " else self.dialect.separator
        try:
            table: Float[np.ndarray, "n c"] = np.loadtxt(
                lines, comments=None, delimiter=delimiter, ndmin=2, usecols=used
            )
        except ValueError:
            return None
        return table

    def _is_even(self) -> bool:
        """True if all rows have equally many cells, judged by their separators."""
        mark = self.dialect.separator
        counts = (len(line.text.split()) if mark == " " else line.text.count(mark) for line in self.rows)
        return len(set(counts)) == 1

    def _row(self, place: int, used: Sequence[int] | None, blank: float | None, further: bool) -> list[float]:
        cells = self.cells[place]
        width = self.width
        if blank is not None:
            width = self._longest
            cells = cells + [""] * (width - len(cells))
        least = 0 if used is None else max(used) + 1
        if len(cells) < least:
            raise self.refuse(place, None, f"{len(cells)} cells, must be {least} at least{self.advice}")
        if len(cells) != width and not (further and used is not None):
            first = self.rows[0].number
            raise self.refuse(place, None, f"{len(cells)} cells, line {first} has {width}{self.advice}")
        columns = range(width) if used is None else used
        return [blank if blank is not None and not cells[at] else self.number(place, at) for at in columns]

    @cached_property
    def width(self) -> int:
        """Cells of the first row."""
        first = self.dialect.cells(self.rows[0], self.name)
        return len(first if first[-1] else self.cells[0])

    @cached_property
    def _longest(self) -> int:
        return max(map(len, self.cells))

    def number(self, row: int, column: int) -> float:
        """Number in a cell. Raises :class:`InputError` if the cell is not a finite number."""
        try:
            return self.dialect.number(self.cells[row][column])
        except ValueError as error:
            raise self.refuse(row, column, f"{error}{self.advice}") from None

    @property
    def advice(self) -> str:
        """Phrase on how the table was read, to end a message."""
        marks = _MARKS.get(self.dialect.separator, shown(self.dialect.separator))
        decimal = "points" if self.dialect.decimal == "." else "commas"
        return f"; {marks} separate its cells, numbers have decimal {decimal}"

    def grid(self, columns: Sequence[Column], *of: str) -> tuple[list[float], list[float], list[list[float]]]:
        """The values of the first and the second of three columns, rising, and the third by [first, second].

        ``of``: names of both. Raises :class:`InputError` unless each pair has exactly one row.
        """
        table = self.columns(columns)
        (x_nodes, rows), (y_nodes, places) = (np.unique(column, return_inverse=True) for column in table.T[:2])
        pairs = {*zip(rows.tolist(), places.tolist(), strict=True)}
        if not len(pairs) == len(table) == len(x_nodes) * len(y_nodes):
            counts = f"{len(x_nodes)} {of[0]} and {len(y_nodes)} {of[1]}"
            raise InputError(f"{self.name}: {len(table)} rows for {counts}; must be one a pair")
        values = np.empty((len(x_nodes), len(y_nodes)))
        values[rows, places] = table[:, 2]
        return x_nodes.tolist(), y_nodes.tolist(), values.tolist()

    def columns(
        self, wanted: Sequence[Column], *, further: bool = False, read: Sequence[int] = ()
    ) -> Float[np.ndarray, "n k"]:
        """The ``wanted`` columns in their order and units, by the names above the rows, or by place without names.

        NaN in a missing optional one. ``further``: without names there may be more; ``read``: places of columns that
        the caller reads. Raises :class:`InputError` for a missing or repeated column, and for unknown names and units;
        a :class:`FileWarning` names unused columns.
        """
        places = self._by_names(wanted, further, read) or self._by_place(wanted, further)
        if further and self.width > len(wanted):
            self._require_points()
        ragged = further and self.dialect.separator != ","  # where a decimal comma would be one more cell
        numbers = self.numbers(used=[place for place, _ in places.values()], further=ragged)
        table = np.full((len(self.rows), len(wanted)), np.nan)
        for (at, (_, factor)), column in zip(places.items(), numbers.T, strict=True):
            table[:, at] = factor * column
        return table

    def names(self, wanted: Sequence[Column], *, further: bool = False) -> Names | None:
        """The names above the rows, some of which are ``wanted``; None without names."""
        if self.header:
            self._require_words(self.header[-1], header_cells(self.header[-1], self.dialect, self.name))
        heading = Heading(self.name, self.header, self.remarks, self.dialect, self.width)
        return heading.names(wanted, further=further)

    def _by_names(self, wanted: Sequence[Column], further: bool, read: Sequence[int]) -> Places | None:
        names = self.names(wanted, further=further)
        if names is None:
            return None
        places = names.places(wanted)
        names.require(places, wanted)
        if unknown := names.left_over(places, read):
            warnings.warn(f"{names.where}: {unknown}", FileWarning, stacklevel=1)
        return places

    def _by_place(self, wanted: Sequence[Column], further: bool) -> Places:
        by_place = [column for column in wanted if column.by_place]
        least = sum(column.needed for column in by_place)
        width = self.width
        if not least <= width or (width > len(by_place) and not further):
            titles = ", ".join(column.title for column in by_place)
            raise self.refuse(0, None, f"{width} cells, must be {titles}{self.advice}")
        return {at: (at, 1.0) for at in range(min(width, len(by_place)))}

    def _require_points(self) -> None:
        """Refuse commas that may be decimal signs if the number of columns is not known."""
        if self.dialect.separator == "," and not any("." in line.text for line in self.rows):
            advice = "separate the numbers by semicolons, or write decimal points"
            raise self.refuse(0, None, f"commas between numbers and in them cannot be told apart; {advice}")

    def _require_words(self, line: Line, cells: Sequence[str]) -> None:
        """Refuse a damaged first row, which would be lost as a header."""
        texts = [cell for cell in cells if not self._is_number(cell)]
        if len(cells) > len(texts) == 1 and re.search(r"\d", texts[0]):
            column = list(cells).index(texts[0]) + 1
            raise InputError(f"{self.name}, line {line.number}, column {column}: {shown(texts[0])} is no number")

    def _is_number(self, cell: str) -> bool:
        try:
            self.dialect.number(cell)
        except ValueError:
            return False
        return True


def _stated_separator(text: str, *, comments_behind: bool = True) -> tuple[list[Line], str | None]:
    lines = lines_of(text, comments_behind=comments_behind)
    stated = _STATED.match(lines[0].text) if lines else None
    return (lines[1:], stated[1]) if stated else (lines, None)


def _first_row(lines: Sequence[Line]) -> int:
    """Index of the first line that begins with a number, or else of the first with a number after a name."""
    for pattern in (_ROW, _NAMED_ROW):
        for place, line in enumerate(lines):
            if pattern.match(line.text):
                return place
    return len(lines)


def _announced(lines: Sequence[Line]) -> int | None:
    """The whole number that stands alone before several rows."""
    alone = re.fullmatch(r"0*(\d{1,9})", lines[0].text.strip()) if lines else None
    return int(alone[1]) if alone and (len(lines) == 1 or len(re.split(r"[\s;,]+", lines[1].text)) > 1) else None


@dataclass(frozen=True)
class Entry:
    """A row of a list: its non-empty ``cells`` by the titles of their columns."""

    where: str
    cells: Mapping[str, str]
    dialect: Dialect

    def number(self, title: str) -> float | None:
        """The finite number under ``title``; None if there is none. Raises :class:`InputError` for a word."""
        word = self.cells.get(title)
        if word is None:
            return None
        with refused(f"{self.where}, {title}", "…", ValueError):
            return self.dialect.number(word)


def shipped_rows(path: Path, texts: Sequence[str], numbers: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of a table of the package by the names of its columns: ``texts``, and ``numbers`` as such.

    Raises :class:`InputError` for a damaged table.
    """
    columns = [Column((name,), is_text=True) for name in texts] + [Column((name,)) for name in numbers]
    entries = read_list(path, columns, missing="install the package again", most_bytes=MIB)
    return [
        {name: entry.cells[name] for name in texts} | {name: entry.number(name) for name in numbers}
        for entry in entries
    ]


def read_list(path: Path, wanted: Sequence[Column], *, missing: str, most_bytes: int) -> list[Entry]:
    """Entries in the rows below a line of names; ``missing``: the remedy if there is no file.

    Names are texts; a # in a row begins no comment. Raises :class:`InputError` with line and column for columns that
    are missing, repeated or not among the ``wanted``, and for rows of other lengths.
    """
    name = str(path)
    content = read_file(path, missing=missing, most_bytes=most_bytes)
    lines, separator = _stated_separator(decoded_text(content, name), comments_behind=False)
    titles = ", ".join(column.title for column in wanted)
    if len(lines) < 2:
        raise InputError(f"{name}: must have a line of names, of {titles}, and rows below it")
    marks = (separator or "", ";", "\t", ",")
    dialect = Dialect(next((mark for mark in marks if mark and mark in lines[0].text), " "))
    names = Names(name, lines[0], dialect.cells(lines[0], name))
    where = names.where
    cells = names.cells
    places = names.places(wanted)
    wrong = [shown(cell) for place, cell in enumerate(cells) if place not in {at for at, _ in places.values()} and cell]
    wrong += [f"no column {column.title}" for at, column in enumerate(wanted) if column.needed and at not in places]
    if wrong:
        raise InputError(f"{where}: {wrong[0]}; the columns are {titles}")
    rows = [(line, dialect.cells(line, name)) for line in lines[1:]]
    for line, row in rows:
        if len(row) != len(cells):
            raise InputError(f"{name}, line {line.number}: {len(row)} cells, line {lines[0].number} has {len(cells)}")
    numeric = [place for at, (place, _) in places.items() if not wanted[at].is_text]
    signs = dialect.with_signs_of("\n".join(row[place] for _, row in rows for place in numeric), name)
    named = {wanted[at].title: place for at, (place, _) in places.items()}
    return [
        Entry(f"{name}, line {line.number}", {title: row[at] for title, at in named.items() if row[at]}, signs)
        for line, row in rows
    ]
