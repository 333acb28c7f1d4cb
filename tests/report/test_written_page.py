import re

import browser
import pytest
from page_text import undrawn_page_of
from result_folders import make_results, page_of

from lensforge.errors import InputError
from lensforge.report.page import write_page, write_pdf
from lensforge.results.files import pdf_mark


@pytest.mark.nightly("a page with every picture, printed")
@browser.needed
def test_the_report_on_paper_is_wide_a4_with_every_picture(tmp_path):
    page, results = tmp_path / "report.html", make_results()
    write_page(page_of(results, tmp_path), page)
    data = write_pdf(page).read_bytes()
    assert data.startswith(b"%PDF")
    sizes = {tuple(map(float, found.split())) for found in re.findall(rb"/MediaBox \[([\d. ]+)\]", data)}
    assert [round(value) for value in sizes.pop()] == [0, 0, 842, 595]
    assert not sizes
    assert len(re.findall(rb"/Type /Page\b", data)) >= 7, "light, lens, manufacture, proof, criteria, search, numbers"
    assert data.count(b"/Subtype /Image") >= 14, "the maps are raster images"
    assert "report.pdf" not in undrawn_page_of(results, tmp_path), "the report is no result"


def test_without_a_browser_one_line_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr("lensforge.report.page.BROWSERS", ("no-such-browser",))
    with pytest.raises(InputError, match=r"needs Chromium.*no-such-browser.*print it") as caught:
        write_pdf(tmp_path / "report.html")
    assert "\n" not in str(caught.value)


def test_a_browser_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    monkeypatch.setattr("lensforge.report.page.BROWSERS", ("false",))
    old = tmp_path / "report.pdf"
    before = b"%PDF of yesterday" + pdf_mark()
    old.write_bytes(before)
    with pytest.raises(InputError, match="exit code 1"):
        write_pdf(tmp_path / "report.html")
    assert old.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["report.pdf"]


def test_a_newer_page_leaves_no_older_pdf(tmp_path):
    (tmp_path / "report.pdf").write_bytes(b"%PDF of yesterday" + pdf_mark())
    (tmp_path / "other.pdf").write_bytes(b"%PDF of something else")
    write_page("<html>today</html>", tmp_path / "report.html")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other.pdf", "report.html"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "<html>today</html>"
