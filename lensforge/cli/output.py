"""Output that a user asks for: a screen to read, one JSON document with ``--json``, or nothing with ``--quiet``.

The screen is titled blocks of labelled lines; a terminal wraps long ones, a pipe has each whole.
"""

import functools
import json
import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import click

_WIDTH = 80  # columns
_LEAST_WIDTH = 40  # a narrower terminal wraps the lines at its own width
_UNBOUNDED = 1_000_000  # of a pipe, in which programs look for lines
_WIDEST_LABEL = 24

Row = tuple[str, str]  # label and text


@dataclass(frozen=True)
class Output:
    """``json``: stdout is one JSON document. ``quiet``: no progress, and without ``json`` nothing on stdout."""

    json: bool = False
    quiet: bool = False

    @property
    def screen(self) -> bool:
        """True where a person reads stdout."""
        return not (self.json or self.quiet)

    def show(self, content: Callable[[], Mapping[str, object]], blocks: Callable[[], Sequence["Block"]]) -> None:
        """Print ``content`` as one JSON document, or ``blocks`` for a person, or nothing."""
        if self.json:
            print_json(content())
        elif self.screen:
            print_screen(blocks())


_JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON document, with all digits.")
_QUIET = click.option("--quiet", is_flag=True, help="Print nothing but warnings and errors; no progress either.")


def with_output(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--json`` and ``--quiet`` to ``command``, which is called with both as one ``output``."""

    @functools.wraps(command)
    def called(*, as_json: bool, quiet: bool, **options: Any) -> None:
        command(output=Output(as_json, quiet), **options)

    return _JSON(_QUIET(called))


def print_json(content: Mapping[str, object]) -> None:
    """Print one JSON document."""
    click.echo(json.dumps(content, indent=2, allow_nan=False))


@dataclass(frozen=True)
class Block:
    """A title, below it lines of a ``table``, which are not wrapped, and labelled lines."""

    title: str
    rows: Sequence[Row] = ()
    table: Sequence[str] = ()


def print_screen(blocks: Sequence[Block], width: int | None = None) -> None:
    """Print ``blocks``, their texts in one column, lines wrapped at ``width``; None: as wide as the terminal is."""
    width = _width() if width is None else width
    shown = click.HelpFormatter(width=width)
    labels = [printable(label) for block in blocks for label, _ in block.rows]
    widest = min(max(map(len, labels), default=0), _WIDEST_LABEL)
    for block in blocks:
        title = textwrap.fill(_line(block.title), width, break_long_words=False, break_on_hyphens=False)
        shown.write(f"{title}\n")  # a path in it is never broken, so that it can be copied
        shown.write("".join(f"  {printable(line)}\n" for line in block.table))
        if block.rows:
            with shown.indentation():
                rows = [(_line(label).ljust(widest), _line(text)) for label, text in block.rows]
                shown.write_dl(rows, col_max=widest)
    click.echo(shown.getvalue().rstrip("\n"))


def _width() -> int:
    if sys.stdout is None or not sys.stdout.isatty():  # None: closed by the shell
        return _UNBOUNDED
    return max(min(shutil.get_terminal_size().columns, _WIDTH), _LEAST_WIDTH)


def _line(text: str) -> str:
    """``text`` as one line, with plain spaces in the place of the thin ones of a page."""
    return printable(" ".join(text.split()))


def warning_line(message: str) -> str:
    """A warning as one line."""
    return f"warning: {_line(message)}"


def printable(text: str) -> str:
    """``text`` with escapes for characters that steer a terminal: names in a file may come from anywhere."""
    return "".join(
        character if character.isprintable() or character == "\t" else ascii(character)[1:-1] for character in text
    )
