"""Links of the page to the files beside it: each leads to a file that is there."""

import os
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
    return [reference for reference in Page(markup).references if not reference.startswith(("#", "data:"))]


def test_every_file_of_the_folder_has_a_link_and_no_other_is_named(tmp_path):
    make_folder(tmp_path)
    (tmp_path / "a strange & name #1.csv").write_text("1", encoding="utf-8")
    (tmp_path / "report.html").write_text("the page before", encoding="utf-8")
    names = {unquote(link) for link in links(undrawn_page_of(load_results(tmp_path), tmp_path))}
    assert names == {path.name for path in tmp_path.iterdir()} - {"report.html"}
    purposes = {row.name: row.purpose for row in folder_files(tmp_path, (), linked=True)}
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
        folder_files(tmp_path, ["lens.json"], linked=False)


def test_only_own_files_are_read_and_no_link_is_followed(tmp_path):
    """A sparse file of 8 TiB, a pipe, a link to another folder's file, and a name that is no text."""
    secret, folder = tmp_path / "secret", tmp_path / "run"
    secret.write_bytes(b"12345")
    folder.mkdir()
    (folder / "lens.json").write_bytes(b"{}")
    with (folder / "own.dat").open("wb") as sparse:
        sparse.truncate(2**43)
    for name in ("x", "run.json"):
        (folder / name).symlink_to(secret)
    os.mkfifo(folder / "pipe.json")
    (folder / "check.json").mkdir()
    (folder / os.fsdecode(b"\xff.csv")).write_bytes(b"1")
    rows = {row.name: row for row in folder_files(folder, ["lens.json", "run.json", "check.json", "pipe.json"], True)}
    assert rows["lens.json"].sha256 == "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"
    assert rows["own.dat"].sha256 == "" and rows["own.dat"].size.endswith("MB")
    assert all(
        (rows[name].size, rows[name].sha256, rows[name].link) == ("a link", "", "") for name in ("x", "run.json")
    )
    assert rows["\N{REPLACEMENT CHARACTER}.csv"].link == "%FF.csv"
    assert set(rows) == {"lens.json", "run.json", "own.dat", "x", "\N{REPLACEMENT CHARACTER}.csv"}


def test_a_folder_of_very_many_files_lists_its_own_and_the_first_others(tmp_path):
    for number in range(230):
        (tmp_path / f"a{number:03}.csv").touch()
    (tmp_path / "lens.json").touch()
    names = [row.name for row in folder_files(tmp_path, ["lens.json"], linked=False)]
    assert names == [*(f"a{number:03}.csv" for number in range(199)), "lens.json", "further files"]
