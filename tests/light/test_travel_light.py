"""The light of an LED on its travel: closed forms behind a lens that bends nothing, and which states have a travel."""

from typing import Any

import numpy as np
import pytest
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.light.travel_light import TravelLine, light_on_travel
from lensforge.light.travel_stops import Cut, Travel, cuts
from lensforge.results.chart import Chart, light_unit
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.spec.accuracy import preset_of

WALL_MM = 50.0
WALL = {"kind": "flat_top", "width_mm": 60.0, "distance_mm": WALL_MM, "receiver_mm": 120.0}
WIDE = {**WALL, "receiver_mm": 240.0}
AXIS = [{"name": "near"}, {"name": "far", "shift_mm": [0.0, 0.0, 1.2], "target": WIDE}]


def spec_with(states: list[dict[str, Any]], **changes: Any) -> Spec:
    return small_spec(
        source={"kind": "square", "side_mm": 0.0}, lens__refractive_index=1.0, states=states, target=WALL, **changes
    )


def travel_of(spec: Spec, rays: int = 2**20) -> Travel | None:
    lens = Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft")
    return light_on_travel(lens, build_source(spec.source), preset_of("draft"), rays, 3)


def test_an_led_that_comes_nearer_is_brighter_by_the_square_of_the_distance() -> None:
    """Of a Lambertian point of 1 W at the distance d there is 1/(pi d^2) on the axis; the picture is the widest one."""
    travel = travel_of(spec_with(AXIS))
    assert travel is not None and (travel.width, travel.far_field) == (240.0, False)
    assert [stop.shift_mm for stop in travel.stops] == pytest.approx(np.linspace(0.0, 1.2, 7))
    assert [stop.state for stop in travel.stops] == ["near", *5 * [""], "far"]
    for stop in travel.stops:
        wanted = 1e6 / (np.pi * (WALL_MM - stop.shift_mm) ** 2)
        assert stop.on_axis.value == pytest.approx(wanted, abs=4.0 * stop.on_axis.standard_error)
        assert stop.on_axis.standard_error < 0.04 * wanted and stop.on_axis.unit == "W/m²"
    assert travel.rays == 2**20 // 70 // 16 * 16


def test_the_width_is_that_of_lambertian_light_on_a_wall() -> None:
    """cos^4 of the angle from the axis is one half at d (sqrt(2) - 1)^(1/2) to each side."""
    travel = travel_of(spec_with(AXIS), rays=2**23)
    assert travel is not None
    for stop in travel.stops:
        wanted = 2.0 * (WALL_MM - stop.shift_mm) * np.sqrt(np.sqrt(2.0) - 1.0)
        assert stop.width == pytest.approx(wanted, rel=0.03)


def test_an_led_that_moves_aside_moves_its_light_with_it() -> None:
    aside = [{"name": "right", "shift_mm": [0.6, 0.0, 0.0]}, {"name": "left", "shift_mm": [-0.6, 0.0, 0.0]}]
    travel = travel_of(spec_with(aside), rays=2**22)
    assert travel is not None
    places = [stop.shift_mm for stop in travel.stops]
    middles = [float(stop.map.sum(axis=0) @ travel.chart.x(128) / stop.map.sum()) for stop in travel.stops]
    assert (places[0], places[-1]) == pytest.approx((0.0, 1.2)) and travel.stops[-1].state == "left"
    assert np.polyfit(places, middles, 1)[0] < -0.5


def test_a_state_between_has_a_stop_of_its_own() -> None:
    states = [*AXIS, {"name": "middle", "shift_mm": [0.0, 0.0, 0.5]}]
    line = TravelLine.of(spec_with(states))
    assert line is not None
    stops = line.stops()
    assert len(stops) == 8 and list(stops) == sorted(stops) and stops[0.5] == "middle"


TURNED = {"name": "far", "shift_mm": [0.0, 0.0, 1.0], "tilt_deg": [0.0, 5.0]}
WARM = {"name": "far", "shift_mm": [0.0, 0.0, 1.0], "temperature_c": 80.0}
BENT = [{"name": "a"}, {"name": "b", "shift_mm": [0.0, 0.0, 1.0]}, {"name": "c", "shift_mm": [0.1, 0.0, 0.5]}]
ELSEWHERE = {"name": "far", "shift_mm": [0.0, 0.0, 1.0], "target": {**WALL, "distance_mm": 80.0}}


@pytest.mark.parametrize(
    "states",
    [[AXIS[0], TURNED], [AXIS[0], WARM], BENT, [AXIS[0], ELSEWHERE], [AXIS[0], {"name": "b", "target": WIDE}]],
    ids=["turned", "warm", "off the line", "on another wall", "no shift"],
)
def test_states_that_differ_by_more_than_a_shift_along_a_line_have_no_travel(states: list[dict[str, Any]]) -> None:
    law = {"lens__index_per_k": 1e-4, "lens__expansion_per_k": 1e-4}
    assert travel_of(spec_with(states, **law)) is None


def test_a_cut_is_as_wide_as_its_outermost_halves_and_has_no_width_where_its_end_is_bright() -> None:
    places = np.linspace(-4.0, 4.0, 9)
    triangle = 4.0 - np.abs(places)
    assert Cut(places, triangle).width() == pytest.approx(4.0)
    assert Cut(places, np.where(np.abs(places) < 2.0, 0.1, triangle)).width() == pytest.approx(6.0)  # a ring
    assert Cut(places, triangle + 5.0).width() is None and Cut(places, 0.0 * places).width() is None


def test_places_of_a_cut_in_the_far_field_are_angles() -> None:
    light = np.zeros((6, 12))
    light[2:4, 9:] = 1.0
    along = cuts(light, Chart(2.0, 1.0, far_field=True))
    assert along["x"].places[-1] == pytest.approx(np.degrees(2.0 * np.arcsin(11.0 / 24.0)))
    assert along["x"].light.tolist() == [0.0] * 9 + [0.5] * 3 and not along["y"].light.any()


def test_an_evaluation_keeps_the_travel_and_tells_its_figures(tmp_path: Any) -> None:
    spec = spec_with(AXIS)
    lens = Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft")
    light = lf.evaluate(lens, rays=2**14)
    light.write(tmp_path)
    assert light.travel is not None and lf.Light.read(tmp_path).travel == light.travel
    rows = list(light.travel.groups(light_unit(100.0)))
    assert [row.title for row in rows][::3] == ["0 mm, near", "0.6 mm", "1.2 mm, far"]
    on_axis = rows[0].fact("on_axis")
    assert (on_axis.label, on_axis.unit) == ("Illuminance on the axis", "lx")
    assert on_axis.value == pytest.approx(100.0 * light.travel.stops[0].on_axis.value)
    assert lf.evaluate(lens.of_state("near"), rays=2**14).travel is None
