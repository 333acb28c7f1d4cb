"""Limits in a spec: what they may say, in which units, and where they may lie; each mistake is one line."""

import tomllib

import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.spec import Spec, parse_spec

FAR = {"target": {"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}}


def far(*limits: dict[str, object]) -> Spec:
    return small_spec(**FAR).replace(limits=limits)


SEEN = {"kind": "luminance", "eyes_mm": [[0.0, 300.0, 900.0]], "unit": "cd_per_m2", "at_most": 3e4}
EYES = "give one of eyes_mm, places .* eyes_deg, directions .* and from_deg"
GOOD = [
    {"kind": "points", "at_deg": [[0, 0], [10, -5]], "unit": "cd", "at_least": 10.0, "at_most": 20.0},
    {"kind": "line", "from_deg": [-10, 0], "to_deg": [10, 0], "unit": "relative", "at_least": 0.5},
    {"kind": "zone", "unit": "w_per_sr", "at_most": 3.0},
    {"kind": "zone", "zone": {"kind": "ring", "inner_diameter_deg": 20.0, "outer_diameter_deg": 40.0},
     "at_least_min_over_mean": 0.5, "at_least_share": 0.2},
    {"kind": "glare", "from_deg": 45.0, "unit": "cd", "at_most": 2.0, "name": "glare", "receiver": "light"},
    {"kind": "beam_angle", "at_least_deg": 20.0, "at_most_deg": 40.0, "azimuth_deg": 90.0},
    {"kind": "luminance", "eyes_mm": [[0.0, 300.0, 900.0]], "unit": "cd_per_m2", "at_most": 3e4, "spot_deg": 0.1},
]  # fmt: skip


@pytest.mark.parametrize("limit", GOOD, ids=lambda limit: str(limit["kind"]))
def test_a_limit_survives_the_round_trip_through_toml(limit: dict[str, object]) -> None:
    spec = far(limit)
    assert parse_spec(tomllib.loads(spec.to_toml()), "again") == spec
    assert parse_spec(spec.model_dump(mode="json"), "with all defaults") == spec


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ({"kind": "points", "at_deg": [[0, 0]]}, "sets no limit"),
        ({"kind": "points", "unit": "cd", "at_least": 1.0}, "at_mm: missing"),
        ({"kind": "points", "at_deg": [[0, 0]], "unit": "cd", "at_least": 3.0, "at_most": 2.0}, "no light is both"),
        ({"kind": "points", "at_deg": [[0, 0]], "unit": "lx", "at_least": 3.0}, "in one of w_per_sr, cd"),
        ({"kind": "points", "at_mm": [[0, 0]], "unit": "cd", "at_least": 3.0}, "they are in degrees"),
        ({"kind": "points", "at_deg": [[50, 50]], "unit": "cd", "at_least": 3.0}, "reaches 60 deg"),
        ({"kind": "line", "from_deg": [0, 0], "unit": "cd", "at_least": 3.0}, "to_deg: missing; give it, in degrees"),
        ({"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 5.0, "level": 2.0}, "unit": "cd", "at_most": 1.0},
         "zone.level"),
        ({"kind": "glare", "from_deg": 70.0, "unit": "cd", "at_most": 1.0}, "reaches 60 deg"),
        ({"kind": "glare", "from_deg": 50.0, "unit": "cd", "at_least": 1.0}, "no least one"),
        ({"kind": "beam_angle", "unit": "cd", "at_most": 1.0}, "at_least_deg and at_most_deg"),
        ({"kind": "zone", "unit": "cd", "at_most": 1.0, "receiver": "wall"}, "none of that name; known: light"),
        ({"kind": "zone", "unit": "cd_per_m2", "at_most": 1.0}, "in one of w_per_sr, cd, relative"),
        (SEEN | {"eyes_deg": [[0, 50]], "spot_mm": 1.0}, EYES),
        ({"kind": "luminance", "unit": "cd_per_m2", "at_most": 1.0}, EYES),
        (SEEN | {"at_least": 0.5}, "has a largest value"),
        (SEEN | {"unit": "cd"}, "unit: w_per_m2_sr, cd_per_m2"),
        (SEEN | {"receiver": "light"}, "eyes see the lens itself; leave it out"),
        (SEEN | {"spot_mm": 1.0, "spot_deg": 1.0}, "spot_deg and spot_mm are given"),
        (SEEN | {"eyes_mm": None, "eyes_deg": [[0, 50]]}, "spot_mm: missing; eyes far away are at no distance"),
        ({"kind": "luminance", "eyes_mm": [[0, 0, 900]]}, "sets no limit"),
    ],
)  # fmt: skip
def test_a_wrong_limit_is_refused_in_one_line(limit: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        far(limit)
    assert "\n" not in str(refusal.value) and "limits.0" in str(refusal.value)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ({"kind": "glare", "from_deg": 5.0, "unit": "relative", "at_most": 0.1}, "one of the far field"),
        ({"kind": "beam_angle", "at_least_deg": 5.0}, "one of the far field"),
        (
            {"kind": "points", "at_mm": [[0, 0]], "unit": "cd", "at_least": 3.0},
            "in one of w_per_m2, mw_per_cm2, mj_per_cm2, lx",
        ),
        ({"kind": "points", "at_mm": [[1000, 0]], "unit": "lx", "at_least": 3.0}, "is off receiver 'light'"),
    ],
)
def test_on_a_plane_light_is_irradiance_and_has_no_angles(limit: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        small_spec().replace(limits=[limit])
