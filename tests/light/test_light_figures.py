"""Figures of a light are those of its own pictures and of the spec, on receivers of every kind."""

import pytest
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.light.receiver_light import ReceiverLight
from lensforge.report.results import verdict_on
from lensforge.results import Metric

RECEIVER_MM = 100.0


def light_of(window_mm: float) -> tuple[lf.Light, lf.Lens]:
    spec = small_spec(evaluate__window_mm=window_mm, target__receiver_mm=RECEIVER_MM, target__uniform_mm=None)
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.evaluate(lens, rays=2**14), lens


def require_figures_of_pictures(own: ReceiverLight) -> None:
    """Flux by cause, the target's flux, and the NMSE with noise, written out from the record's pictures."""
    assert sum(own.missed_by_cause.model_dump().values()) == pytest.approx(own.flux.missed, abs=1e-12)
    assert sum(own.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    assert own.efficiency.value == pytest.approx(own.flux.detected, abs=1e-12)
    assert own.target_map.sum() == pytest.approx(own.map.sum(), rel=1e-9)
    difference = own.map - own.target_map
    assert own.raw.nmse == pytest.approx((difference**2).sum() / (own.target_map**2).sum(), rel=1e-9)
    assert own.nmse.value <= own.raw.nmse
    if own.in_region is not None:
        assert own.map.min() <= own.in_region.mean.value <= own.map.max()


@pytest.mark.parametrize("window_mm", [0.5 * RECEIVER_MM, RECEIVER_MM, 1.5 * RECEIVER_MM])
def test_a_light_has_the_figures_of_its_pictures(window_mm: float) -> None:
    light, _ = light_of(window_mm)
    require_figures_of_pictures(light.first)
    assert light.first.window.width == window_mm


def test_the_share_in_the_target_is_the_light_where_it_is_above_a_tenth() -> None:
    """Where the window is the receiver, the efficiency is the flux in the picture."""
    light, _ = light_of(RECEIVER_MM)
    own = light.first
    inside = own.target_map > 0.1 * own.target_map.max()
    share = own.efficiency.value * own.raw_map[inside].sum() / own.raw_map.sum()
    assert own.share_in_target.value == pytest.approx(share, rel=1e-9)


def changed(light: lf.Light, number: int, **fields: object) -> lf.Light:
    """The same light with other fields on one of its receivers."""
    receivers = list(light.receivers)
    receivers[number] = receivers[number].model_copy(update=fields)
    return light.model_copy(update={"receivers": tuple(receivers)})


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


def test_light_on_receivers_of_every_kind_has_their_sizes_and_figures(several) -> None:
    light, lens = several
    assert [(each.name, each.kind) for each in light.receivers] == [
        ("wall", "plane"), ("far_field", "far_field"), ("cylinder", "cylinder"), ("sphere", "sphere"),
    ]  # fmt: skip
    wall, _, cylinder, _ = light.receivers
    assert (wall.width, wall.height, wall.window.width, wall.window.height) == (160.0, 90.0, 120.0, 60.0)
    assert (cylinder.width, cylinder.height) == (200.0, 100.0)
    for own, section in zip(light.receivers, lens.spec.all_receivers, strict=True):
        assert own.place == section.place
        assert own.map.shape == ((9, 16) if own.name == "wall" else (8, 16) if own.name == "cylinder" else (16, 16))
        require_figures_of_pictures(own)


@pytest.mark.parametrize("number", [0, 1])
def test_uniformity_with_noise_is_that_of_the_picture_in_its_region(several, number: int) -> None:
    from lensforge.scene.receiver_shapes import receivers_of
    from lensforge.scene.target_pattern import uniform_region

    light, lens = several
    own, section = light.receivers[number], lens.spec.all_receivers[number]
    inside = own.map[uniform_region(section.targets, receivers_of(lens.spec, 16)[number])]
    assert own.raw.uniformity == pytest.approx(inside.min() / inside.mean())
    assert own.raw.rsd == pytest.approx(inside.std() / inside.mean())


def test_the_verdict_names_the_receiver(several) -> None:
    light, lens = several
    good, bad = Metric(value=0.01, standard_error=1e-4), Metric(value=0.5, standard_error=1e-4)
    full = Metric(value=0.95, standard_error=1e-4)
    for number in range(4):
        light = changed(light, number, nmse=bad if number == 2 else good, share_in_target=full)
    found = verdict_on(lens, None, light, None, None, None)
    assert found.light == "fail"
    assert [words.split(" = ")[0] for words in found.reasons.light] == ["Pattern error (NMSE) on cylinder"]
    alone = light.model_copy(update={"receivers": light.receivers[2:3]})
    assert (
        verdict_on(lens, None, alone, None, None, None)
        .reasons.light[0]
        .startswith("Pattern error (NMSE) = 0.50000 ± 0.00010, must be ≤ 0.1: ")
    )


LIMITS = [
    {"kind": "points", "name": "axis", "at_deg": [[0, 0]], "unit": "w_per_sr", "at_least": 0.01},
    {"kind": "zone", "unit": "w_per_sr", "at_most": 9.0, "at_least_share": 0.1},
    {"kind": "beam_angle", "at_most_deg": 110.0},
]


@pytest.fixture(scope="module")
def limited() -> tuple[lf.Light, lf.Lens]:
    spec = small_spec(target={"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}).replace(limits=LIMITS)
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.evaluate(lens, rays=2**14), lens


def test_limits_are_those_of_the_spec_and_their_values_those_of_the_light(limited) -> None:
    light, _ = limited
    assert [limit.quantity for limit in light.limits] == ["light", "light", "share of the flux", "beam angle"]
    assert [(limit.sense, limit.bound) for limit in light.limits] == [
        (">=", 0.01), ("<=", 9.0), (">=", 0.1), ("<=", 110.0),
    ]  # fmt: skip
    assert light.limits[1].value.value <= light.first.map.max() * (1.0 + 1e-12)
