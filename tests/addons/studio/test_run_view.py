"""A finished lens as the page of the studio takes it."""

import pytest
from travel_results import LM_PER_W, results, travel

from lensforge.addons.studio.run_view import run_arrays, run_words
from lensforge.report.folder import Run


def test_the_studio_has_the_pictures_of_every_stop_behind_the_receivers(tmp_path):
    run = Run(results().lens, results().found, {}, {}, folder=tmp_path)
    arrays, texts = run_arrays(run, "sag"), run_words(run)
    *receivers, over = texts["receivers"]
    assert len(receivers) == len(run.light.receivers) and (over["width"], over["far"], over["unit"]) == (
        400.0,
        False,
        "lx",
    )
    assert over["stops"][2] == "0.25 mm, far: illuminance on the axis 375 ± 16 lx, full width at half maximum –"
    for index, stop in enumerate(travel().stops):
        assert arrays[f"light{len(receivers)}_{index}"] == pytest.approx(LM_PER_W * stop.map)
    assert f"light{len(receivers)}" not in arrays and f"target{len(receivers)}" not in arrays
