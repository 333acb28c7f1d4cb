"""Text of a table as programs write it: its characters, its lines, its separators, and its notation of numbers.

A semicolon or a tab separates wherever there is one: commas in numbers are then decimal signs. So they are where blanks
separate and no blank stands beside a comma; elsewhere commas separate. A mark before three digits may be one of
thousands: it is taken for that only where another number of the table proves it (1,234.5), and refused beside numbers
that have the other decimal sign. A first line ``sep=;`` decides, as in Excel.
"""

import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from lensforge.errors import FileWarning, InputError

_LINE_END = re.compile(r"\r\n|\r|\n")  # those that an editor counts: no form feed, no U+2028
_CONTROL = re.compile(r"[\0-\x08\x0b\x0c\x0e-\x1f\x7f\x85\u2028\u2029]")  # Python takes some of them for blanks
_COMMENT = re.compile(r"(?:^|\s)#.*")
_PADDING = "\0\x1a \n\r"  # behind the last line in files of old programs
_SAMPLE = 2**12  # bytes that tell UTF-16 without a mark
_NUL_SHARE = 0.8  # at least, of every second byte in UTF-16 of mostly ASCII; other encodings have NULs as padding only
_SHOWN = 24  # characters of a cell in a message


class Line(NamedTuple):
    """A line that is neither empty nor a comment, and its ``number`` in the file, from 1."""

    number: int
    text: str


def decoded_text(content: bytes, name: str) -> str:
    """Text of the file ``name``: UTF-8 or UTF-16, with or without a byte-order mark, else Windows-1252.

    Raises :class:`InputError` for bytes that are no text.
    """
    text = decoded(content).rstrip(_PADDING)
    strange = _CONTROL.search(text)
    if strange:
        line = len(_LINE_END.findall(text, 0, strange.start())) + 1
        byte = f"the character {ord(strange[0]):02x} hex"
        raise InputError(f"{name}, line {line}: not a text file: it has {byte}; export it as text or CSV")
    return text


