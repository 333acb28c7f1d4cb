"""Tests that take longer than the suite has: left out by day, run where LENSFORGE_FUZZ is above 1.

``@pytest.mark.nightly("two minutes")`` marks a test, or a case of one as ``pytest.param(..., marks=...)``.
"""

import os
from collections.abc import Iterable
from typing import Any

import pytest

FACTOR = int(os.environ.get("LENSFORGE_FUZZ", "1"))
NIGHTLY = FACTOR > 1


def scaled(count: int, *, by_day: int | None = None) -> int:
    """As many random cases as the run asks for: ``count`` times LENSFORGE_FUZZ; fewer ``by_day``."""
    return count * FACTOR if NIGHTLY or by_day is None else by_day


def first_by_day(count: int, cases: Iterable[Any], reason: str = "more cases of the same") -> list[Any]:
    """Cases for ``parametrize``, of which only the first ``count`` run by day."""
    marked = pytest.mark.nightly(reason)
    every = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*case, marks=marked if index >= count else ()) for index, case in enumerate(every)]


def leave_out_by_day(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the marked tests, unless they are asked for: a skip says that this machine lacks something."""
    if NIGHTLY:
        return
    marked = [item for item in items if item.get_closest_marker("nightly")]
    config.hook.pytest_deselected(items=marked)
    items[:] = [item for item in items if not item.get_closest_marker("nightly")]
