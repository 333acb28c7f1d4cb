"""Markdown tables of a page, each under its heading."""

import re
from pathlib import Path
from typing import NamedTuple

Row = tuple[str, ...]


class Table(NamedTuple):
    """A table: the heading above it, its rows without the rule, and whether a script fills it in."""

    heading: str
    rows: tuple[Row, ...]
    filled: bool


def cells(line: str) -> Row:
    return tuple(cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip().strip("|")))


def tables(page: Path) -> list[Table]:
    """All tables of a page, in order."""
    found: list[Table] = []
    heading, lines, filled = "", [], False
    for line in [*page.read_text(encoding="utf-8").splitlines(), ""]:
        if line.startswith("|"):
            lines.append(line)
            continue
        if lines:
            rows = tuple(cells(each) for each in lines if not re.fullmatch(r"[|\-: ]+", each))
            found.append(Table(heading, rows, filled))
            lines = []
        if line.startswith("#"):
            heading = line.lstrip("# ")
        if match := re.fullmatch(r"<!-- (end of )?(.*) -->", line):
            filled = match[1] is None
    return found
