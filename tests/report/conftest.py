"""The page that many tests look at."""

from pathlib import Path

import pytest
from made_once import made_once


@pytest.fixture(scope="session")
def drawn_page(shared: Path):
    """The page with every section, as :class:`drawn_page.DrawnPage`."""
    from drawn_page import draw_page, whole_page_results  # not before the import hook is there

    return made_once(shared / "drawn_page", lambda _: draw_page(whole_page_results()))
