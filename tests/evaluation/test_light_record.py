"""The record of a light on two receivers: what it says of itself, what it refuses, and which receiver is the first."""

from typing import Any

import numpy as np
import pytest
from scenes import random_surface, small_spec

from lensforge.errors import InputError
from lensforge.evaluation.evaluate import evaluate_traced
from lensforge.evaluation.light import Light, LightMetrics
from lensforge.evaluation.replicate_metrics import traced_light
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.records import Conditions
from lensforge.sources.build import build_source

WALL = {"kind": "plane", "name": "wall", "centre_mm": [0.0, 0.0, 60.0], "width_mm": 90.0, "height_mm": 60.0,
        "targets": [{"kind": "disc", "diameter_mm": 40.0, "uniform_mm": 20.0}]}  # fmt: skip
SKY = {"kind": "far_field", "name": "sky", "half_angle_deg": 60.0, "targets": [{"kind": "beam", "fwhm_deg": 30.0}]}


@pytest.fixture(scope="module")
def scene() -> tuple[TracedLens, Any, Any]:
    spec = small_spec(target=None, receivers=[WALL, SKY])
    lens = Lens(random_surface(1, 3.0, 0.02, (9,)), random_surface(2, 6.0, 0.02, (9,)), spec, 0, "draft")
    return TracedLens.of(lens, 2.0), spec, build_source(spec.source)


@pytest.fixture(scope="module")
def light(scene) -> Light:
    traced, spec, source = scene
    return evaluate_traced(traced, spec, source, 512, 3, pixels=12)


def test_its_own_figures_are_those_of_the_first_receiver(light: Light) -> None:
    first = light.receivers[0]
    assert light.first is first and [each.name for each in light.receivers] == ["wall", "sky"]
    for name in ("nmse", "efficiency", "share_in_target", "uniformity", "rsd", "possible", "flux", "missed_by_cause",
                 "raw", "nmse_of_noise", "map", "raw_map", "target_map"):  # fmt: skip
        assert getattr(light, name) is getattr(first, name), name
    metrics = LightMetrics.of(light)
    assert (metrics.nmse, metrics.rsd) == (first.nmse, first.rsd)
    assert (metrics.uniformity, metrics.efficiency) == (first.uniformity, first.efficiency)
    assert (light.pixels, light.rays, light.replicates, light.seed) == (12, 512, 16, 3)
    assert light.map.shape == (8, 12) and light.limits == () and 0.0 < light.seconds < 100.0
    assert light.lumens_per_watt is None and light.preset_error is None


def test_it_says_its_figures_and_how_it_was_made(light: Light) -> None:
    words = str(light)
    start = f"light: NMSE {light.nmse}, uniformity {light.uniformity}, efficiency {light.efficiency} "
    assert words == start + "(512 rays, 12 x 8 pixels, 3x3 Gaussian, variance 1 pixel^2, hard bins)"
    without = light.first.model_copy(update={"uniformity": None})
    assert "uniformity" not in str(light.model_copy(update={"receivers": (without, light.receivers[1])}))
    warm = light.model_copy(update={"conditions": Conditions(name="hot", temperature_c=80.0)})
    assert str(warm).startswith(f"light under other conditions ({warm.conditions}): NMSE")


def test_receivers_of_other_pixels_are_refused(light: Light) -> None:
    content = {name: getattr(light, name) for name in ("rays", "replicates", "filter", "lumens_per_watt", "table_nodes",
               "table_error_nm", "preset_error", "seed", "seconds", "criteria", "receivers")}  # fmt: skip
    assert Light(**content, pixels=12).pixels == 12
    with pytest.raises(ValueError, match="pixels = 13, but the maps of wall have 12"):
        Light(**content, pixels=13)


def test_a_receiver_is_plotted_by_its_name_the_first_by_default(light: Light, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lensforge.figures.plots.plot_map", lambda *shown: shown)
    wall, sky = light.receivers
    for name, own, symbol in ((None, wall, "W/m²"), ("wall", wall, "W/m²"), ("sky", sky, "W/sr")):
        picture, chart, unit, axes = light.plot(receiver=name)
        assert picture is own.map and chart == own.chart and unit.symbol == symbol and axes is None
    bright = light.model_copy(update={"lumens_per_watt": 100.0}).plot(receiver="sky", which="target_map")
    assert bright[0] is sky.target_map and (bright[2].symbol, bright[2].per_watt) == ("cd", 100.0)
    with pytest.raises(InputError, match="receiver"):
        light.plot(receiver="moon")


def test_the_light_of_one_lens_among_many_is_that_on_the_first_receiver(scene) -> None:
    traced, spec, source = scene
    own, whole = traced_light(traced, spec, source, 512, 3), evaluate_traced(traced, spec, source, 512, 3)
    assert own.metrics == LightMetrics.of(whole) and np.array_equal(own.map, whole.map)
