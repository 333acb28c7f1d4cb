"""The report in a browser: short enough to be read, on a screen and on a telephone, in light and dark, by everybody."""

import browser
import pytest
from axe_playwright_python.sync_playwright import Axe
from drawn_page import whole_page_results
from nightly import NIGHTLY, first_by_day

from lensforge.report.lens_page import render_report

pytestmark = browser.needed

HIGHEST = {
    1280: 6600,
    400: 13_000,
}  # pixels, before anything is unfolded; a section more since the yield is on the page
# Of a picture its name counts, for whoever does not see it; its lines and labels are many thousands.
DRAWN = {"exclude": [["svg[role=img] > g"]]}
# Rows of one table with the same markup look alike: one of them stands for all.
FEWER_ROWS = """document.querySelectorAll('tbody').forEach(body => {
  const seen = new Set();
  for (const row of [...body.rows]) {
    const markup = row.outerHTML.replace(/>[^<]*</g, '><').replace(/(href|id|title|aria-label)="[^"]*"/g, '');
    seen.has(markup) ? row.remove() : seen.add(markup);
  }
})"""
UNFOLD = "document.querySelectorAll('details').forEach(each => each.open = true)"


@pytest.fixture(scope="module")
def page(tmp_path_factory, drawn_page):
    """A page with every section; by night with its three-dimensional views, which take three seconds."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(render_report(whole_page_results()) if NIGHTLY else drawn_page.markup, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def started():
    with browser.chromium() as chromium:
        yield chromium


def test_the_page_can_be_sent_by_mail(page):
    assert page.stat().st_size <= 2_000_000


@pytest.mark.parametrize("width", first_by_day(1, HIGHEST, "another width"))
def test_the_page_is_short_until_it_is_unfolded(started, page, width):
    with browser.opened(started, page, width, "light") as window:
        assert window.evaluate("document.documentElement.scrollHeight") <= HIGHEST[width]
        assert window.evaluate("document.documentElement.scrollWidth") <= width
        window.evaluate(UNFOLD)
        assert window.evaluate("document.documentElement.scrollHeight") > HIGHEST[width], "all of it is there"


@pytest.mark.parametrize(
    ("width", "scheme"), first_by_day(1, [(1280, "light"), (400, "dark"), (400, "light"), (1280, "dark")])
)
def test_axe_finds_nothing_against_the_page(started, page, width, scheme):
    """Contrast, order of headings, names of tables and pictures, reach by the keyboard; folded, then unfolded.

    Each width and each scheme by day: no rule of the page's style asks for both.
    """
    with browser.opened(started, page, width, scheme) as window:
        window.evaluate(FEWER_ROWS)
        for unfold in ("", UNFOLD):
            window.evaluate(unfold)
            violations = Axe().run(window, DRAWN, {"resultTypes": ["violations"]}).response["violations"]
            assert {violation["id"]: [node["target"] for node in violation["nodes"]] for violation in violations} == {}


def test_links_lead_to_sections_of_the_folded_page(started, page):
    with browser.opened(started, page, 1280, "light") as window:
        window.evaluate("location.hash = '#search'")
        assert window.evaluate("document.querySelector('#search').getBoundingClientRect().top") < 900
        assert window.evaluate("document.querySelectorAll('details[open]').length") == 0
