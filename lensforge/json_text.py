"""Parsing of JSON that may come from anywhere: no deeper, no larger and no stranger than a record of lensforge."""

import json
from typing import Any

# A history of 10,000 steps with seven constraints has 10^5 values. Each takes up to 250 bytes in memory.
_MOST_VALUES = 4_000_000
_DEEPEST = 64  # levels; a record has at most nine, and what walks through one calls itself for each
_MOST_DIGITS = 40  # of a whole number; conversion of longer ones takes more than linear time


def parse_json(content: bytes) -> Any:
    """The value in the UTF-8 text ``content``. Raises :class:`ValueError`, one line, where it is not JSON.

    NaN and infinity, which are not valid JSON, are refused; so are more than four million values, more than 64 levels
    of tables and lists, and whole numbers of more than 40 digits.
    """
    values = sum(map(content.count, (b",", b"{", b"[")))  # at least as many as there are
    if values > _MOST_VALUES:
        raise ValueError(f"{values} values, at most {_MOST_VALUES} are read")
    try:
        found = json.loads(content.decode("utf-8"), parse_constant=_refuse, parse_int=_whole_number)
    except RecursionError:
        raise ValueError("nested too deep") from None
    require_flat(found)
    return found


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not valid JSON")


def _whole_number(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"a whole number of {len(digits)} digits, at most {_MOST_DIGITS} are read")
    return int(digits)


def require_flat(content: Any) -> None:
    """Raise :class:`ValueError` where tables and lists are nested too deep; a loop: deep ones exhaust the stack."""
    level, depth = [content] if isinstance(content, dict | list) else [], 0
    while level:
        if depth > _DEEPEST:
            raise ValueError(f"nested too deep, more than {_DEEPEST} levels")
        entries = [each.values() if isinstance(each, dict) else each for each in level]
        level = [entry for group in entries for entry in group if isinstance(entry, dict | list)]
        depth += 1
