"""States of a spec: each is the spec that one would write for it alone, and what cannot be is told in a line."""

from pathlib import Path
from typing import Any

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.sources.build_source import build_source, summarise
from lensforge.spec import Spec, parse_spec

LED = {"kind": "square", "side_mm": 0.4, "position_mm": [0.1, 0.0, 0.05], "tilt_deg": [0.0, 4.0], "rotate_z_deg": 30.0}
DISC = {"kind": "disc", "diameter_mm": 0.5}
FLOOD = {"kind": "beam", "fwhm_deg": 50.0}
LIMIT = {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 40.0}, "at_least_share": 0.3}
ON_WALL = {"kind": "plane", "centre_mm": [0.0, 0.0, 90.0], "width_mm": 200.0, "height_mm": 200.0,
           "targets": [{"kind": "disc", "diameter_mm": 60.0, "centre_mm": [20.0, 0.0]}]}  # fmt: skip
STATES: list[dict[str, Any]] = [
    {"name": "near"},
    {"name": "moved", "weight": 3.0, "shift_mm": [-0.3, 0.2, 0.1], "tilt_deg": [5.0, -2.0]},
    {"name": "flood", "source": DISC, "target": FLOOD, "limits": [LIMIT]},
    {"name": "wall", "receivers": [ON_WALL]},
]


def spec_with(states: list[dict[str, Any]], **changes: Any) -> Spec:
    return small_spec(**{"source": LED, "states": states, **changes})


def test_each_state_is_the_spec_of_its_condition_alone() -> None:
    spec = spec_with(STATES)
    moved = {**LED, "position_mm": [0.1 - 0.3, 0.2, 0.05 + 0.1], "tilt_deg": [5.0, 2.0]}
    assert spec.by_state == {
        "near": small_spec(source=LED),
        "moved": small_spec(source=moved),
        "flood": small_spec(source=DISC, target=FLOOD, limits=[LIMIT]),
        "wall": small_spec(source=LED, target=None, receivers=[ON_WALL]),
    }
    assert [spec.of_state(name) for name in spec.by_state] == list(spec.by_state.values())
    assert spec.of_state("") is spec and [state.weight for state in spec.all_states] == [1.0, 3.0, 1.0, 1.0]
    assert spec.by_state["flood"].target.half_angle_deg == pytest.approx(66.7), "4/3 of the beam, derived as alone"
    with pytest.raises(lf.InputError, match="state = 'spot': no state of that name; known: 'near', 'moved', 'flood'"):
        spec.of_state("spot")
    with pytest.raises(lf.InputError, match=r"state = 'spot': .* known: none, the lens has one condition"):
        small_spec().of_state("spot")


def test_leds_of_sources_are_states_weighted_by_their_shares() -> None:
    leds = [{"name": "one", "share": 2.0, "source": LED}, {"name": "two", "source": DISC}]
    by_sources = small_spec(source=None, sources=leds)
    by_states = small_spec(source=LED, states=[{"name": "one", "weight": 2.0}, {"name": "two", "source": DISC}])
    assert by_sources.by_state == by_states.by_state
    assert [state.weight for state in by_sources.all_states] == [state.weight for state in by_states.all_states]


CHIPS = {"kind": "chips", "position_mm": [0.2, 0.0, 0.0], "chips": [
    {"x_mm": x, "y_mm": 0.1, "width_mm": 0.4, "height_mm": 0.3, "flux_lm": lm} for x, lm in ((-0.5, 30.0), (0.5, 90.0))
]}  # fmt: skip
ARRAY = {"kind": "chip_array", "columns": 3, "rows": 2, "width_mm": 0.2, "height_mm": 0.1, "pitch_mm": [0.3, 0.4],
         "rotate_z_deg": 5.0}  # fmt: skip


def lit(chips: Any, dimming: list[float], **changes: Any) -> Any:
    """The LED in a state that dims its chips."""
    states = [{"name": "a", "dimming": dimming}, {"name": "whole"}]
    return spec_with(states, source={**chips, **changes}).by_state["a"].source


