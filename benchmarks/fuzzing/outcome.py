"""What a case may end in: accepted, or refused in one line (a spec: a line for each field). All else is a failure."""

import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import lensforge as lf
from lensforge.errors import LensforgeError, WrongFields

MOST_CHARACTERS = 1000  # of a line that a person still reads
_PACKAGE = str(Path(lf.__file__).parent)


@dataclass(frozen=True)
class Outcome:
    """``state`` of a case. ``message``: the line of a refusal, or what failed. ``place``: where it was raised."""

    state: Literal["accepted", "refused", "failed"]
    message: str = ""
    place: str = ""


def outcome_of(read: Callable[[Path], object], folder: Path) -> Outcome:
    """Read the case in ``folder``; a warning is a failure, but for those that lensforge itself gives on a source."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", lf.SourceWarning)
        found = _read(read, folder)
    if found.state != "failed" and caught:
        first = caught[0]
        place = f"{_short(first.filename)}:{first.lineno}"
        return Outcome("failed", f"{first.category.__name__}: {first.message}", place)
    return found


def _read(read: Callable[[Path], object], folder: Path) -> Outcome:
    try:
        read(folder)
    except LensforgeError as error:
        lines = error.lines if isinstance(error, WrongFields) else (str(error),)
        for line in lines:
            if problem := _problem(line):
                return Outcome("failed", f"{problem}: {line[:200]!r}", _place(error))
        return Outcome("refused", "\n".join(lines))
    except (Exception, SystemExit) as error:
        return Outcome("failed", f"{type(error).__name__}: {str(error)[:200]}", _place(error))
    return Outcome("accepted")


def _problem(line: str) -> str:
    """What is wrong with the line of a refusal; empty where nothing is."""
    if not line.strip():
        return "an empty line"
    if not line.isprintable():  # no control character, no line break, no half of a character
        return "not one printable line"
    if "MemoryError" in line or "Unable to allocate" in line:
        return "out of memory"
    return f"{len(line)} characters" if len(line) >= MOST_CHARACTERS else ""


def _place(error: BaseException) -> str:
    """File, line and function of lensforge in which the error came up."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename.startswith(_PACKAGE)] or frames
    return f"{_short(own[-1].filename)}:{own[-1].lineno} {own[-1].name}" if own else "?"


def _short(file: str) -> str:
    return file.removeprefix(f"{_PACKAGE}/").rpartition("site-packages/")[2]
