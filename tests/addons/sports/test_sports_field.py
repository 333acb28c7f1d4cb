"""Light on playing fields: plain loops over crooked lamps, closed forms, and both sides of a limit."""

from math import acos, atan2, cos, degrees, log10, pi, radians, sin

import numpy as np
import pytest
import torch
from playing_field import FIELD

from lensforge.addons.sports.glare_rating import GlareRating
from lensforge.addons.sports.sports_light import SportsLight
from lensforge.addons.sports.sports_record import SportsJudgement
from lensforge.addons.sports.sports_section import SportsSection
from lensforge.errors import InputError
from lensforge.scene.intensity_limit import CandelaSum


def lobe(azimuth_deg: np.ndarray, gamma_deg: np.ndarray) -> np.ndarray:
    """Candela of a crooked floodlight, brighter beyond its aim and to one side."""
    turn, gamma = np.radians(azimuth_deg), np.radians(gamma_deg)
    wide = 1.0 + 0.6 * np.sin(gamma) * np.cos(turn - 0.4)
    return 60_000.0 * np.exp(-((gamma_deg / 22.0) ** 2)) * wide + 900.0 * np.maximum(np.cos(gamma), 0.0)


def judged(factor: float = 1.0, **fields: object) -> SportsJudgement:
    def candela(light: CandelaSum) -> np.ndarray:
        return factor * lobe(light.azimuth_deg, light.gamma_deg)[None]

    return SportsLight(SportsSection(**FIELD | fields)).judged(candela, "field")


def towards(lamp: dict, point: tuple[float, float, float]) -> tuple[float, np.ndarray]:
    """Candela of a lamp towards a point, and the way there (m)."""
    x, y, z = lamp["place_m"]
    way = np.array(point) - [x, y, z]
    axis = np.array([lamp["aim_m"][0] - x, lamp["aim_m"][1] - y, -z])
    axis /= np.linalg.norm(axis)
    street = np.array([axis[0], axis[1], 0.0]) / np.hypot(axis[0], axis[1]) * -axis[2]
    street[2] = np.hypot(axis[0], axis[1])  # beyond the aim, and up
    # A driver on the street's ground has the lamp at the right: seen along the axis, the street turned to the left.
    beside = np.array(
        [
            axis[1] * street[2] - axis[2] * street[1],
            axis[2] * street[0] - axis[0] * street[2],
            axis[0] * street[1] - axis[1] * street[0],
        ]
    )
    unit = way / np.linalg.norm(way)
    gamma = degrees(acos(unit @ axis))
    azimuth = degrees(atan2(unit @ beside, unit @ street))
    return float(lobe(np.array([azimuth]), np.array([gamma]))[0]) * lamp.get("lamps", 1), way


def by_loops() -> tuple[float, float, float]:
    """Mean and least lux of 21 by 13 points, 5 m apart at most; and the largest rating of 25 eyes in 8 directions."""
    lux = []
    for x in (np.arange(21) - 10.0) / 21.0 * 100.0:
        for y in (np.arange(13) - 6.0) / 13.0 * 60.0:
            here = 0.0
            for lamp in FIELD["floodlights"]:
                candela, way = towards(lamp, (x, y, 0.0))
                here += candela * -way[2] / np.linalg.norm(way) ** 3
            lux.append(here)
    around = 0.035 * 0.25 * np.mean(lux) / pi
    ratings = []
    for x in (-50.0, -25.0, 0.0, 25.0, 50.0):
        for y in (-30.0, -15.0, 0.0, 15.0, 30.0):
            for turn in radians(45.0) * np.arange(8):
                sight = np.array([cos(radians(2.0)) * cos(turn), cos(radians(2.0)) * sin(turn), -sin(radians(2.0))])
                veil = 0.0
                for lamp in FIELD["floodlights"]:
                    candela, way = towards(lamp, (x, y, 1.5))
                    far = np.linalg.norm(way)
                    theta = degrees(acos(-way @ sight / far))
                    if 1.5 < theta < 60.0:
                        veil += 10.0 * candela / far**2 * cos(radians(theta)) / theta**2
                ratings.append(27.0 + 24.0 * log10(max(veil, 1e-9) / around**0.9))
    return float(np.mean(lux)), float(np.min(lux)), max(ratings)