def test_dimmed_chips_give_their_shares_of_the_flux_and_dark_ones_are_left_out() -> None:
    left, right = CHIPS["chips"]
    assert lit(CHIPS, [0.0, 0.5]) == lf.ChipsSource(**{**CHIPS, "chips": [{**right, "flux_lm": 45.0}]})
    assert lit(CHIPS, [0.0, 0.5]).title == "source of 1 chip at (0.2, 0, 0) mm"
    half = lit(CHIPS, [1.0, 0.5], flux_w=2.0)
    assert half.flux_w == pytest.approx(2.0 * 75.0 / 120.0, rel=1e-15), "the ratio of the chips alone counts there"
    assert [chip.flux_lm for chip in half.chips] == [left["flux_lm"], 45.0]
    assert lit(LED, [0.25], flux_lm=80.0) == lf.SquareSource(**{**LED, "flux_lm": 20.0})


def test_chips_of_an_array_are_dimmed_row_by_row_from_the_corner_at_minus_x_and_minus_y() -> None:
    dimmed = lit(ARRAY, [0.0, 1.0, 0.0, 0.0, 0.0, 0.5])
    places = [(chip.x_mm, chip.y_mm, chip.flux_w) for chip in dimmed.chips]
    assert places == [pytest.approx((0.0, -0.2, 1.0 / 6.0)), pytest.approx((0.3, 0.2, 0.5 / 6.0))]
    assert dimmed.pose == lf.ChipArraySource(**ARRAY).pose
    whole = summarise(build_source(lf.ChipArraySource(**ARRAY)), lf.ChipArraySource(**ARRAY)).flux_w
    assert summarise(build_source(dimmed), dimmed).flux_w == pytest.approx(whole * 1.5 / 6.0)


def test_a_state_has_its_temperature_and_its_wavelength() -> None:
    coloured = {"kind": "line", "wavelength_nm": 630.0}
    chips = {**CHIPS, "chips": [{**chip, "spectrum": coloured} for chip in CHIPS["chips"]]}
    states = [{"name": "cold", "temperature_c": -40.0}, {"name": "blue", "wavelength_nm": 450.0}, {"name": "plain"}]
    spec = spec_with(states, source=chips, lens__material="PMMA", lens__index_per_k=-1e-4, lens__expansion_per_k=7e-5)
    cold, blue, plain = spec.by_state.values()
    assert cold == plain.replace({"lens.temperature_c": -40.0}) and plain.lens.scale == 1.0
    assert cold.lens.scale == pytest.approx(1.0 - 60.0 * 7e-5, rel=1e-15)
    assert cold.media.body.index(None)[0] == pytest.approx(plain.media.body.index(None)[0] + 6e-3, abs=1e-15)
    line = {"kind": "line", "wavelength_nm": 450.0}
    assert blue == plain.replace(source={**CHIPS, "spectrum": line})
    assert "temperature_c" not in plain.model_dump()["lens"] and "temperature_c" in cold.model_dump()["lens"]


def test_the_first_state_gives_what_the_spec_leaves_out() -> None:
    states = [{"name": "a", "source": DISC, "shift_mm": [0.0, 0.0, 0.1], "target": FLOOD}, {"name": "b", "source": LED}]
    spec = small_spec(source=None, target=None, states=states)
    assert spec.in_first_state == small_spec(source={**DISC, "position_mm": [0.0, 0.0, 0.1]}, target=FLOOD)
    assert spec.by_state["b"] == small_spec(source=LED, target=FLOOD)


def test_a_spec_with_states_is_written_and_read_and_one_without_is_as_it_was(tmp_path: Path) -> None:
    spec = spec_with(STATES)
    spec.save(tmp_path / "small.toml")
    assert lf.load_spec(tmp_path / "small.toml") == spec == parse_spec(spec.model_dump(mode="json"), "dump")
    assert "states" not in small_spec().model_dump() and "states" in spec.model_dump()


