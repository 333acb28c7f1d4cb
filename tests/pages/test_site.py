"""The site builds without a warning: no broken link, no name that the library has not."""

import subprocess
import sys
from pathlib import Path

from page_sources import ROOT


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q"]
    run = subprocess.run(
        [*command, "-d", tmp_path / "trees", "docs", tmp_path / "site"], cwd=ROOT, capture_output=True, encoding="utf-8"
    )
    assert run.returncode == 0, run.stderr[-4000:]
    page = (tmp_path / "site" / "api.html").read_text(encoding="utf-8")
    assert 'id="lensforge.tolerance"' in page
    assert (tmp_path / "site" / "notebooks" / "first_light.html").is_file()
    theory = (tmp_path / "site" / "theory.html").read_text(encoding="utf-8")
    assert "<math" in theory and "\\frac" not in theory
