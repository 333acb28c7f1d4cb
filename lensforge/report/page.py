"""HTML pages: their templates, writing a page to its file, and printing it as PDF by Chromium."""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from lensforge.errors import InputError
from lensforge.files import replacing

_TEMPLATES = Path(__file__).with_name("templates")
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
_OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--no-pdf-header-footer",
)
_LIMIT_SECONDS = 120.0


def template(name: str) -> Template:
    """The template ``name``; text is escaped, and a variable without a value is an error."""
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _breakable
    return environment.get_template(name)


def write_page(page: str, path: Path) -> None:
    """Write ``page`` to ``path``, and remove the PDF of an earlier page."""
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    remove_stale_pdf(path)


def write_pdf(page: Path) -> Path:
    """Print ``page`` into a PDF of the same name in its folder, and return its path.

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


def remove_stale_pdf(page: Path) -> None:
    """Remove the PDF of an earlier ``page``, whose numbers are outdated."""
    page.with_suffix(".pdf").unlink(missing_ok=True)


def _sandbox() -> tuple[str, ...]:
    """Option for root, as in containers, where Chromium's sandbox does not work; the page is our own."""
    return ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()


def _breakable(path: str) -> Markup:
    """A dotted path that may wrap after its dots and underscores, and nowhere else."""
    return Markup("<wbr>").join(re.split(r"(?<=[._])", path))
