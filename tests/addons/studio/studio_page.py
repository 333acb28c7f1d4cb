"""The page of the studio in a browser: how tests wait for it, and read it."""

import re
import time
from contextlib import contextmanager

import lensforge as lf

PATIENCE_S = 240.0


@contextmanager
def studio_on(text, folder):
    """A studio on the spec of ``text``, which it may save."""
    (folder / "studio.toml").write_text(text, encoding="utf-8")
    opened = lf.studio(folder, browser=False)
    yield opened
    opened.close()


@contextmanager
def page_of(studio, started):
    """The page of ``studio``, ready; no script on it may fail, nor anything be asked of another machine."""
    context = started.new_context(viewport={"width": 1500, "height": 950}, accept_downloads=True)
    page = context.new_page()
    wrong = []
    elsewhere = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "request", lambda asked: asked.url.startswith(("http://127.0.0.1:", "data:")) or elsewhere.append(asked.url)
    )
    page.goto(studio.address)
    page.wait_for_selector("body[data-ready]")
    yield page
    context.close()
    assert (wrong, elsewhere) == ([], [])


def until(condition, seconds=PATIENCE_S):
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < end, "it did not come to be"
        time.sleep(0.1)
    return value


def phase(window, name):
    window.wait_for_selector(f"body[data-phase={name}]", timeout=1000 * PATIENCE_S)


def pixels(window, canvas="own"):
    return window.evaluate(f"document.getElementById('{canvas}').toDataURL()")


def step(window):
    match = re.search(r"step (\d+) of", window.inner_text("#progress"))
    return int(match[1]) if match else 0
