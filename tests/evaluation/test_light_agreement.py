"""A light agrees with its spec and its own pictures, on every receiver; one that was changed does not."""

import numpy as np
import pytest
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.agreement.light import light_contradictions
from lensforge.records import Metric
from lensforge.verdict import verdict_on

RECEIVER_MM = 100.0


def light_of(window_mm: float) -> tuple[lf.Light, lf.Lens]:
    spec = small_spec(evaluate__window_mm=window_mm, target__receiver_mm=RECEIVER_MM, target__uniform_mm=None)
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.evaluate(lens, rays=2**14), lens


@pytest.mark.parametrize("window_mm", [0.5 * RECEIVER_MM, RECEIVER_MM, 1.5 * RECEIVER_MM])
def test_a_light_agrees_with_its_pictures(window_mm: float) -> None:
    light, lens = light_of(window_mm)
    assert list(light_contradictions(light, lens)) == []


def changed(light: lf.Light, number: int, **fields: object) -> lf.Light:
    """The same light with other fields on one of its receivers."""
    receivers = list(light.receivers)
    receivers[number] = receivers[number].model_copy(update=fields)
    return light.model_copy(update={"receivers": tuple(receivers)})


def test_a_share_that_its_pictures_do_not_show_is_named() -> None:
    light, lens = light_of(RECEIVER_MM)
    share = light.share_in_target
    less = changed(light, 0, share_in_target=share.model_copy(update={"value": 0.9 * share.value}))
    assert [words.split(" =")[0] for words in light_contradictions(less, lens)] == ["share_in_target"]


RECEIVERS = [
    {"kind": "plane", "name": "wall", "centre_mm": [20.0, 0.0, 100.0], "tilt_deg": [0.0, 15.0], "width_mm": 160.0,
     "height_mm": 90.0, "window_mm": [120.0, 60.0], "targets": [{"kind": "rectangle", "width_mm": 100.0,
     "height_mm": 50.0, "uniform_mm": [80.0, 40.0]}]},
    {"kind": "far_field", "half_angle_deg": 60.0, "targets": [{"kind": "disc", "diameter_deg": 80.0,
     "uniform_deg": 40.0}]},
    {"kind": "cylinder", "radius_mm": 120.0, "width_mm": 200.0, "height_mm": 100.0, "targets": [{"kind": "cross",
     "length_mm": 80.0, "stroke_mm": 20.0}]},
    {"kind": "sphere", "radius_mm": 90.0, "half_angle_deg": 70.0, "targets": [{"kind": "disc", "diameter_mm": 80.0}]},
]  # fmt: skip


@pytest.fixture(scope="module")
def several() -> tuple[lf.Light, lf.Lens]:
    spec = small_spec().replace({"target": None, "receivers": RECEIVERS})
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.evaluate(lens, rays=2**14), lens


def test_light_on_receivers_of_every_kind_agrees(several) -> None:
    light, lens = several
    assert [each.name for each in light.receivers] == ["wall", "far_field", "cylinder", "sphere"]
    assert list(light_contradictions(light, lens)) == []


@pytest.mark.parametrize(
    ("number", "fields", "words"),
    [
        (0, {"kind": "sphere"}, "receivers: wall: kind = 'sphere', but the spec has 'plane'"),
        (0, {"place": "on the moon"}, "receivers: wall: place = 'on the moon', but the spec has 'centred at (20, 0, "),
        (1, {"name": "wall"}, "receivers: far_field: name = 'wall', but the spec has 'far_field'"),
        (2, {"width": 210.0}, "receivers: cylinder: width = 210, but the spec's lengths say 200"),
        (3, {"height": 90.0}, "receivers: sphere: height = 90, but the spec's lengths say "),
        (2, {"map": np.ones((16, 8))}, "receivers: cylinder: map: 8 x 16 pixels, but the spec has 16 x 8"),
        (1, {"target_map": np.ones((16, 16))}, "receivers: far_field: target_map = 256, but its pictures say "),
    ],
)
def test_a_receiver_that_is_another_is_named(several, number: int, fields: dict, words: str) -> None:
    light, lens = several
    assert next(light_contradictions(changed(light, number, **fields), lens)).startswith(words)


