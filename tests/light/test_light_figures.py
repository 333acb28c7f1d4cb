"""Figures of a light are those of its own pictures and of the spec, on receivers of every kind."""

import pytest
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.light.receiver_light import ReceiverLight
from lensforge.report.results import verdict_on
from lensforge.results import Metric


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
