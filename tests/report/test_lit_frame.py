"""The frame of the first picture: all of the target, and the light that misses it, without dark surroundings."""

import numpy as np
import pytest
from result_folders import make_results

from lensforge.report import light_figures
from lensforge.report.light_figures import lit_frame
from lensforge.report.light_section import first_picture
from lensforge.results.chart import Chart

CHART = Chart(400.0, 400.0)


def spot(x_mm, y_mm, half_mm, level=1.0):
    """Light of ``level`` on a square about (x, y), on 100 x 100 pixels of 4 mm."""
    x, y = np.meshgrid(CHART.x(100), CHART.y(100))
    return level * ((abs(x - x_mm) < half_mm) & (abs(y - y_mm) < half_mm))


def test_a_small_target_fills_its_picture():
    frame = lit_frame(spot(0, 0, 40), spot(0, 0, 40), CHART)
    assert frame == Chart(pytest.approx(96.0), pytest.approx(96.0))


def test_the_frame_reaches_as_far_as_target_and_light():
    for target, light in ((spot(100, 0, 20), spot(0, 0, 20)), (spot(0, 0, 20), spot(-100, 0, 20, 0.5))):
        assert lit_frame(target, light, CHART).width == pytest.approx(288.0)
        assert lit_frame(target, light, CHART).height == pytest.approx(144.0), "half as high: the scale can be read"


def test_faint_light_far_away_is_left_out_and_a_lit_receiver_is_shown_whole():
    assert lit_frame(spot(0, 0, 40), spot(180, 180, 10, 0.04), CHART).width == pytest.approx(96.0)
    assert lit_frame(spot(0, 0, 170), spot(0, 0, 170), CHART) == CHART
    assert lit_frame(np.zeros((4, 4)), np.ones((4, 4)), CHART) == CHART


@pytest.mark.parametrize(("times", "top", "ends"), [(1.2, 44.0, 1), (3.2, 128.0, 0)])
def test_the_first_picture_has_the_place_of_the_target_and_its_scale_unless_a_spot_is_hot(
    monkeypatch, times, top, ends
):
    seen = {}
    draw = light_figures.irradiance_map

    def keep(image, chart, top, outline, **others):
        seen.update(image=image, top=top, outline=outline, figure=draw(image, chart, top, outline, **others))
        return seen["figure"]

    monkeypatch.setattr(light_figures, "irradiance_map", keep)
    target = np.zeros((16, 16))
    target[6:10, 6:10] = 40.0
    first = first_picture(make_results(("evaluate",), evaluate={"map": times * target, "target_map": target}))
    assert seen["top"] == pytest.approx(top)
    axes, bar = seen["figure"].axes
    assert axes.get_xlim() == pytest.approx((-45.0, 45.0)), "of a receiver of 300 mm"
    assert axes.images[0].get_clim() == pytest.approx((0.0, top))
    assert len(bar.patches) == ends, "an arrow at the end of the scale"
    marks = [line.get_ydata()[0] for line in bar.lines if line.get_color() == "white"]
    assert marks == ([] if ends else [40.0]), "the target's peak on the scale of the light"
    assert ("target’s scale" in first.title, "its own scale" in first.title) == (bool(ends), not ends)
    assert "Cut to the lit part" in first.caption
