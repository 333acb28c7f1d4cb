"""A real browser without a window: what a page says of itself there, and what goes wrong in it."""

import re
import shutil
import subprocess
from contextlib import contextmanager

import pytest
from playwright.sync_api import sync_playwright

PATH = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needed = pytest.mark.skipif(PATH is None, reason="no Chromium here")
_QUIET = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run")
_OPTIONS = (
    "--headless", "--no-sandbox", "--disable-background-networking", "--no-first-run", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--enable-logging=stderr", "--virtual-time-budget=3000", "--dump-dom",
)  # fmt: skip


def run(page, folder):
    """(document as the browser leaves it, what its console says) of the file ``page``."""
    command = [PATH, *_OPTIONS, f"--user-data-dir={folder / 'profile'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=120, check=True)
    return done.stdout, re.findall(r"CONSOLE\S*\] (.*)", done.stderr)


def title(document):
    return re.search(r"<title>(.*?)</title>", document, re.DOTALL)[1]


@contextmanager
def chromium():
    """A running browser, to open pages in; its profile is empty."""
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=PATH, args=list(_QUIET))
        try:
            yield started
        finally:
            started.close()


@contextmanager
def opened(started, page, width, scheme):
    """The file ``page`` in a window ``width`` pixels wide, in the colours of ``scheme``: "light" or "dark"."""
    window = started.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    try:
        window.goto(page.as_uri())
        yield window
    finally:
        window.close()
