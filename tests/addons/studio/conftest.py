"""A browser for the tests of a file, and the page of its studio."""

import browser
import pytest
from studio_page import page_of


@pytest.fixture(scope="module")
def started():
    with browser.chromium() as running:
        yield running


@pytest.fixture
def window(studio, started):
    with page_of(studio, started) as page:
        yield page
