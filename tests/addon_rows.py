"""Rows of the add-ons in tables of the suite: they stand in ``rows.py`` beside the tests of each, and go with it."""

import sys
from functools import cache
from pathlib import Path
from runpy import run_path
from typing import Any

import pytest

_FILES = sorted(Path(__file__).parent.glob("addons/*/rows.py"))
sys.path += [str(path.parent) for path in _FILES]


@cache
def _tables() -> tuple[dict[str, Any], ...]:
    return tuple(run_path(str(path)) for path in _FILES)


def addon_rows(table: str) -> dict[Any, Any]:
    """The rows of all add-ons in the table of this name."""
    return {key: row for tables in _tables() for key, row in tables.get(table, {}).items()}


def has_addon(name: str) -> bool:
    """True where the add-on is there."""
    return any(path.parent.name == name for path in _FILES)


def needs_addon(name: str) -> pytest.MarkDecorator:
    """Mark of a test of several things, one of which the add-on makes."""
    return pytest.mark.skipif(not has_addon(name), reason=f"without the add-on {name}")
