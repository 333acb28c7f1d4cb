"""States in a search: the symmetry that all of them have, and room for the LED at every stop and between them."""

from pathlib import Path
from typing import Any

import pytest
from presets import FEW
from scenes import small_spec

import lensforge as lf
from lensforge.light.lens_light import searched_source
from lensforge.search.automatic_schedule import preset_for
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.search.travel import require_clear_travel, travelled
from lensforge.spec import Spec

# cavity_height_mm = 0.5, cavity_radius_mm = 1: z = 0.5 (1 - s^2) is the highest place at s from the axis
BAR = {"kind": "rectangle", "width_mm": 1.2, "height_mm": 0.02}
CHIP = {"kind": "square", "side_mm": 0.4}


def _spec(source: dict[str, Any], *states: dict[str, Any], **changes: Any) -> Spec:
    named = [{"name": name, **state} for name, state in zip("abc", states, strict=False)]
    return small_spec(source=source, states=named, target__uniform_mm=None, **changes)


@pytest.mark.parametrize(
    ("second", "symmetry"),
    [
        ({"shift_mm": [0.0, 0.0, 0.1]}, "square"),
        ({"shift_mm": [0.2, 0.0, 0.0]}, "mirror_y"),
        ({"shift_mm": [0.2, 0.1, 0.0]}, "none"),
        ({"tilt_deg": [3.0, 0.0]}, "mirror_x"),
        ({"target": {"kind": "rectangle", "width_mm": 90.0, "height_mm": 60.0, "distance_mm": 100.0}}, "rectangle"),
        ({"limits": [{"kind": "zone", "zone": {"kind": "disc", "diameter_mm": 40.0, "centre_mm": [0.0, 30.0]},
                      "at_least_share": 0.01}]}, "mirror_x"),
    ],
)  # fmt: skip
def test_a_lens_has_the_symmetry_of_all_states(second: dict[str, Any], symmetry: str) -> None:
    spec = _spec(CHIP, {}, second, lens__symmetry="auto")
    assert settled_symmetry(spec, searched_source(spec)).lens.symmetry == symmetry
    forced = _spec(CHIP, {}, second, lens__symmetry="square")
    if symmetry != "square":
        with pytest.raises(lf.InputError, match=r"lens\.symmetry = 'square': "):
            settled_symmetry(forced, searched_source(forced))


def test_limits_on_places_of_the_second_state_alone_ask_for_their_rays() -> None:
    """A preset takes more rays where a limit reads single places, in any state."""
    zone = {"kind": "zone", "zone": {"kind": "disc", "diameter_mm": 60.0}}
    moved = {"shift_mm": [0.0, 0.0, 0.1]}
    shares, places = (
        preset_for(
            _spec(CHIP, {}, {**moved, "limits": [{**zone, **bound}]}, lens__levels="auto", optimise={"pixels": 128}),
            "draft",
        )
        for bound in ({"at_least_share": 0.1}, {"at_least_min_over_max": 0.1})
    )
    assert places.design_rays > shares.design_rays


def test_a_travel_is_straight_and_turns_in_proportion() -> None:
    first, last = (lf.SquareSource(side_mm=1.0, position_mm=p, tilt_deg=t)
                   for p, t in (((0.0, 1.0, -2.0), (10.0, 0.0)), ((4.0, 1.0, 2.0), (-10.0, 8.0))))  # fmt: skip
    middle = travelled(first, last, 0.25)
    assert middle.position_mm == (1.0, 1.0, -1.0) and middle.tilt_deg == (5.0, 2.0)
    assert travelled(first, last, 0.0) == first and travelled(first, last, 1.0) == last


def test_an_led_that_meets_the_lens_between_two_stops_is_refused() -> None:
    """A bar that lies flat at both stops stands upright between them: its end is 0.6 mm high, the cavity 0.5 mm."""
    flat, turned = {"tilt_deg": [0.0, 0.0]}, {"tilt_deg": [0.0, 180.0]}
    meets = _spec(BAR, flat, turned)
    with pytest.raises(lf.InputError, match=r"^source: it reaches .*; the LED is between the states 'a' and 'b'$"):
        require_clear_travel(meets)
    low = {"tilt_deg": [0.0, 180.0], "shift_mm": [0.0, 0.0, -0.2]}
    assert require_clear_travel(_spec(BAR, {"shift_mm": [0.0, 0.0, -0.2]}, low)) == ()
    other = {**turned, "source": {**BAR, "width_mm": 1.1}}
    assert require_clear_travel(_spec(BAR, flat, other)) == (), "another LED does not travel"
    leds = [{"name": name, "source": {**BAR, **place}} for name, place in (("a", flat), ("b", turned))]
    assert require_clear_travel(small_spec(source=None, sources=leds)) == (), "nor do those of which one is built in"


@pytest.mark.parametrize(
    ("states", "pair"),
    [
        (({"shift_mm": [0.0, 0.0, -0.3]}, {"tilt_deg": [0.0, 0.0]}, {"tilt_deg": [0.0, 180.0]}), ("b", "c")),
        (({"tilt_deg": [0.0, 0.0]}, {"shift_mm": [0.0, 0.0, -0.6]}, {"tilt_deg": [0.0, 180.0]}), ("a", "c")),
    ],
)
def test_between_any_two_stops_there_must_be_room(states: tuple[dict[str, Any], ...], pair: tuple[str, str]) -> None:
    with pytest.raises(lf.InputError, match=f"between the states '{pair[0]}' and '{pair[1]}'$"):
        require_clear_travel(_spec(BAR, *states))


def test_a_stop_at_which_the_led_meets_the_lens_is_refused_and_named() -> None:
    """The corners of the chip are at s^2 = 0.08: 0.46 mm is the highest place."""
    below, above = (_spec(CHIP, {}, {"shift_mm": [0.0, 0.0, 0.46 + side]}) for side in (-1e-3, 1e-3))
    settings: Any = {"accuracy": FEW, "progress": lambda _: False, "warn": lambda _: None, "force": True}
    with pytest.raises(lf.Cancelled):
        lf.design(below, **settings)
    with pytest.raises(lf.InputError, match=r"^source: it reaches .* raise the limits, .*; the state is b$"):
        lf.design(above, **settings)


def test_solids_that_stay_while_the_led_moves_are_a_warning(tmp_path: Path) -> None:
    import cadquery as cq

    path = tmp_path / "package.step"
    cq.exporters.export(cq.Workplane().box(0.5, 0.5, 0.1), str(path))
    moved = _spec(CHIP, {}, {"shift_mm": [0.0, 0.0, -0.2]}, constraints__keep_out=str(path))
    (warning,) = require_clear_travel(moved)
    assert warning.startswith("constraints.keep_out: its solids stay where they are")
    target = {"kind": "rectangle", "width_mm": 90.0, "height_mm": 60.0, "distance_mm": 100.0}
    assert require_clear_travel(_spec(CHIP, {}, {"target": target}, constraints__keep_out=str(path))) == ()
