"""Rows of roads in tables of the suite."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from far_fields import SMALL_IES

from lensforge.addons.road.road_command import road as road_command
from lensforge.addons.road.road_field import RoadReadings
from lensforge.addons.road.road_judgement import judge_road
from lensforge.addons.road.road_record import RoadJudgement
from lensforge.addons.road.road_section import RoadSection
from lensforge.addons.road.road_surface import RoadSurface

Case = tuple[object, object]  # found, and by hand
ROAD = {"width_m": 6.0, "pole_height_m": 8.0, "pole_spacing_m": 30.0, "lanes": 2}


def judged(candela: float = 4000.0, **fields: Any) -> RoadJudgement:
    """A road lit by lamps of the same intensity in all directions."""
    road = RoadSection(**{**ROAD, "lighting_class": "M3", **fields})
    return judge_road(road, lambda light: np.full((1, len(light.azimuth_deg)), candela))


def arrangement(name: str) -> Case:
    """Mean and least lux at 10 x 6 points, I h / d^3 of each lamp of the rows, and the edge that has more light."""
    rows = {"right": [(0.0, -1.0)], "left": [(0.0, 7.0)], "opposite": [(0.0, -1.0), (0.0, 7.0)],
            "staggered": [(0.0, -1.0), (15.0, 7.0)], "median": [(0.0, 7.0), (0.0, 9.0)]}[name]  # fmt: skip
    more = {"median_m": 4.0} if name == "median" else {}
    x, y = np.meshgrid((np.arange(10) + 0.5) * 3.0, (np.arange(6) + 0.5))
    total = 0.0 * x
    for start, across in rows:
        for number in range(-40, 41):
            away = (x - start - 30.0 * number) ** 2 + (y - across) ** 2 + 64.0
            total += np.where(away - 64.0 <= 40.0**2, 4000.0 * 8.0 / away**1.5, 0.0)  # up to 5 heights
    judgement = judged(arrangement=name, overhang_m=-1.0, maintenance_factor=1.0, **more)
    right, left = (edge.value for edge in judgement.edges)
    brighter = {"right": 1, "left": -1, "median": -1}.get(name, 0)
    figures = judgement.mean_lx.value, judgement.least_lx.value, int(np.sign(round(right - left, 9)))
    return figures, (pytest.approx(total.mean(), rel=2e-3), pytest.approx(total.min(), rel=0.03), brighter)


RATIOS = {  # of RP-8-14, table 2: cd/m^2, mean over least, largest over least, veiling
    "freeway A": (0.6, 3.5, 6.0, 0.3), "freeway B": (0.4, 3.5, 6.0, 0.3), "expressway": (1.0, 3.0, 5.0, 0.3),
    "major high": (1.2, 3.0, 5.0, 0.3), "major medium": (0.9, 3.0, 5.0, 0.3), "major low": (0.6, 3.5, 6.0, 0.3),
    "collector high": (0.8, 3.0, 5.0, 0.4), "collector medium": (0.6, 3.5, 6.0, 0.4),
    "collector low": (0.4, 4.0, 8.0, 0.4), "local high": (0.6, 6.0, 10.0, 0.4), "local medium": (0.5, 6.0, 10.0, 0.4),
    "local low": (0.3, 6.0, 10.0, 0.4),
}  # fmt: skip
LUX = {"C0": 50.0, "C1": 30.0, "C2": 20.0, "C3": 15.0, "C4": 10.0, "C5": 7.5}
LUMINANCE = {
    "M1": (2.0, 0.4, 0.7, 10.0, 0.35), "M2": (1.5, 0.4, 0.7, 10.0, 0.35), "M3": (1.0, 0.4, 0.6, 15.0, 0.3),
    "M4": (0.75, 0.4, 0.6, 15.0, 0.3), "M5": (0.5, 0.35, 0.4, 15.0, 0.3), "M6": (0.3, 0.35, 0.4, 20.0, 0.3),
}  # fmt: skip
PATHS = {"P1": (15.0, 3.0), "P2": (10.0, 2.0), "P3": (7.5, 1.5), "P4": (5.0, 1.0), "P5": (3.0, 0.6), "P6": (2.0, 0.4)}


def lighting_class(name: str) -> Case:
    """All bounds that the class asks for, each value once."""
    bounds = {limit.bound for limit in judged(lighting_class=name).limits}
    if name in PATHS:
        mean, least = PATHS[name]
        return bounds, {mean, least, 1.5 * mean}
    if name in LUX:
        return bounds, {LUX[name], 0.4}
    return bounds, set(LUMINANCE.get(name) or RATIOS[name])


def driving_side(side: str) -> Case:
    """The eye of the first lane, 1.5 m from the edge on that side."""
    readings = RoadReadings.of(RoadSection(**ROAD, lighting_class="M3", driving_side=side))
    return readings.seen[0][0].y, {"right": pytest.approx(1.5), "left": pytest.approx(4.5)}[side]


def wet_surface(name: str) -> Case:
    added = {limit.bound for limit in judged(wet_surface=name).limits} - {limit.bound for limit in judged().limits}
    return added, {0.15}


WRONG_FIELDS = {  # changes of a spec, and the line that they make
    "field": (
        {"photometry": {"use": "area", "pole_height_m": 8.0}},
        "photometry.pole_height_m = 8.0: unknown; it belongs",
    ),
    "table": ({"roads": {"name": "x"}}, "roads: must be a list of tables: write [[roads]]"),
}
CHOICES = {
    "arrangement": arrangement,
    "RoadSection.lighting_class": lighting_class,
    "driving_side": driving_side,
    "wet_surface": wet_surface,
}
CHOSEN_ELSEWHERE = dict.fromkeys(("RoadSection.surface", "edition"), "addons/road/test_road_field.py")
CACHES = {
    "addons.road.road_surface._standard": (
        lambda name: RoadSurface.of(name, None, None).r,
        [("R1",), ("R3",), ("C2",)],
    ),
}


ROADS = "[[roads]]\nlighting_class = 'P5'\nwidth_m = 6.0\npole_height_m = 5.0\npole_spacing_m = 20.0\nlamp_lm = {}\n"


def printed(*arguments: object) -> str:
    """What the command prints, whether the road is held or not."""
    return CliRunner().invoke(road_command, [str(argument) for argument in arguments]).stdout


def of_road(flag: str, here: Path) -> bool:
    """Lux of a lamp whose street is at C = 0: twice as many lumens, the street behind it, spacing."""
    (here / "lamp.ies").write_text(SMALL_IES)
    for name, lumens in (("a", 1e3), ("b", 2e3)):
        (here / f"{name}.toml").write_text(ROADS.format(lumens))

    def lux(*more: object, roads: str = "a") -> float:
        record = json.loads(printed(here / "lamp.ies", "--road", here / f"{roads}.toml", "--json", *more))
        return float(record["roads"][0]["mean_lx"]["value"])

    match flag:
        case "--road":
            return lux(roads="b") == pytest.approx(2.0 * lux(), rel=1e-9)
        case "--street-c":
            return lux("--street-c", "0") > 1.1 * lux("--street-c", "180")
        case "--spacing":
            screens = [printed(here / "lamp.ies", "--road", here / "b.toml", *flags) for flags in ((), (flag,))]
            return "spacing" in screens[1].lower() and "spacing" not in screens[0].lower()
    return printed(here / "lamp.ies", "--road", here / "b.toml", "--quiet") == ""


SHOWN = {"road": (of_road, ("--road", "--street-c", "--spacing", "--json", "--quiet"))}
