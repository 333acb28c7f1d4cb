"""TOML files that may come from anywhere, read in bounded time and memory.

Python's reader takes time in proportion to the square of the parts of a dotted name, and 3 seconds for two million
characters outside of texts; so both are counted before.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.json_text import require_flat

_MOST_BYTES = 32 * MIB  # 400,000 rays as a text, parsed in 5 seconds; more belong into a ray file
_MOST_CHARACTERS = 2 * MIB  # without texts and comments: a whole spec has 10,000, one of 512 x 512 numbers 2 million
_MOST_PARTS = 64  # of a dotted name; a spec has three at most
_MOST_SHOWN = 160  # characters of the reader's own message
# Possessive, so that time is in proportion to the length of the text; without an end they match no text at all.
_TEXTS_AND_COMMENTS = re.compile(
    r"""
    \"{3} (?: [^"\\]++ | \\. | "{1,2}+(?!") )*+ "{3,5}+
    | '{3} (?: [^']++ | '{1,2}+(?!') )*+ '{3,5}+
    | " (?: [^"\\\n]++ | \\. )*+ "
    | ' [^'\n]*+ '
    | \# [^\n]*+
    """,
    re.VERBOSE | re.DOTALL,
)
_LONG_NAME = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}")


def read_toml(path: Path, missing: str) -> dict[str, Any]:
    """The tables of a TOML file in UTF-8, with or without a byte-order mark; ``missing``: the remedy where it is not.

    Raises :class:`InputError`, one line, for anything else, and for a file that no spec needs: too large, names of too
    many parts, or nested too deep.
    """
    content = read_file(path, missing=missing, most_bytes=_MOST_BYTES)
    try:
        text = _decoded(content)
        _require_quickly_read(text)
        found = tomllib.loads(text)
        require_flat(found)
    except RecursionError:
        raise InputError(f"{path}: not readable as TOML (nested too deep)") from None
    except ValueError as error:
        problem = " ".join(str(error).split())[:_MOST_SHOWN]
        raise InputError(f"{path}: not readable as TOML ({problem})") from None
    return found


def _decoded(content: bytes) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in content[:4]:
        raise ValueError("it is in UTF-16 or UTF-32; save it as UTF-8")
    return content.decode("utf-8-sig")


def _require_quickly_read(text: str) -> None:
    rest = _TEXTS_AND_COMMENTS.sub("s", text)
    if len(rest) > _MOST_CHARACTERS:
        raise ValueError(
            f"{len(rest)} characters besides texts and comments, at most {_MOST_CHARACTERS} are read; Spec.save writes "
            "large arrays as texts"
        )
    if _LONG_NAME.search(rest):
        raise ValueError(f"a dotted name of more than {_MOST_PARTS} parts")
