"""The crooked designs, each run through every stage once for all tests."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from made_once import made_once


@pytest.fixture(scope="session")
def case(shared: Path) -> Callable[[str], "object"]:
    """The case of a design by its name."""
    from crooked import made

    @cache
    def case_of(name: str) -> object:
        return made_once(shared / f"crooked_{name}", lambda folder: made(name, folder))

    return case_of
