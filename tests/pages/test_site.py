"""The site builds without a warning: no broken link, no name that the library has not."""

import subprocess
import sys
from pathlib import Path

import pytest
from page_sources import ROOT

# Without the search for garbage, which goes through all pages again and again: a third of the time.
_BUILD = "import gc, sys; gc.disable(); from sphinx.cmd.build import main; sys.exit(main())"
# Without the library's names in the navigation, which each page copies: it says nothing of links and names.
_OPTIONS = ("-W", "--keep-going", "-n", "-q", "-D", "toc_object_entries=0")


@pytest.mark.nightly("half a minute")
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _BUILD, *_OPTIONS, "-d", tmp_path / "trees", "docs", tmp_path / "site"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, encoding="utf-8")
    assert run.returncode == 0, run.stderr[-4000:]
    page = (tmp_path / "site" / "api.html").read_text(encoding="utf-8")
    assert 'id="lensforge.tolerance"' in page
    assert (tmp_path / "site" / "notebooks" / "first_light.html").is_file()
    theory = (tmp_path / "site" / "theory.html").read_text(encoding="utf-8")
    assert "<math" in theory and "\\frac" not in theory
