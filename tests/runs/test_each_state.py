"""A lens in two states, crooked and unlike: every stage does in each what it does for that condition alone."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from presets import FEW_STEPS
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.light.light_facts import light_reasons
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.report.headline import task
from lensforge.report.results import Results
from lensforge.shop.drawing import travel_notes

LED = {"kind": "square", "side_mm": 0.5, "flux_lm": 80.0, "position_mm": [0.05, 0.0, 0.0]}
DISC = {"kind": "disc", "diameter_mm": 0.4, "flux_lm": 30.0}
OTHER = {"kind": "plane", "centre_mm": [10.0, -5.0, 90.0], "width_mm": 160.0, "height_mm": 160.0,
         "targets": [{"kind": "disc", "diameter_mm": 90.0, "centre_mm": [8.0, 0.0]}]}  # fmt: skip
ZONE = {"kind": "zone", "name": "middle", "zone": {"kind": "disc", "diameter_mm": 120.0}}
MOVED = {"shift_mm": [0.1, -0.2, 0.05], "tilt_deg": [6.0, -3.0]}
LIMITS = [{**ZONE, "at_least_share": 0.01}], [{**ZONE, "at_least_share": 0.02}]
LAW = {"lens__index_per_k": -3e-4, "lens__expansion_per_k": 3e-4}
WARM_C = 95.0
STATES = [
    {"name": "near", "weight": 2.0},
    {"name": "far", "source": DISC, **MOVED, "temperature_c": WARM_C, "receivers": [OTHER], "limits": LIMITS[1]},
]
PLACED = {**DISC, "position_mm": MOVED["shift_mm"], "tilt_deg": MOVED["tilt_deg"]}
BY_HAND: dict[str, dict[str, Any]] = {
    "near": {"source": LED, "limits": LIMITS[0]},
    "far": {"lens__temperature_c": WARM_C, "source": PLACED, "limits": LIMITS[1], "target": None, "receivers": [OTHER]},
}
FACES = random_surface(1, 3.0), random_surface(2, 6.0)


def lens_with(**changes: Any) -> lf.Lens:
    spec = small_spec(**{"target__uniform_mm": None, **LAW, **changes})
    return lf.Lens.double(*FACES, spec, 3, FEW_STEPS)


@pytest.fixture(scope="module")
def lens() -> lf.Lens:
    return lens_with(source=LED, states=STATES, limits=LIMITS[0])


@pytest.fixture(scope="module")
def light(lens: lf.Lens) -> lf.Light:
    return lf.evaluate(lens)


@pytest.fixture(scope="module")
def part(lens: lf.Lens) -> lf.Part:
    return lf.build(lens)


def test_the_light_of_a_state_is_that_of_the_same_lens_with_its_condition_alone(lens: lf.Lens, light: lf.Light) -> None:
    """To the last digit; an evaluation of the lens in one state is the same."""
    for name, condition in BY_HAND.items():
        alone = lf.evaluate(lens_with(**condition))
        beside = light.by_led[name]
        assert (beside.receivers, beside.limits, beside.flux) == (alone.receivers, alone.limits, alone.flux)
        assert np.array_equal(beside.map, alone.map) and beside.lumens_per_watt == alone.lumens_per_watt
        assert lf.evaluate(lens, state=name).sha256 == alone.sha256
    near, far = light.by_led.values()
    assert near.map.shape != far.map.shape or not np.allclose(near.map, far.map)


def test_results_in_one_state_are_those_of_its_lens(lens: lf.Lens, light: lf.Light, part: lf.Part) -> None:
    far_field = lf.photometry(lens, rays=2**12)
    results = Results(lens, {"evaluate": light, "export": part, "photometry": far_field})
    assert list(results.states) == ["near", "far"]
    for name, state in results.states.items():
        assert state.lens == lens.of_state(name)
        assert state.light.led == name and not state.light.others
        assert state.light.receivers == light.by_led[name].receivers
        assert state.part is part
        in_state = lf.photometry(lens, state=name, rays=2**12)
        assert np.array_equal(state.photometry.candela, in_state.candela)
    assert Results(lens.of_state("far"), {}).states == {}
    with pytest.raises(lf.InputError, match=r"^state = 'middle': no state of that name; known: 'near', 'far'$"):
        lf.evaluate(lens, state="middle")


def test_a_warm_lens_is_warm_in_each_state(lens: lf.Lens) -> None:
    still = [STATES[0], {name: value for name, value in STATES[1].items() if name != "temperature_c"}]
    warm = lf.evaluate(lens_with(source=LED, states=still), rays=1024, temperature_c=80.0)
    for name, condition in BY_HAND.items():
        cold = lens_with(**{**condition, "lens__temperature_c": None})
        alone = lf.evaluate(cold, rays=1024, temperature_c=80.0)
        assert warm.by_led[name].receivers == alone.receivers != lf.evaluate(cold, rays=1024).receivers
    with pytest.raises(
        lf.InputError, match=r"^temperature_c = 80: states of this lens have their own; give the name of one as state"
    ):
        lf.evaluate(lens, temperature_c=80.0)


def test_the_second_state_decides(lens: lf.Lens, light: lf.Light) -> None:
    assert list(light_reasons(light, lens)) == []
    missed = replace(light.others[0].limits[0], limit=0.999).judged()
    other = light.others[0].model_copy(update={"limits": (missed,)})
    ((state, reason),) = light_reasons(light.model_copy(update={"others": (other,)}), lens)
    assert state == "fail" and reason.startswith("middle, far = ")


def test_each_state_has_its_far_field_and_its_files(lens: lf.Lens) -> None:
    measured = lf.photometry(lens, rays=2**12)
    for name, condition in BY_HAND.items():
        alone = lf.photometry(lens_with(**condition), rays=2**12)
        assert np.array_equal(measured.by_led[name].candela, alone.candela)
        assert measured.by_led[name].source_lm == alone.source_lm
    names = set(measured.contents())
    assert {"lens.ies", "lens_far.ies", "lens.ldt", "lens_far.ldt"} <= names
    assert b"far" in measured.contents()["lens_far.ies"] and measured.others[0].source_lm == 30.0


def test_the_part_is_cast_in_each_state(lens: lf.Lens, light: lf.Light, part: lf.Part) -> None:
    proof = lf.verify(part, light, rays=2**13)
    assert list(proof.by_led) == ["near", "far"]
    assert all(fact.holds or fact in proof.facet_misses for fact in proof.all_criteria())
    for name, of_state in proof.by_led.items():
        (receiver,) = of_state.receivers
        assert np.array_equal(receiver.design_irradiance, light.by_led[name].map)
    stray = lf.stray_light(part, rays=256)
    assert list(stray.by_led) == ["near", "far"]


def test_parts_are_measured_in_each_state_as_in_its_condition_alone(lens: lf.Lens) -> None:
    study = PartStudy(Recipe(lens, 3, 1024, 5, 4096))
    every = study.measure(1)
    rows = iter(every)
    for name, condition in BY_HAND.items():
        alone = PartStudy(Recipe(lens_with(**condition), 3, 1024, 5, 4096))
        measured = alone.measure(1)
        assert np.array_equal(measured, [next(rows) for _ in measured])
        assert [f"{name}: {metric}" for metric in alone.names] == [m for m in study.names if m.startswith(f"{name}: ")]
    assert next(rows, None) is None and {bound.metric.split(":")[0] for bound in study.bounds} == {"near", "far"}
    assert list(lf.sensitivity(lens, rays=256).by_led) == ["near", "far"]


def test_states_with_targets_of_their_own_and_lamps_together_have_no_yield(lens: lf.Lens) -> None:
    spec = lens.spec.replace(lamps={"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0})
    with pytest.raises(lf.InputError, match=r"^yield: the state 'far' has a target of its own, and parts of several"):
        lf.tolerance(replace(lens, spec=spec), parts=40, rays=256)
    wide = {**OTHER, "width_mm": 320.0}
    other = lens_with(source=LED, states=[STATES[0], {**STATES[1], "receivers": [wide]}], limits=LIMITS[0])
    with pytest.raises(lf.InputError, match=r"^yield: the first receivers of the states differ in their numbers"):
        lf.tolerance(other, parts=40, rays=256)


def test_the_drawing_names_the_stops_of_an_led_that_moves(lens: lf.Lens) -> None:
    (line,) = travel_notes(lens)
    stops = "near: at (0.05, 0, 0) mm; far: at (0.1, -0.2, 0.05) mm tilted by (6, -3)°"
    assert line == f"The LED moves against the lens; its stops are {stops}."
    still = [{"name": "near"}, {"name": "far", "receivers": [OTHER]}]
    assert not [*travel_notes(lens_with(source=LED, states=still))]
    assert not [*travel_notes(lens_with(source=PLACED))]


def test_what_needs_one_led_says_to_take_a_state(lens: lf.Lens) -> None:
    with pytest.raises(lf.InputError, match=r"^source: this lens has states, .* give the name of one as state$"):
        lf.evaluate(lens, source=lf.DiscSource(diameter_mm=0.3))
    with pytest.raises(lf.InputError, match=r"^redesign: this lens has states, "):
        lf.redesign(lens, lf.DiscSource(diameter_mm=0.3))
    with pytest.raises(lf.InputError, match=r"has states with their LEDs; vary a field of one"):
        lf.sweep(lens.spec, source=[lf.DiscSource(diameter_mm=0.3), lf.DiscSource(diameter_mm=0.4)])


def test_a_whole_run_is_kept_shown_and_read_again(tmp_path: Path, undrawn: None) -> None:
    spec = small_spec(source=LED, states=STATES, limits=LIMITS[0], target__uniform_mm=None, **LAW)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = lf.run(spec, tmp_path / "run", accuracy=FEW_STEPS, force=True)
    again = lf.load(tmp_path / "run")
    assert again == run and again.verdict == run.verdict and list(again.light.by_led) == ["near", "far"]
    assert (tmp_path / "run/lens_far.ies").exists()
    page = (tmp_path / "run/report.html").read_text("utf-8")
    assert "near, at 100 mm" in page and "far, centred at (10, -5, 90) mm" in page
    assert "near: " in task(spec) and "far: lens at 95 °C; " in task(spec)
