"""Roads and tables of their surfaces at random: each is used, or refused in one printable line.

LENSFORGE_FUZZ=10: 3,000 cases of each, of which the day has some.
"""

import random
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import tomli_w
from annotated_types import Ge, Gt, Le, Lt
from nightly import scaled
from one_line import require_line
from pydantic import BaseModel
from test_hostile_lists import changed, varied

import lensforge as lf
from lensforge.addons.road.road_facts import road_facts
from lensforge.addons.road.road_judgement import held_spacing, judge_road
from lensforge.addons.road.road_section import STANDARD_SURFACES, RoadSection, load_roads
from lensforge.addons.road.road_surface import RoadSurface
from lensforge.light.by_intensities import of_file
from lensforge.sources.photometric import PhotometricFile, read_photometric
from lensforge.spec.spec_section import section_of

SURFACES = Path(lf.__file__).parent / "addons" / "road" / "road_surfaces"
ROAD = {"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0}
_CASES, _BY_DAY = 300, 20
_EXTREMES = (0.0, -1.0, 1e-320, 1e308, -1e308, 1e-9, 0.5, 1.0, 12, 10**30, True, "", "a", [], {})


@pytest.fixture(autouse=True)
def own_warnings_alone() -> Iterator[None]:
    """A warning is an error, unless it says in which of two ways a file is read."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", lf.FileWarning)
        yield


@cache
def lamp() -> PhotometricFile:
    return read_photometric(Path(__file__).parents[3] / "examples" / "street_light.ies")


def finite(value: object) -> bool:
    """True where all numbers of a record are finite."""
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, list | tuple):
        return all(map(finite, value))
    return not isinstance(value, float) or np.isfinite(value)


def judged(road: RoadSection) -> None:
    judgement = judge_road(road, of_file(lamp(), 90.0, road.lamp_lm))
    assert finite(judgement.model_dump()) and road_facts(judgement, road).plain()


def surface(path: Path, road: RoadSection) -> None:
    """The surface of a road, as a driver has it, and scaled."""
    for q0 in (None, 0.07):
        used = RoadSurface.of("", path, q0)
        assert np.isfinite(used.r).all() and used.q0 > 0.0 and (used.s1 is None or used.s1 >= 0.0)
    judged(road)


def test_a_changed_table_of_a_surface_is_used_or_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "surface.csv"
    road = RoadSection(**ROAD, surface_file=path)
    short = b"t;0;90;180\r\n0;300,5;300;300\r\n1,5;100;80;\r\n3;50;;\r\n"
    contents = [short, *((SURFACES / f"{name}.csv").read_bytes() for name in STANDARD_SURFACES)]
    for number in range(scaled(_CASES, by_day=_BY_DAY)):
        path.write_bytes(varied(contents[number % len(contents)], random.Random(f"surface {number}")))
        require_line(lambda: surface(path, road), f"surface {number}")


def any_of(kind: type[BaseModel], name: str, chance: random.Random) -> Any:
    """A value of a field, by its type: one of its choices, within its bounds, at them, or none that it may have."""
    if chance.random() < 0.1:
        return chance.choice(_EXTREMES)
    field = kind.model_fields[name]
    parts = [field.annotation, *get_args(field.annotation)]
    texts = [text for part in parts for text in get_args(part) or () if isinstance(text, str)]
    texts += [text for text in parts if isinstance(text, str)]
    if texts:
        return chance.choice(texts)
    marks = [
        *field.metadata,
        *(mark for part in parts for annotation in get_args(part)[1:] for mark in _marks(annotation)),
    ]
    lows = [mark.ge if isinstance(mark, Ge) else mark.gt for mark in marks if isinstance(mark, Ge | Gt)]
    highs = [mark.le if isinstance(mark, Le) else mark.lt for mark in marks if isinstance(mark, Le | Lt)]
    if not (lows and highs):
        return chance.choice(("road", "surface.csv", "none.csv"))
    low, high = float(lows[0]), float(highs[0])
    between = low + (high - low) * chance.random() ** chance.choice((1, 4, 20))
    value = chance.choice((low, high, between, between, between))
    return round(value) if int in parts else value


def _marks(mark: Any) -> list[Any]:
    return list(getattr(mark, "metadata", (mark,)))


def any_road(chance: random.Random) -> dict[str, Any]:
    """A road of which some fields are any, whatever the others are."""
    fields = ROAD | {"lanes": chance.choice((1, 2, 3))}
    for name in chance.sample(sorted(RoadSection.model_fields), chance.randint(1, 6)):
        fields[name] = any_of(RoadSection, name, chance)
    if chance.random() < 0.7:  # the height follows the spacing, or most roads would be refused
        spacing = fields["pole_spacing_m"]
        fields["pole_height_m"] = spacing * chance.uniform(0.08, 10.0) if isinstance(spacing, float) else 9.0
    return fields


def test_a_road_of_any_fields_is_judged_or_refused_in_one_line(tmp_path: Path) -> None:
    path, used = tmp_path / "spec.toml", 0
    (tmp_path / "surface.csv").write_text("t,0,90,180\n0,300,300,300\n1.5,200,100,100\n")
    for number in range(scaled(_CASES, by_day=_BY_DAY)):
        chance = random.Random(f"road {number}")
        content = tomli_w.dumps({"roads": [any_road(chance)]}).encode()
        path.write_bytes(changed(content, chance) if chance.random() < 0.2 else content)
        used += require_line(lambda: [judged(road) for road in load_roads(path)], f"spec {number}")
    assert used > 0


def test_the_spacing_of_any_road_is_found_or_none(tmp_path: Path) -> None:
    for number in range(scaled(3, by_day=1)):
        chance = random.Random(f"spacing {number}")
        fields = {**ROAD, "width_m": chance.uniform(0.5, 12.0), "pole_height_m": chance.uniform(0.3, 40.0), "lanes": 1}
        fields |= {
            "pole_spacing_m": fields["pole_height_m"],
            "lighting_class": chance.choice(("M6", "P5", "local low")),
        }
        try:
            road = section_of(RoadSection, fields, "road", tmp_path)
        except lf.InputError:
            continue
        spacings = held_spacing(road, of_file(lamp(), 90.0, 1e4))
        assert spacings is None or 0.0 < spacings.least <= spacings.largest
