"""Links of the page to the files beside it: each leads to a file that is there."""

from urllib.parse import unquote

import pytest
from page_text import Page, undrawn_page_of
from result_folders import make_folder, make_results
from undrawn import undrawn

from lensforge.errors import InputError
from lensforge.report.exported_part import exported_files, folder_files
from lensforge.report.folder import RunFolder
from lensforge.report.stored import load_results


def links(markup):
    return [each for each in Page(markup).references if not each.startswith(("#", "data:"))]


def test_every_file_of_the_folder_has_a_link_and_no_other_is_named(tmp_path):
    make_folder(tmp_path)
    (tmp_path / "a strange & name #1.csv").write_text("1", encoding="utf-8")
    (tmp_path / "report.html").write_text("the page before", encoding="utf-8")
    found = {unquote(link) for link in links(undrawn_page_of(load_results(tmp_path), tmp_path))}
    assert found == {path.name for path in tmp_path.iterdir()} - {"report.html"}
    purposes = {row.name: row.purpose for row in folder_files(tmp_path, linked=True)}
    assert purposes["lens.step"] == "solid for CAD and CAM" and purposes["lens.json"] == ""
    assert purposes["a strange & name #1.csv"] == "table"


def test_a_page_elsewhere_has_no_links_that_lead_nowhere(tmp_path):
    run = RunFolder(make_folder(tmp_path / "lens")).run
    with undrawn():
        beside, elsewhere = run.report(tmp_path / "lens" / "page.html"), run.report(tmp_path / "page.html")
    assert links(beside.read_text(encoding="utf-8"))
    assert links(elsewhere.read_text(encoding="utf-8")) == []


def test_results_without_a_folder_name_the_files_of_the_export_without_links():
    rows = exported_files(make_results())
    assert {row.name for row in rows} >= {"lens.step", "lens.stl"}
    assert not any(row.link for row in rows)
    assert exported_files(make_results(("design",))) == []


def test_a_file_that_cannot_be_read_is_one_line(tmp_path, monkeypatch):
    make_folder(tmp_path)

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("hashlib.file_digest", refuse)
    with pytest.raises(InputError, match=r"cannot be read \(Permission denied\)"):
        folder_files(tmp_path, linked=False)