def test_a_crooked_field_by_plain_loops() -> None:
    mean, least, rating = by_loops()
    judgement = judged(maintenance_factor=0.8)
    assert judgement.mean_lx.value == pytest.approx(0.8 * mean, rel=1e-9)
    assert judgement.least_lx.value == pytest.approx(0.8 * least, rel=1e-9)
    assert judgement.uniformity.value == pytest.approx(least / mean, rel=1e-9)
    assert judgement.glare.value == pytest.approx(rating, abs=1e-9) and 20.0 < rating < 80.0


def test_glare_hardly_changes_with_the_flux() -> None:
    """L_vl grows with it, L_ve^0.9 with its power 0.9."""
    assert judged(10.0).glare.value - judged().glare.value == pytest.approx(2.4, abs=1e-9)


def test_a_class_is_held_on_one_side_of_its_mean_alone() -> None:
    most = {"lighting_class": "tennis III", "floodlights": FLAT, "length_m": 2.0, "width_m": 2.0}
    whole = judged(**most).mean_lx.value
    for off in (1e-9, -1e-9):
        judgement = judged(200.0 / whole * (1.0 + off), **most)
        mean, even, glare = judgement.limits
        assert mean.holds == (off > 0.0) and even.holds and glare.holds
        assert judgement.reached == ("tennis III" if off > 0.0 else "none")


# Lamps high above a small field light it evenly, and stand beyond 60 degrees from every view.
FLAT = [{"place_m": [0.0, 0.0, 100.0], "aim_m": [0.0, 0.1]}]


def test_lamps_out_of_sight_do_not_glare() -> None:
    assert judged(floodlights=FLAT, length_m=2.0, width_m=2.0).glare.value == 10.0


def test_the_search_follows_the_rating() -> None:
    """1 at the bound for the eye that has it; gradients by finite differences."""
    light = np.array([0.3, 0.8, 0.5, 0.6])
    rating = GlareRating().value(light[None], "<=", "", light[None]).value
    assert rating == pytest.approx(27.0 + 24.0 * log10(0.8 / 0.6**0.9))
    assert GlareRating().relative(light, rating, light)[1] == pytest.approx(1.0)
    leaf = torch.tensor(light, requires_grad=True)
    GlareRating().relative(leaf, 50.0, leaf).sum().backward()
    steps = 1e-6 * np.eye(4)
    sides = ([GlareRating().relative(light + sign * s, 50.0, light).sum() for s in steps] for sign in (1.0, -1.0))
    assert leaf.grad is not None and leaf.grad.numpy() == pytest.approx(np.subtract(*sides) / 2e-6, rel=1e-6)


def test_the_error_of_the_rating_has_both_parts() -> None:
    """Of 16 replicates whose veil and environment vary by themselves, to first order."""
    random = np.random.default_rng(4)
    readings = np.array([0.8, 0.6]) * (1.0 + 0.02 * random.standard_normal((16, 2)))
    rating = GlareRating().value(readings, "<=", "", readings)
    veil, around = readings.std(axis=0, ddof=1) / 4.0 / readings.mean(axis=0)
    assert rating.standard_error == pytest.approx(24.0 / np.log(10.0) * np.hypot(veil, 0.9 * around), rel=0.02)
    dark = np.zeros((1, 2))
    assert GlareRating().value(dark, "<=", "", dark).value == 1e6


def test_a_lamp_that_hangs_straight_down_is_refused() -> None:
    with pytest.raises(InputError, match=r"is the foot of place_m: a lamp that hangs straight down has no street"):
        SportsSection(**FIELD | {"floodlights": [{"place_m": [1.0, 2.0, 9.0], "aim_m": [1.0, 2.0]}]})
