"""Rows of the add-ons in tables of the suite: they stand in ``rows.py`` beside the tests of each, and go with it."""

from functools import cache
from pathlib import Path
from runpy import run_path
from typing import Any


@cache
def _tables() -> tuple[dict[str, Any], ...]:
    return tuple(run_path(str(path)) for path in sorted(Path(__file__).parent.glob("addons/*/rows.py")))


def addon_rows(table: str) -> dict[Any, Any]:
    """The rows of all add-ons in the table of this name."""
    return {key: row for tables in _tables() for key, row in tables.get(table, {}).items()}
