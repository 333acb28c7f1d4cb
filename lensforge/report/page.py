"""HTML pages: their templates and pictures, writing a page to its file, and printing it as PDF by Chromium."""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup
from matplotlib.figure import Figure

from lensforge.errors import InputError
from lensforge.results.fact import cells_of, columns_of
from lensforge.results.figure_style import to_svg
from lensforge.results.files import is_free_or_own, pdf_mark, replacing, require_own, temporary_folder
from lensforge.results.sandbox import kill_group

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


@dataclass(frozen=True)
class PagePicture:
    """A figure as SVG, a short title and a caption."""

    svg: str
    title: str
    caption: str


def picture(name: str, figure: Figure, title: str, caption: str = "") -> PagePicture:
    """``figure`` for a page; ``name`` must be unique on the page."""
    return PagePicture(to_svg(figure, name, title), title, caption)


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
    environment.globals.update(columns_of=columns_of, cells_of=cells_of)
    return environment.get_template(name)


def write_page(page: str, path: Path) -> None:
    """Write ``page`` to ``path``, and remove the PDF of an earlier page.

    Raises :class:`InputError` where ``path`` holds a file that this program did not write.
    """
    require_own(path)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    remove_stale_pdf(path)


def write_pdf(page: Path) -> Path:
    """Print ``page`` into a PDF of the same name in its folder, and return its path.

    Raises :class:`InputError` where there is no Chromium, where it fails, and where there is a PDF of another program.
    """
    browser = _browser()
    instead = f"or open {page} in any browser and print it"
    if browser is None:
        raise InputError(
            f"--pdf: needs Chromium or Chrome, found none of {', '.join(BROWSERS)}; install one, {instead}"
        )
    path = page.with_suffix(".pdf")
    require_own(path)
    with replacing(path) as temporary, temporary_folder(path.name) as profile:
        command = [browser, *_OPTIONS, *_sandbox(), f"--user-data-dir={profile}"]
        code = _printed([*command, f"--print-to-pdf={temporary.resolve()}", page.resolve().as_uri()], profile)
        if code is None:
            raise InputError(f"--pdf: {browser} took more than {_LIMIT_SECONDS:.0f} s; {instead}")
        if code != 0 or not temporary.exists() or not temporary.read_bytes().startswith(b"%PDF"):
            raise InputError(f"--pdf: {browser} failed (exit code {code}); {instead}")
        with temporary.open("ab") as file:
            file.write(pdf_mark())
    return path


def _browser() -> str | None:
    """Path of the first of ``BROWSERS``; one in the current folder, which Windows searches first, is not taken."""
    for name in BROWSERS:
        found = shutil.which(name)
        if found is not None and Path(found).is_absolute() and Path(found).parent != Path.cwd():
            return found
    return None


def _printed(command: list[str], folder: Path) -> int | None:
    """Exit code of a browser that works in ``folder``; None where it took too long. Its helpers end with it."""
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(_LIMIT_SECONDS)
    except subprocess.TimeoutExpired:
        return None
    finally:
        kill_group(process)


def remove_stale_pdf(page: Path) -> None:
    """Remove the PDF of an earlier ``page``, whose numbers are outdated; one of another program stays."""
    path = page.with_suffix(".pdf")
    if is_free_or_own(path):
        path.unlink(missing_ok=True)


def _sandbox() -> tuple[str, ...]:
    """Option for root, as in containers, where Chromium's sandbox does not work; the page is our own."""
    return ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()


def _breakable(path: str) -> Markup:
    """A dotted path that may wrap after its dots and underscores, and nowhere else."""
    return Markup("<wbr>").join(re.split(r"(?<=[._])", path))
