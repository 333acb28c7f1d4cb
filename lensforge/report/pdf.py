"""A page on paper: HTML to PDF by Chromium, which lays out as the reader's browser does."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from lensforge.errors import InputError
from lensforge.files import replacing

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
_OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--no-pdf-header-footer",
)
_LIMIT_SECONDS = 120.0


def write_pdf(page: Path) -> Path:
    """Print ``page`` into a PDF of the same name beside it, and return its path.

    Raises :class:`InputError` where there is no Chromium, or where it fails.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    instead = f"or open {page} in any browser and print it"
    if browser is None:
        raise InputError(
            f"--pdf: needs Chromium or Chrome, found none of {', '.join(BROWSERS)}; install one, {instead}"
        )
    path = page.with_suffix(".pdf")
    with replacing(path) as temporary, tempfile.TemporaryDirectory(prefix="lensforge-") as profile:
        command = [browser, *_OPTIONS, *_sandbox(), f"--user-data-dir={profile}", f"--print-to-pdf={temporary}"]
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()], capture_output=True, timeout=_LIMIT_SECONDS, check=False
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"--pdf: {browser} took more than {_LIMIT_SECONDS:.0f} s; {instead}") from None
        if done.returncode != 0 or not temporary.exists() or not temporary.read_bytes().startswith(b"%PDF"):
            raise InputError(f"--pdf: {browser} failed (exit code {done.returncode}); {instead}")
    return path


def drop_stale(page: Path) -> None:
    """Remove the PDF of an earlier ``page``: nobody shall send one that shows other numbers."""
    page.with_suffix(".pdf").unlink(missing_ok=True)


def _sandbox() -> tuple[str, ...]:
    """Chromium refuses its own sandbox to root, as in containers; the page is ours."""
    return ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
