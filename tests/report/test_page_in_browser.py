import json
import re
from contextlib import nullcontext
from html import escape

import browser
import pytest
from nightly import NIGHTLY, first_by_day
from part_files import whole_results
from undrawn import without_figures

from lensforge.report.lens_page import render_report

pytestmark = browser.needed

_FRAME = """<!DOCTYPE html><body><iframe {sandbox} width="{width}" height="4000" srcdoc="{page}"></iframe><script>
addEventListener("load", () => {{
  const page = document.querySelector("iframe").contentDocument;
  const pictures = [...page.querySelectorAll("svg, img")];
  const wide = picture => picture.getBoundingClientRect().width > 200;
  const turns = page.querySelector(".turn.live canvas");
  document.title = JSON.stringify({{
    overall: page.documentElement.scrollWidth, pictures: pictures.length, seen: pictures.filter(wide).length,
    turns: turns !== null && wide(turns),
  }});
}});
</script></body>"""

# Turns the lens as a reader would, and notes what the canvas shows after each step.
_PLAY = """<script>
const errors = [];
addEventListener("error", event => errors.push(event.message));
addEventListener("load", () => setTimeout(() => {
  const canvas = document.querySelector(".turn canvas"), gl = canvas.getContext("webgl");
  const size = [canvas.width, canvas.height];
  function shown(act) {
    act();
    const pixels = new Uint8Array(4 * size[0] * size[1]);
    gl.readPixels(0, 0, ...size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let covered = 0, blue = 0, sum = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      if (!pixels[i + 3]) continue;
      covered += 1;
      blue += pixels[i + 2] > pixels[i];
      sum = (sum * 31 + pixels[i] + 256 * (i % 65521)) % 1000000007;
    }
    return [covered / (size[0] * size[1]), covered ? blue / covered : 0, sum];
  }
  const pointer = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type, { clientX: x, clientY: y, buttons: 1 }));
  const drag = () => { pointer("pointerdown", 50, 50); pointer("pointermove", 99, 70); pointer("pointerup", 120, 70); };
  const press = name => document.querySelector(`[data-view="${name}"]`).click();
  const result = {
    first: shown(() => press("first")),
    turned: shown(drag),
    hovered: shown(() => pointer("pointermove", 10, 10)),
    again: shown(() => press("first")),
    key: shown(() => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }))),
    cut: shown(() => press("cut")),
    glError: gl.getError(),
  };
  document.title = JSON.stringify({ ...result, errors });
}, 300));
</script>"""


@pytest.fixture(scope="module")
def markup():
    with nullcontext() if NIGHTLY else without_figures():  # by day those of the lens alone are drawn
        page = render_report(whole_results())
    if "No 3-D picture" in page:
        pytest.skip("no off-screen renderer here")
    return page


@pytest.mark.parametrize(("width", "scripts"), first_by_day(1, [(400, True), (1280, True), (1280, False)], "widths"))
def test_every_picture_is_seen_without_scrolling_sideways(markup, tmp_path, width, scripts):
    sandbox = "" if scripts else 'sandbox="allow-same-origin"'
    frame = tmp_path / "frame.html"
    frame.write_text(_FRAME.format(sandbox=sandbox, width=width, page=escape(markup)), encoding="utf-8")
    document, _ = browser.run(frame, tmp_path)
    answer = json.loads(browser.title(document))
    assert answer["overall"] <= width
    assert answer["pictures"] == markup.count("<svg") + 3
    assert answer["turns"] == scripts
    hidden = 1 if scripts else 0  # the still picture makes room for the lens that turns
    assert answer["seen"] == answer["pictures"] - hidden


def test_the_lens_turns_and_no_script_fails(markup, tmp_path):
    page = tmp_path / "play.html"
    page.write_text(markup.replace("</head>", f"{_PLAY}</head>"), encoding="utf-8")
    document, console = browser.run(page, tmp_path)
    answer = json.loads(browser.title(document))
    assert answer["errors"] == []
    assert [line for line in console if "GL Driver Message" not in line] == []
    assert answer["glError"] == 0
    assert 0.1 < answer["first"][0] < 0.9, "the part stands on a transparent ground"
    assert answer["first"][1] > 0.99, "of glass"
    assert answer["first"] != answer["turned"]
    assert answer["turned"] == answer["hovered"], "it moves only while it is held"
    assert answer["again"] == answer["first"]
    assert answer["key"] != answer["first"]
    assert answer["cut"][1] < 0.5, "the cut has a colour of its own"


def test_on_paper_stands_what_is_read_there(markup, tmp_path):
    page = tmp_path / "printed.html"
    page.write_text(markup, encoding="utf-8")
    with browser.chromium() as started, browser.opened(started, page, 1280, "light") as window:
        window.emulate_media(media="print")
        hidden = window.evaluate(
            """['#numbers', '#spec .unset', '#spec section:has(.unset):not(:has(tr:not(.unset)))',
                '#spec tr:not(.unset)']
            .map(name => [...document.querySelectorAll(name)])
            .map(all => [all.length > 0, all.every(each => getComputedStyle(each).display === 'none')])"""
        )
        assert hidden[:2] == [[True, True]] * 2 and hidden[3] == [True, False]
        assert hidden[2][1], "nor the head of a section in which nothing is set"
        pages = len(re.findall(rb"/Type\s*/Page\b", window.pdf(prefer_css_page_size=True)))
        window.emulate_media(media="screen")
        assert window.evaluate("getComputedStyle(document.querySelector('#numbers')).display") == "block"
    assert 1 < pages <= (16 if NIGHTLY else 10), (
        "with results that no design has by itself, at night with their pictures"
    )
