"""Roads, tables of their surfaces, and lists of LEDs at random: each is used, or refused in one printable line.

LENSFORGE_FUZZ=10: 3,000 cases of each, of which the day has some.
"""

import os
import random
import re
import warnings
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import tomli_w
from annotated_types import Ge, Gt, Le, Lt
from nightly import scaled
from one_line import require_line
from pydantic import BaseModel
from test_hostile_files import changed

import lensforge as lf
from lensforge.light.road_judgement import held_spacing, judge_road, of_file
from lensforge.light.road_lighting import road_facts
from lensforge.scene.road_surface import RoadSurface
from lensforge.sources.photometric import PhotometricFile, read_photometric
from lensforge.spec.road_section import STANDARD_SURFACES, RoadSection, load_roads
from lensforge.spec.source_list import read_sources, require_told_apart
from lensforge.spec.spec_section import section_of

SURFACES = Path(lf.__file__).parent / "scene" / "road_surfaces"
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
    return read_photometric(Path(__file__).parents[2] / "examples" / "street_light.ies")


_NUMBER = re.compile(rb"\d+(?:[.,]\d+)?")
_OTHERS = (
    b"0",
    b"1",
    b"1e-9",
    b"1e5",
    b"1e300",
    b"-1",
    b"",
    b"1,5",
    b"1.5",
    b"1.234,5",
    b"x",
    b"180",
    b"nan",
    b"1 000",
)


def varied(content: bytes, chance: random.Random) -> bytes:
    """``content``, changed anywhere, or with one to three numbers that are others: most of these tables can be read."""
    if chance.random() < 0.4:
        return changed(content, chance)
    for _ in range(chance.randint(1, 3)):
        places = list(_NUMBER.finditer(content))
        found = chance.choice(places) if places else None
        if found is None:
            break
        near = str(round(float(found[0].replace(b",", b".")) * chance.uniform(0.8, 1.2))).encode()
        other = near if chance.random() < 0.6 else chance.choice(_OTHERS)
        content = content[: found.start()] + other + content[found.end() :]
    return content


def finite(value: object) -> bool:
    """True where all numbers of a record are finite."""
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, list | tuple):
        return all(map(finite, value))
    return not isinstance(value, float) or np.isfinite(value)


def judged(road: RoadSection) -> None:
    found = judge_road(road, of_file(lamp(), 90.0, road.lamp_lm))
    assert finite(found.model_dump()) and road_facts(found, road).plain()


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
    marks = [*field.metadata, *(mark for part in parts for each in get_args(part)[1:] for mark in _marks(each))]
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
        found = held_spacing(road, of_file(lamp(), 90.0, 1e4))
        assert found is None or 0.0 < found.least <= found.largest


_TABLES = (
    b"file,name,flux_lm,share\nl0.ray,first,120,2\nl1.ray,,,\n",
    "\ufefffile;flux (lm)\r\nl0.ray;100,5\r\nl1.ray;\r\n".encode("utf-16"),
    b"file\rl0.ray\rl1.ray",
    b"name\tfile\tflux_w\tluminous_efficacy_lm_per_w\na\tl0.ray\t0.5\t100\nb\tl1.ray\t1e-3\t\n",
)


def leds_of(given: str, own: lf.SquareSource | lf.RayfileSource) -> None:
    leds = read_sources([given], own)
    assert leds and all(isinstance(led.source, lf.RayfileSource) and led.source.file.is_file() for led in leds)
    require_told_apart(leds)


def test_a_changed_table_of_leds_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    for name in ("l0.ray", "l1.ray"):
        (tmp_path / name).write_bytes(b"")
    path = tmp_path / "leds.csv"
    own = lf.SquareSource(side_mm=1.0, flux_lm=90.0), lf.RayfileSource(file=tmp_path / "l0.ray", flux_w=0.5)
    used = 0
    for number in range(scaled(_CASES, by_day=_BY_DAY)):
        path.write_bytes(varied(_TABLES[number % 4], random.Random(f"leds {number}")))
        used += require_line(partial(leds_of, str(path), own[number % 2]), f"leds {number}")
    assert used > 0


_PIECES = (
    "*", "**", "?", "[", "]", "[!", "a", "b", ".ray", ".csv", ".toml", "l0", "/", "/", "**/", "*/", "~", "\0", "\n",
    "é", "\ud800", "x" * 300, "*" * 300, "*/" * 200, " ", ".", "\\", "{a,b}", "[z-a]", "[]-", "1e308",
)  # fmt: skip


def test_any_pattern_of_leds_is_read_or_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("l0.ray", "l1.ray", "a/b/l0.ray", "a/[b].ray", "é.ray"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    if os.name == "posix":
        (tmp_path / "a" / "loop").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    own = lf.SquareSource(side_mm=1.0)
    for number in range(scaled(_CASES, by_day=100)):
        chance = random.Random(f"pattern {number}")
        pattern = "".join(chance.choices(_PIECES, k=chance.randint(1, 8)))
        if pattern.startswith("/") or ".." in pattern:
            continue  # other folders, of any size
        require_line(partial(leds_of, pattern, own), f"pattern {number}: {pattern!r:.60}")
