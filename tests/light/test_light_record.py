"""The record of a light on two receivers: what it says of itself, what it refuses, and which receiver is the first."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import random_surface, small_spec

from lensforge.errors import InputError
from lensforge.light import evaluation
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light, LightMetrics
from lensforge.light.simulation import TracedLens, traced_light
from lensforge.results import Conditions
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS

WALL = {"kind": "plane", "name": "wall", "centre_mm": [0.0, 0.0, 60.0], "width_mm": 90.0, "height_mm": 60.0,
        "targets": [{"kind": "disc", "diameter_mm": 40.0, "uniform_mm": 20.0}]}  # fmt: skip
SKY = {"kind": "far_field", "name": "sky", "half_angle_deg": 60.0, "targets": [{"kind": "beam", "fwhm_deg": 30.0}]}


@pytest.fixture(scope="module")
def scene() -> tuple[TracedLens, Any, Any]:
    spec = small_spec(target=None, receivers=[WALL, SKY], source__flux_w=2.5)
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
    wall, sky = light.receivers
    start = f"light: wall: NMSE {wall.nmse}, uniformity {wall.uniformity}, efficiency {wall.efficiency}; "
    start += f"sky: NMSE {sky.nmse}, efficiency {sky.efficiency} "
    alone = str(light.model_copy(update={"receivers": (wall,)}))
    assert alone.startswith(f"light: NMSE {wall.nmse}, uniformity") and "wall" not in alone
    assert words == start + "(512 rays, 12 x 8 pixels, 3x3 Gaussian, variance 1 pixel^2, hard bins)"
    without = light.first.model_copy(update={"uniformity": None})
    assert "uniformity" not in str(light.model_copy(update={"receivers": (without, light.receivers[1])}))
    warm = light.model_copy(update={"conditions": Conditions(name="hot", temperature_c=80.0)})
    assert str(warm).startswith(f"light under other conditions ({warm.conditions}): wall: NMSE")


def test_receivers_of_other_pixels_are_refused(light: Light) -> None:
    content = {name: getattr(light, name) for name in ("rays", "replicates", "filter", "lumens_per_watt", "table_nodes",
               "table_error_nm", "preset_error", "seed", "seconds", "criteria", "receivers")}  # fmt: skip
    assert Light(**content, pixels=12).pixels == 12
    with pytest.raises(ValueError, match="pixels = 13, but the maps of wall have 12"):
        Light(**content, pixels=13)


def test_a_receiver_is_plotted_by_its_name_the_first_by_default(light: Light, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lensforge.results.plots.plot_map", lambda *shown: shown)
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


def test_the_lens_may_reach_farther_than_its_spec_says_where_it_has_grown(scene, light: Light) -> None:
    traced, spec, source = scene
    limits = spec.constraints.model_copy(update={"max_radius_mm": 8.5})
    larger = evaluate_traced(traced, spec.model_copy(update={"constraints": limits}), source, 512, 3, pixels=12)
    grown = evaluate_traced(replace(traced, grown_mm=1.5), spec, source, 512, 3, pixels=12)
    assert grown.possible == larger.possible != light.possible


@pytest.mark.parametrize(
    ("given", "of_spec", "wanted"),
    [
        ({}, None, (PRESETS["draft"].evaluate_rays, 16, 5)),
        ({}, 640, (640, 16, 5)),
        ({"rays": 77, "pixels": 20, "seed": 0}, 640, (77, 20, 0)),
        ({"seed": 8}, 640, (640, 16, 8)),
    ],
)
def test_rays_pixels_and_seed_are_those_given_or_those_of_spec_and_lens(
    given, of_spec, wanted, light, monkeypatch
) -> None:
    spec = small_spec(target=None, receivers=[WALL, SKY], evaluate={"rays": of_spec, "pixels": 16})
    limit = {"kind": "points", "at_mm": [[0.0, 0.0]], "unit": "lx", "at_least": 3.0}
    lens = Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec.replace(limits=[limit]), 5, "draft")
    asked: list[Any] = []
    monkeypatch.setattr(evaluation, "evaluate_traced", lambda *own, **named: asked.append((own, named)) or light)
    monkeypatch.setattr(evaluation, "measure_preset", lambda *own: asked.append(own) or None)
    monkeypatch.setattr(evaluation.TracedLens, "of", lambda lens, nodes: nodes)
    source, preset = build_source(spec.source), PRESETS["draft"]
    found = evaluation.evaluate_lens(lens, source, preset, lumens_per_watt=250.0, **given)
    ((traced, *own, rays, seed), named), measured = asked
    assert (rays, named["pixels"], seed) == wanted and own == [lens.spec, source]
    assert (traced, measured) == (preset.evaluate_nodes_per_sigma, (lens, source, preset.nodes_per_sigma, traced))
    (limit_there,) = named["limits"]
    assert limit_there.readings.shape[1] == wanted[1] * round(wanted[1] * 2 / 3)
    assert found.lumens_per_watt == 250.0 and found.inputs == {"lens": lens.sha256}
