"""Bounds on a TOML text, before the standard library parses it.

That reader's time and memory grow with the square of the parts of a dotted name: 40 kB of ``a.a.a`` took 1.6 GB.
"""

import re
import tomllib
from typing import Any

_MOST_CHARACTERS = 1_000_000  # beside texts and comments: 10,000 lines of a hundred; the longest shipped spec has 5,000
_MOST_PARTS = 64
_MOST_LEVELS = 64
# A text without its end goes on to the end of its line, or of the file: each character is looked at once.
_QUOTED = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)' + r"|'''.*?(?:'''|\Z)" + r'|"(?:[^"\\\n]|\\[^\n])*"?' + r"|'[^'\n]*'?|#[^\n]*",
    re.DOTALL,
)
_NAME_OF_MANY = re.compile(rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{_MOST_PARTS},}}")
_BRACKETS = re.compile(r"^[ \t]*+(?:[\w.-]++[ \t]*+=|\[{1,2}[\w. \t-]++\]{1,2}[ \t]*+$)|[\[{]|[\]}]", re.MULTILINE)


def bounded_tables(text: str) -> dict[str, Any]:
    """The tables of a TOML ``text``. Raises ``ValueError``: what is beyond the bounds, or not TOML."""
    bare = _QUOTED.sub(_blanked, text)
    if len(bare) > _MOST_CHARACTERS:
        megabytes = f"{len(bare) / 1e6:.1f} MB beside its texts, must be at most {_MOST_CHARACTERS / 1e6:g} MB"
        raise TooLarge(f"{megabytes}; rays, pictures and tables go into files of their own")
    many = _NAME_OF_MANY.search(bare)
    if many:
        parts = f"a name of {many[0].count('.') + 1} parts, must be at most {_MOST_PARTS}"
        raise TooLarge(f"line {bare.count(chr(10), 0, many.start()) + 1}: {parts}; is it a spec?")
    _require_shallow(bare)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise TooLarge("nested too deep") from None


class TooLarge(ValueError):
    """A text beyond the bounds: no slip of the hand."""


def _blanked(quoted: re.Match[str]) -> str:
    """A text as one character and its line ends, a comment as nothing: names keep their parts, lines their numbers."""
    return "" if quoted[0].startswith("#") else "s" + "\n" * quoted[0].count("\n")


def _require_shallow(bare: str) -> None:
    """Count brackets from one statement to the next: one that is not closed is a slip, which its reader tells."""
    level = 0
    for bracket in _BRACKETS.finditer(bare):
        mark = bracket[0]
        level = level + 1 if mark in ("[", "{") else max(level - 1, 0) if mark in ("]", "}") else 0
        if level > _MOST_LEVELS:
            line = bare.count("\n", 0, bracket.start()) + 1
            raise TooLarge(f"line {line}: nested more than {_MOST_LEVELS} deep, which no field is; is it a spec?")