def test_the_cavity_has_room_for_the_led_in_every_state() -> None:
    """Its radius is 1.2 times that of the circle about the axis that holds every place of the chip."""
    states = [{"name": "a"}, {"name": "b", "shift_mm": [0.9, 1.2, 0.0]}]
    spec = small_spec(states=states, constraints={"max_radius_mm": 12.0}, base={"kind": "none"})
    assert spec.constraints.cavity_radius_mm == pytest.approx(1.2 * (0.5**0.5 + 1.5), abs=0.005)


@pytest.mark.parametrize(
    ("states", "changes", "line"),
    [
        ([{"name": "a"}, {"name": "b"}], {}, "states: 'a' and 'b' do not differ; change LED, place, temperature"),
        ([{"name": "A"}, {"name": "a", "tilt_deg": [0.0, 1.0]}], {}, "states: 'A' and 'a' differ by letter case alone"),
        ([{"name": "a", "tilt_deg": [0.0, 1.0]}], {}, "states: 'a' is the only one; add another, or state it in the"),
        ([{"name": "a"}, {"name": "b", "shift": [0.0, 0.0, 1.0]}], {}, "states.1.shift = .*unknown; did you mean"),
        (
            [{"name": "a"}, {"name": "b", "target": FLOOD, "receivers": [ON_WALL]}],
            {},
            "states.1: target and receivers: both are given",
        ),
        (
            [{"name": "a"}, {"name": "b", "receivers": [{**ON_WALL, "centre_mm": [0.0, 0.0, 5.0]}]}],
            {},
            "states: b: receivers.centre_mm: distance of the plane = 5 is inside the lens",
        ),
        (
            [{"name": "a"}, {"name": "b", "limits": [{**LIMIT, "receiver": "wall"}]}],
            {},
            "states: b: limits.*wall",
        ),
        (
            STATES[:2],
            {"sources": [{"name": "x", "source": LED}, {"name": "y", "source": DISC}]},
            "states and sources: both are given; give each LED as the source of a state",
        ),
        (
            [{"name": "a", "temperature_c": 80.0}, {"name": "b"}],
            {},
            "states: a: temperature_c = 80: nothing is known of how PMMA at 564 nm changes with it; give lens.index",
        ),
        ([{"name": "a", "temperature_c": 401.0}, {"name": "b"}], {}, "states.0.temperature_c = 401.0: must be"),
        (
            [{"name": "a", "wavelength_nm": 450.0}, {"name": "b"}],
            {},
            "states: a: wavelength_nm = 450: PMMA at 564 nm has one index at all wavelengths; name a material",
        ),
        ([{"name": "a", "dimming": [1, 0]}, {"name": "b"}], {}, "dimming: 2 numbers, must be 1: a 0.4 mm square Lam"),
        ([{"name": "a", "dimming": [0.5]}, {"name": "b"}], {}, "a: dimming: the flux of the LED is not stated; give"),
        ([{"name": "a", "dimming": [1.1, 0]}, {"name": "b"}], {"source": CHIPS}, "states.0.dimming.0 = 1.1: must be"),
        ([{"name": "a", "dimming": [1]}, {"name": "b"}], {"source": CHIPS}, "dimming: 1 numbers, must be 2: one for e"),
        ([{"name": "a", "dimming": [0, 0]}, {"name": "b"}], {"source": CHIPS}, "dimming: no light is left; give a num"),
        (
            [{"name": "a", "dimming": [0, 1]}, {"name": "b", "dimming": [0, 0.5]}],
            {"source": CHIPS},
            "states: chip 1 is lit in none; light it in a state, or leave it out of the source",
        ),
        (STATES[2:], {"evaluate__window_mm": 50.0}, "states: flood: evaluate.window_mm = 50 goes with a target on a"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_told_in_one_line(states: list[dict[str, Any]], changes: dict[str, Any], line: str) -> None:
    with pytest.raises(lf.InputError, match=line) as refusal:
        spec_with(states, **changes)
    assert len(str(refusal.value).splitlines()) == 1
