"""Lists of LEDs at random: each is used, or refused in one printable line.

LENSFORGE_FUZZ=10: 3,000 cases of each, of which the day has some.
"""

import os
import random
import re
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from nightly import scaled
from one_line import require_line
from test_hostile_files import changed

import lensforge as lf
from lensforge.spec.source_list import read_sources, require_told_apart

_CASES, _BY_DAY = 300, 20


@pytest.fixture(autouse=True)
def own_warnings_alone() -> Iterator[None]:
    """A warning is an error, unless it says in which of two ways a file is read."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", lf.FileWarning)
        yield


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
        match = chance.choice(places) if places else None
        if match is None:
            break
        near = str(round(float(match[0].replace(b",", b".")) * chance.uniform(0.8, 1.2))).encode()
        other = near if chance.random() < 0.6 else chance.choice(_OTHERS)
        content = content[: match.start()] + other + content[match.end() :]
    return content


_TABLES = (
    b"file,name,flux_lm,share\nl0.ray,first,120,2\nl1.ray,,,\n",
    "\ufefffile;flux (lm)\r\nl0.ray;100,5\r\nl1.ray;\r\n".encode("utf-16"),
    b"file\rl0.ray\rl1.ray",
    b"name\tfile\tflux_w\tluminous_efficacy_lm_per_w\na\tl0.ray\t0.5\t100\nb\tl1.ray\t1e-3\t\n",
)


def leds_of(given: str, source: lf.SquareSource | lf.RayfileSource) -> None:
    leds = read_sources([given], source)
    assert leds and all(isinstance(led.source, lf.RayfileSource) and led.source.file.is_file() for led in leds)
    require_told_apart(leds)


def test_a_changed_table_of_leds_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    for name in ("l0.ray", "l1.ray"):
        (tmp_path / name).write_bytes(b"")
    path = tmp_path / "leds.csv"
    sources = lf.SquareSource(side_mm=1.0, flux_lm=90.0), lf.RayfileSource(file=tmp_path / "l0.ray", flux_w=0.5)
    used = 0
    for number in range(scaled(_CASES, by_day=_BY_DAY)):
        path.write_bytes(varied(_TABLES[number % 4], random.Random(f"leds {number}")))
        used += require_line(partial(leds_of, str(path), sources[number % 2]), f"leds {number}")
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
    source = lf.SquareSource(side_mm=1.0)
    for number in range(scaled(_CASES, by_day=100)):
        chance = random.Random(f"pattern {number}")
        pattern = "".join(chance.choices(_PIECES, k=chance.randint(1, 8)))
        if pattern.startswith("/") or ".." in pattern:
            continue  # other folders, of any size
        require_line(partial(leds_of, pattern, source), f"pattern {number}: {pattern!r:.60}")
