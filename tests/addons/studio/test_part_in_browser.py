"""The part in the studio, in a real browser: made, downloaded, compared, replaced and cured; of a small lens."""

import re
import shutil

import browser
import pytest
from studio_page import phase, step, studio_on, until

import lensforge as lf
from lensforge.report.folder import load, opened

pytestmark = browser.needed
SPEC = """\
name = "small"

[source]
kind = "square"
side_mm = 1.0
flux_w = 1.0

[lens]
levels = [9, 25]

[lens.inner]
offset_mm = 3.0

[lens.outer]
offset_mm = 6.0

[constraints]
cavity_height_mm = 0.5
cavity_radius_mm = 1.0
min_thickness_mm = 1.0
max_radius_mm = 7.0

[target]
kind = "flat_top"
width_mm = 160.0
distance_mm = 100.0
receiver_mm = 200.0

[optimise]
steps_per_level = [40, 4000]
rays = 1024
pixels = 16

[evaluate]
rays = 4096
pixels = 16

[manufacture]
required = false
"""


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A studio on a small spec, which its search leaves unfinished: a test stops it."""
    with studio_on(SPEC, tmp_path_factory.mktemp("studio")) as running:
        yield running


def test_a_part_is_made_and_its_step_downloaded(studio, window, tmp_path):
    window.select_option("#accuracy", "draft")
    window.click("#search")
    until(lambda: step(window) > 60)
    window.click("#enough")
    phase(window, "idle")
    until(lambda: window.is_enabled("#part"), 20.0)
    window.click("#part")
    phase(window, "making")
    phase(window, "idle")
    until(lambda: "lens.step" in window.inner_text("#files"), 20.0)
    href = window.get_attribute("#files a:has-text('lens.step')", "href")
    got = window.request.get(href)
    assert got.ok and got.body() == (studio.folder / "lens.step").read_bytes()
    assert got.body() == lf.build(load(studio.folder).lens).step, "the bits of the command"
    assert {"report.html", "manufacturing.pdf", "drawing.dxf", "lens.ies"} <= set(
        window.inner_text("#files").split("\n")
    )
    shutil.copytree(studio.folder, studio.folder.parent / "other")
    window.reload()
    until(lambda: "other" in window.inner_text("#others"), 20.0)
    window.select_option("#others", "other")
    until(lambda: window.is_visible("#beside-figure") and "other" in window.inner_text("#facts"), 60.0)
    window.reload()
    until(lambda: window.is_visible("#beside-figure") and window.input_value("#others") == "other", 60.0)


def test_a_finished_lens_is_replaced_when_asked_and_what_is_left_of_it_has_a_mark(studio, started):
    folder = studio.folder.parent / "other"
    kept, asked = (folder / "lens.json").read_bytes(), list[str]()
    here = lf.studio(folder, browser=False)
    page = started.new_page()
    page.on("dialog", lambda dialog: (asked.append(dialog.message), dialog.accept() if asked[1:] else dialog.dismiss()))
    try:
        page.goto(here.address)
        page.wait_for_selector("body[data-ready]")
        until(lambda: "peak" in page.inner_text("#own-readout"), 60.0)
        assert "of the lens before" not in page.inner_text("#files")
        lumens = page.input_value("#text").replace("[source]\n", "[source]\nflux_lm = 100.0\n")
        page.fill("#text", re.sub(r"flux_w = .*\n", "", lumens))
        until(lambda: page.input_value("#f-source-flux_lm") == "100", 20.0)
        page.click("#search")
        assert "other holds a finished lens" in asked[0] and (folder / "lens.json").read_bytes() == kept
        assert page.get_attribute("body", "data-phase") == "idle"
        page.click("#search")
        phase(page, "searching")
        until(lambda: step(page) > 2)
        assert re.match(r"peak [\d.]+ lx;", page.inner_text("#own-readout")), "as before and after it"
        # in one call: the note is drawn anew with each step
        marks = "[...document.querySelectorAll('#note .warned')]"
        colours = until(lambda: page.evaluate(f"{marks}.map(mark => getComputedStyle(mark).color)"))
        assert colours == ["rgb(138, 90, 0)"], "no error"
        page.click("#enough")
        phase(page, "idle")
        until(lambda: "of the lens before" in page.inner_text("#files"), 20.0)
        names = set(page.inner_text("#files").split("\n"))
        assert {
            f"{name}, of the lens before" for name in ("lens.step", "lens.ies", "report.html", "drawing.dxf")
        } <= names
        page.click("#search")
        phase(page, "searching")
        assert len(asked) == 2, "asked once"
    finally:
        page.close()
        here.close()


def test_a_verdict_has_its_reason_and_the_button_that_cures_it(studio, started):
    folder = shutil.copytree(studio.folder, studio.folder.parent / "damaged")
    with opened(folder) as here:
        smaller = here.run.part.mesh.copy()
        smaller.apply_scale(0.9)
        (folder / "lens.stl").write_bytes(smaller.export(file_type="stl"))
    with opened(folder) as here:
        here.write(lf.verify(here.run.part, here.run.light))
        reason = here.run.verdict.reasons_of("files")[0]
    wrong, page = lf.studio(folder, browser=False), started.new_page()
    try:
        page.goto(wrong.address)
        page.wait_for_selector("body[data-ready]")
        until(lambda: "CAD files: fail" in page.inner_text("#facts"), 60.0)
        assert reason[1:] in page.inner_text("#facts"), "not the verdict alone"
        page.click("button:has-text('Make the part again')")
        phase(page, "making")
        phase(page, "idle")
        assert page.inner_text("#note") == ""
        assert not load(folder).part.altered, "its files are those of the lens again"
    finally:
        page.close()
        wrong.close()