def decoded(content: bytes) -> str:
    """Text of a file in UTF-8 or UTF-16, with a byte-order mark or without, else in Windows-1252 or Latin-1."""
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, "replace")
    head = content[:_SAMPLE]
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if _NUL_SHARE * len(zeros) < zeros.count(0) > 0.5 * head.count(0):
            return content.decode(encoding, "replace")
    for encoding in ("utf-8", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    return content.decode("latin-1")


def lines_of(text: str, *, comments_behind: bool = True) -> list[Line]:
    """Non-empty lines without comments: lines that begin with #, and text after a # behind a blank.

    ``comments_behind``: also drop the latter; names may contain such a mark.
    """
    lines = []
    for number, line in enumerate(_LINE_END.split(text), start=1):
        if "#" in line and (comments_behind or line.lstrip().startswith("#")):
            line = _COMMENT.sub("", line)
        if line.strip('\t;," '):  # a spreadsheet writes its empty rows as marks alone
            lines.append(Line(number, line.strip(" ")))
    return lines


def remarks_above(text: str, row: Line) -> list[Line]:
    """Lines above ``row`` that begin with #, without the mark: they may hold names of columns."""
    above = _LINE_END.split(text, row.number - 1)[: row.number - 1]
    remarks = ((number, line.strip()) for number, line in enumerate(above, start=1))
    return [
        Line(number, line.lstrip("# \t")) for number, line in remarks if line.startswith("#") and line.strip("# \t")
    ]


# Numbers that tell what a mark in them is, by that mark (m) and the other one (o); behind them no part of a number.
_BEFORE = r"(?<![\w.,])"
_BEHIND = r"(?![\d.,])"
_GROUPS = _BEFORE + r"[-+]?[1-9]\d{0,2}(?:m\d{3})"
_DECIMAL = (
    rf"(?:{_BEFORE}[-+]?(?:\d*m(?:\d\d?|\d{{4,}})|(?:0\d*|\d{{4,}})?m\d{{3}}|\d+m){_BEHIND}"
    rf"|{_BEFORE}[-+]?\d+m\d+[eE])"
)
_THOUSANDS = rf"(?:{_GROUPS}{{2,}}{_BEHIND}|{_GROUPS}+o\d)"
_EITHER = rf"{_GROUPS}(?![\d.,eE])"


def _has(pattern: str, mark: str, text: str) -> bool:
    separator = "," if mark == "." else "."
    if mark not in text or (pattern == _THOUSANDS and not re.search(rf"{re.escape(mark)}\d\d\d[.,]", text)):
        return False  # a tenth of the time
    return re.search(pattern.replace("m", re.escape(mark)).replace("o", re.escape(separator)), text) is not None


_LETTERS = str.maketrans({"−": "-", "\xa0": " ", "\u202f": " ", "\u2009": " ", "’": "'"})
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?", re.ASCII)
_SPACED = re.compile(r"(?<![\d.,])\d{1,3}(?:([ '])\d{3})(?:\1\d{3})*(?!\d)", re.ASCII)
_QUOTED = re.compile(r'"[^"\n]*"')


@dataclass(frozen=True)
class Dialect:
    """Separator of cells, and notation of numbers.

    ``separator``: ";", "\t", "," or " " for any blanks. ``thousands``: numbers have such marks, the comma or the point
    that is not the decimal sign.
    """

    separator: str
    decimal: str = "."
    thousands: bool = False

    @staticmethod
    def of(rows: Sequence[Line], name: str, separator: str | None = None) -> "Dialect":
        """The dialect of ``rows`` of numbers; ``separator``: as stated in the file.

        Raises :class:`InputError` if it cannot be determined. A :class:`FileWarning` tells of ambiguous numbers.
        """
        text = "\n".join(line.text for line in rows)
        dialect = Dialect(separator or _separator(rows, _QUOTED.sub('""', text) if '"' in text else text, name))
        if "," not in text:
            return dialect
        if dialect.separator == ",":
            if '"' not in text:
                _doubt_commas(rows, text, name)
                return dialect
            text = "\n".join(";".join(dialect.cells(line, name)) for line in rows)
        return dialect.with_signs_of(text, name)

    def with_signs_of(self, text: str, name: str) -> "Dialect":
        """This dialect with the decimal sign of the numbers in ``text``."""
        comma, point = (_has(_DECIMAL, mark, text) for mark in ",.")
        after_comma, after_point = (_has(_THOUSANDS, mark, text) for mark in ".,")  # a mark of thousands before it
        if point or after_point:
            return Dialect(self.separator, ".", after_point)
        if comma or after_comma:
            return Dialect(self.separator, ",", after_comma)
        if not _has(_EITHER, ",", text) or _has(_EITHER, ".", text):
            return self
        warnings.warn(
            f"{name}: every comma stands before three digits: taken as a decimal sign, not as a mark of thousands",
            FileWarning,
            stacklevel=1,
        )
        return Dialect(self.separator, ",")

    def cells(self, line: Line, name: str) -> list[str]:
        """Cells of a line, without the blanks and quotation marks around them."""
        if self.separator == " " and '"' not in line.text:
            return line.text.split()
        text = re.sub(r"\s+", " ", line.text) if self.separator == " " else line.text
        where = f"{name}, line {line.number}"
        if text.count('"') % 2:
            raise InputError(f"{where}: a quotation mark that is not closed; export it again")
        try:
            (cells,) = csv.reader([text], delimiter=self.separator, skipinitialspace=True)
        except (csv.Error, ValueError):
            raise InputError(f"{where}: too long a cell, or a line end in it; export it again") from None
        return [cell.strip() for cell in cells]

    def number(self, word: str) -> float:
        """The finite number that a cell holds. Raises :class:`ValueError`, with the reason."""
        plain = word.translate(_LETTERS)
        plain = _SPACED.sub(lambda match: match[0].replace(match[1], ""), plain)
        mark = "." if self.decimal == "," else ","
        if mark in plain and self.thousands and re.fullmatch(_grouped(mark), plain):
            plain = plain.replace(mark, "")
        elif mark in plain and re.fullmatch(r"[-+\d.,]+", plain):
            sign = "points" if self.decimal == "." else "commas"
            raise ValueError(f"{shown(word)} beside numbers with decimal {sign}: use one sign, no marks of thousands")
        plain = plain.replace(self.decimal, ".")
        if not _NUMBER.fullmatch(plain):
            raise ValueError(f"{shown(word)} is no number" if word else "no number")
        number = float(plain.replace("d", "e").replace("D", "E"))
        if not isfinite(number):
            raise ValueError(f"{shown(word)} is not a finite number")
        return number


def number_in(word: str) -> float:
    """The number in a word of a file, with exponent E, or D as in Fortran; also infinite and NaN.

    Raises :class:`ValueError` for forms that only Python accepts.
    """
    if "_" in word or not word.isascii():
        raise ValueError(f"{shown(word)} is no number")
    return float(word.replace("d", "e").replace("D", "E"))


def _grouped(mark: str) -> str:
    """Pattern of a number with ``mark`` for thousands, and possibly the other as decimal sign."""
    return rf"[-+]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+(?:[.,]\d*)?"


def shown(word: str) -> str:
    """A cell in quotes for a message: short, and printable."""
    return repr("".join(mark if mark.isprintable() else "?" for mark in word[:_SHOWN]))


def _separator(rows: Sequence[Line], text: str, name: str) -> str:
    """Separator of ``rows``, determined from their ``text`` without quoted parts."""
    if ";" in text:
        return ";"
    if "\t" in text and not re.search(r",[ \t]*\t|\t[ \t]*,", text):
        return "\t"
    if "," not in text:
        return " "
    padded = any(mark in text for mark in (", ", ",\t", " ,", "\t,"))
    blanks = (" " in text or "\t" in text) and re.search(r"[^\s,][ \t]+[^\s,]", text)
    if blanks and not padded:
        return " "
    if padded and "." not in text and re.search(r"\d,\d", text):
        number = _first_with(r"\d,\d", rows)
        fault = "commas with blanks beside them and without; separate its numbers by semicolons"
        raise InputError(f"{name}, line {number}: {fault}")
    return ","


def _first_with(pattern: str, rows: Sequence[Line]) -> int:
    return next((line.number for line in rows if re.search(pattern, line.text)), rows[0].number)


_LEADING_ZERO = r"(?m)(?:^|,)[ \t]*([-+]?\d+,0\d+)(?=,|\s|$)"


def _doubt_commas(rows: Sequence[Line], text: str, name: str) -> None:
    """Refuse commas that seem to be both separators and decimal signs (0,05,0,1); warn if they may be."""
    match = None if "." in text else re.search(_LEADING_ZERO, text)
    if match:
        raise InputError(
            f"{name}, line {_first_with(_LEADING_ZERO, rows)}: {shown(match[1])}: commas between numbers and in them "
            "cannot be told apart; separate the numbers by semicolons"
        )
    pairs = "." not in text and all(line.count(",") % 2 for line in text.split("\n"))
    cells = [cell.strip() for cell in text.replace("\n", ",").split(",")] if pairs else []
    if pairs and set(cells[::2]) <= {"0", "1"} and not set(cells[1::2]) <= {"0", "1"}:
        doubt = "its commas are taken to separate numbers; separate numbers with decimal commas by semicolons"
        warnings.warn(f"{name}: no number has a decimal point: {doubt}", FileWarning, stacklevel=1)
