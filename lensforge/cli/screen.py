"""The screen on stdout: titled blocks of labelled lines; a terminal wraps long ones, a pipe has each whole."""

import shutil
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import click

from lensforge.cli.printing import printable

_WIDTH, _LEAST_WIDTH = 80, 40  # columns; a narrower terminal wraps the lines at its own width
_UNBOUNDED = 1_000_000  # of a pipe, in which programs look for lines
_WIDEST_LABEL = 24

Row = tuple[str, str]  # label and text


@dataclass(frozen=True)
class Block:
    """A title, and labelled lines below it."""

    title: str
    rows: Sequence[Row] = ()


def print_screen(blocks: Sequence[Block]) -> None:
    """Print ``blocks``, their texts in one column, long lines wrapped on a terminal."""
    shown = click.HelpFormatter(width=_width())
    labels = [printable(label) for block in blocks for label, _ in block.rows]
    widest = min(max(map(len, labels), default=0), _WIDEST_LABEL)
    for block in blocks:
        shown.write(f"{_wrapped(block.title)}\n")
        if block.rows:
            with shown.indentation():
                rows = [(_line(label).ljust(widest), _line(text)) for label, text in block.rows]
                shown.write_dl(rows, col_max=widest)
    click.echo(shown.getvalue().rstrip("\n"))


def _width() -> int:
    if sys.stdout is None or not sys.stdout.isatty():  # None: closed by the shell
        return _UNBOUNDED
    return max(min(shutil.get_terminal_size().columns, _WIDTH), _LEAST_WIDTH)


def _wrapped(title: str) -> str:
    """``title`` at the screen's width; a path in it is never broken, so that it can be copied."""
    return textwrap.fill(_line(title), _width(), break_long_words=False, break_on_hyphens=False)


def _line(text: str) -> str:
    """``text`` as one line, with plain spaces in the place of the thin ones of a page."""
    return printable(" ".join(text.split()))
