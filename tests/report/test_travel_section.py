"""The travel of an LED on the page: its pictures read back, and its slider in a browser."""

import re

import browser
import numpy as np
import pytest
from page_text import undrawn_page_of
from result_folders import make_light, small_lens
from test_shown_numbers import numbers_in, seen_in, texts_of
from travel_results import CHART, LM_PER_W, results, travel

from lensforge.light.travel_stops import cuts
from lensforge.report import page, travel_section
from lensforge.report.results import Results


@pytest.fixture
def figures(monkeypatch):
    """The figures of the section, by the names of their pictures."""
    by_name = {}

    def keep(name, figure, title, caption=""):
        by_name[name] = figure
        return page.PagePicture("", title, caption)

    monkeypatch.setattr(travel_section, "picture", keep)
    assert travel_section.travel_pictures(results()) is not None
    return by_name


def test_every_picture_of_the_travel_is_that_of_its_stop(figures):
    seen = travel()
    brightest = max(cut.light.max() for stop in seen.stops for cut in cuts(stop.map, CHART).values())
    for index, stop in enumerate(seen.stops):
        (shown,) = figures[f"stop-{index}-map"].axes[0].images
        assert np.asarray(shown.get_array()) == pytest.approx(LM_PER_W * stop.map)
        axes = figures[f"stop-{index}-cut"].axes[0]
        assert axes.get_ylim() == pytest.approx((0.0, 1.05 * LM_PER_W * brightest))
        for line, (name, cut) in zip(axes.lines, cuts(stop.map, CHART).items(), strict=True):
            assert line.get_label() == f"along {name}"
            assert line.get_xdata() == pytest.approx(cut.places)
            assert line.get_ydata() == pytest.approx(LM_PER_W * cut.light)
    (on_axis,) = figures["travel-axis"].axes[0].lines
    assert on_axis.get_xydata() == pytest.approx(np.array([[0.0, 875.0], [0.125, 625.0], [0.25, 375.0]]))
    (width,) = figures["travel-width"].axes[0].lines
    assert width.get_xydata() == pytest.approx(np.array([[0.0, 61.0], [0.125, 83.0]]))
    assert figures["travel-axis"].axes[0].get_ylabel() == "illuminance (lx)"


def test_the_page_tells_rays_and_pixels_and_each_number_is_one_of_a_fact():
    markup = undrawn_page_of(results())
    section = markup[markup.index('<h3 id="travel">') : markup.index('<h2 id="photometry">')]
    text = seen_in(f"<body>{section}")
    assert re.search(r"By 4\s?321 rays at each stop, the same at all, on 16 × 8 pixels", text)
    assert "0.125 mm: illuminance on the axis 625 ± 16 lx, full width at half maximum 83 mm" in text
    known = {number for line in texts_of(travel_section.travel_groups(results())) for number in numbers_in(line)}
    assert numbers_in(text) - known <= {"4321", "4", "321", "16", "8"}


def test_a_lens_without_a_travel_has_neither_section_nor_slider():
    lens = small_lens()
    markup = undrawn_page_of(Results(lens, {"evaluate": make_light(lens)}))
    assert "Travel of the LED" not in markup and 'type="range"' not in markup


@browser.needed
def test_the_slider_shows_one_stop_at_a_time(tmp_path):
    file = tmp_path / "report.html"
    file.write_text(undrawn_page_of(results()), encoding="utf-8")
    with browser.chromium() as started, browser.opened(started, file, 1280, "light") as window:
        slider, shown = window.locator(".travel input"), window.locator(".travel .stop:visible p >> nth=0")
        assert window.locator(".travel .stop:visible").count() == 1 and shown.inner_text().startswith("0 mm, near:")
        slider.focus()
        window.keyboard.press("ArrowRight")
        assert window.locator(".travel .stop:visible").count() == 1 and shown.inner_text().startswith("0.125 mm:")
        assert slider.get_attribute("aria-valuetext") == shown.inner_text()
        window.keyboard.press("End")
        assert shown.inner_text().startswith("0.25 mm, far:")
        window.emulate_media(media="print")
        assert not slider.is_visible() and window.locator(".travel .stop:visible").count() == 1
    with browser.chromium() as started:
        without = started.new_context(java_script_enabled=False).new_page()
        without.goto(file.as_uri())
        assert (
            without.locator(".travel .stop:visible").count() == 3 and not without.locator(".travel input").is_visible()
        )
