"""Links lead somewhere, and the site shows every page."""

import re
from pathlib import Path

import pytest
from page_sources import PAGES, ROOT, anchors, links, name_of


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    for file, anchor in links(page):
        copied = file.startswith("notebooks/")  # as the site is built
        target = ROOT / "examples" / file.removeprefix("notebooks/") if copied else page.parent / (file or page.name)
        assert target.exists(), f"{name_of(page)}: {file}"
        if anchor:
            assert anchor in anchors(target), f"{name_of(page)}: {file}#{anchor}"


def test_the_contents_name_every_page_and_every_notebook() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"```\{toctree\}\n(.*?)```", index, flags=re.DOTALL)
    named = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    pages = {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"}
    notebooks = {f"notebooks/{path.stem}" for path in (ROOT / "examples").glob("*.ipynb")}
    assert sorted(named) == sorted(pages | notebooks)