def test_a_window_that_is_another_is_named(several) -> None:
    light, lens = several
    window = light.first.window.model_copy(update={"width": 160.0})
    found = list(light_contradictions(changed(light, 0, window=window), lens))
    assert found == ["receivers: wall: window.width = 160, but the spec's lengths say 120"]


@pytest.mark.parametrize("number", range(4))
def test_figures_of_each_receiver_are_those_of_its_pictures(several, number: int) -> None:
    light, lens = several
    own = light.receivers[number]
    raw = own.raw.model_copy(update={"nmse": 1.1 * own.raw.nmse})
    found = list(light_contradictions(changed(light, number, raw=raw), lens))
    assert found[0].startswith(f"receivers: {own.name}: raw.nmse = ")
    if own.uniformity is not None:
        raw = own.raw.model_copy(update={"uniformity": own.raw.uniformity + 0.1})
        (only,) = light_contradictions(changed(light, number, raw=raw), lens)
        assert only.startswith(f"receivers: {own.name}: raw.uniformity = ")


def test_a_receiver_that_is_missing_is_named(several) -> None:
    light, lens = several
    less = light.model_copy(update={"receivers": light.receivers[:3]})
    assert list(light_contradictions(less, lens)) == ["receivers = 3, but the spec has 4"]


def test_the_verdict_names_the_receiver(several) -> None:
    light, lens = several
    good, bad = Metric(value=0.01, standard_error=1e-4), Metric(value=0.5, standard_error=1e-4)
    full = Metric(value=0.95, standard_error=1e-4)
    for number in range(4):
        light = changed(light, number, nmse=bad if number == 2 else good, share_in_target=full)
    found = verdict_on(lens, None, light, None, None, None)
    assert found.light == "fail"
    assert [words.split(" = ")[0] for words in found.reasons.light] == ["NMSE on cylinder"]
    alone = light.model_copy(update={"receivers": light.receivers[2:3]})
    assert (
        verdict_on(lens, None, alone, None, None, None)
        .reasons.light[0]
        .startswith("NMSE = 0.50000 ± 0.00010, at most 0.1: ")
    )


LIMITS = [
    {"kind": "points", "name": "axis", "at_deg": [[0, 0]], "at_least_w_per_sr": 0.01},
    {"kind": "zone", "at_most_w_per_sr": 9.0, "at_least_share": 0.1},
    {"kind": "beam_angle", "at_most_deg": 110.0},
]


@pytest.fixture(scope="module")
def limited() -> tuple[lf.Light, lf.Lens]:
    spec = small_spec(target={"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}).replace(limits=LIMITS)
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.evaluate(lens, rays=2**14), lens


def with_limit(light: lf.Light, number: int, **fields: object) -> lf.Light:
    limits = list(light.limits)
    limits[number] = limits[number].model_copy(update=fields)
    return light.model_copy(update={"limits": tuple(limits)})


def test_limits_agree_with_spec_and_pictures(limited) -> None:
    light, lens = limited
    assert [limit.quantity for limit in light.limits] == ["light", "light", "share of the flux", "beam angle"]
    assert list(light_contradictions(light, lens)) == []


def test_limits_that_were_changed_are_named(limited) -> None:
    light, lens = limited
    brighter = Metric(value=2.0 * light.limits[0].value.value, standard_error=light.limits[0].value.standard_error)
    for other, words in (
        (with_limit(light, 0, bound=0.001), "limits: axis: bound = 0.001, but the spec has 0.01"),
        (with_limit(light, 0, value=brighter), "limits: axis: value = "),
        (with_limit(light, 1, name="other"), "limits: limits.1: name = 'other'"),
        (light.model_copy(update={"limits": light.limits[1:]}), "limits = 3, but the spec has 4"),
    ):
        assert next(light_contradictions(other, lens)).startswith(words)


def test_a_bound_of_physics_that_the_verdict_rests_on_is_that_of_the_source(limited) -> None:
    light, lens = limited
    lower = light.first.possible.model_copy(update={"share_in_target": 0.5 * light.share_in_target.value})
    found = next(light_contradictions(changed(light, 0, possible=lower), lens))
    assert found.startswith("possible.share_in_target = ") and "source and lens say" in found
