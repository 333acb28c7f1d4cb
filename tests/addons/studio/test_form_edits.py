"""Edits of a form at random: each field of a spec with sizes that no thing has makes a spec, or one line a field.

What the page gets is JSON that every browser reads. LENSFORGE_FUZZ=10: 3,000 edits.
"""

import json
import math
import random
import tomllib
import warnings
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

from nightly import scaled
from one_line import require_line

from lensforge.addons.studio.spec_text import SpecText
from lensforge.search.start_faces import TargetStroke, beam_of
from lensforge.spec import Spec
from lensforge.spec.shipped_specs import shipped_specs

_EDITS, _BY_DAY, _MOST_PIXELS = 300, 30, 256
_SIZES = (0.0, -0.0, 1e-320, 1e-300, 1e-200, 1e-30, 1e-9, 1e-4, 0.5, 1.0, 89.999, 90.0, 180.0, 1e5, 1e9, 1e30, 1e200)
_NUMBERS = (*_SIZES, *(-size for size in _SIZES[2:]), 1e300, 1.7e308, -1.7e308, 1, 2, 3, 7, 2**31, 2**63, 10**30)
_OTHERS = (
    True,
    False,
    "",
    "a",
    "1e400",
    "nan",
    "x" * 300,
    "\u2028",
    "../a",
    "none",
    [],
    {},
    [1e300],
    [[]],
    {"kind": "x"},
)
_FACTORS = (-1.0, 1e-6, 1e-3, 0.5, 0.97, 1.03, 2.0, 1e3, 1e6)
_TOML = ("nan", "inf", "-inf", "[1, nan]", "1 # x", "[1,", "{a = 1}", "", "1e999", "1\n[lens]", "2026-01-31", "'a'")


@cache
def texts() -> dict[Path, str]:
    return {path: path.read_text(encoding="utf-8") for path in shipped_specs().values()}


def places(table: Any, before: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Places of all values of a spec, and of its tables."""
    entries = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    for name, value in entries:
        yield (*before, name)
        yield from places(value, (*before, name))


def any_value(before: Any, chance: random.Random) -> Any:
    if isinstance(before, float | int) and not isinstance(before, bool) and chance.random() < 0.6:
        return before * chance.choice(_FACTORS)
    kind = chance.random()
    return chance.choice(_NUMBERS if kind < 0.7 else _OTHERS) if kind < 0.85 else {"toml": chance.choice(_TOML)}


def finite(value: Any) -> bool:
    if isinstance(value, dict | list):
        return all(map(finite, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, float) or math.isfinite(value)


def _edit(spec: SpecText, place: tuple[str | int, ...], value: Any, after: list[SpecText]) -> None:
    after.append(spec.edited(place, value))


def edited(number: int) -> SpecText | None:
    """The text of a shipped spec with one to three values of another size; None where the form refuses one."""
    chance = random.Random(f"edit {number}")
    path, text = chance.choice(sorted(texts().items()))
    spec = SpecText.of(text, path)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        place = chance.choice(list(places(tomllib.loads(text))))
        before: Any = tomllib.loads(text)
        for step in place:
            before = before[step]
        after: list[SpecText] = []
        value = any_value(before, chance)
        if not require_line(partial(_edit, spec, place, value, after), f"edit {number}"):
            return None
        (spec,) = after
    return spec


def require_drawn(spec: Spec, number: int) -> None:
    """What a search draws first of the light that is wanted: pictures of few pixels, of any receiver."""
    if max(spec.evaluate.pixels, spec.optimise.pixels) > _MOST_PIXELS:
        return
    require_line(lambda: (beam_of(spec), TargetStroke.of(spec)), f"edit {number}")


def test_every_edit_makes_a_spec_or_a_line_for_each_wrong_field() -> None:
    used = 0
    for number in range(scaled(_EDITS, by_day=_BY_DAY)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            spec = edited(number)
            if spec is None:
                continue
            assert all(line.isprintable() and len(line) < 1000 for _, line in spec.lines), (number, spec.lines)
            assert (spec.spec is None) == bool(spec.lines), number
            if spec.spec is not None:
                used += 1
                assert finite(spec.spec.model_dump(mode="json")), number
                json.dumps(spec.shown(), allow_nan=False)
                require_drawn(spec.spec, number)
    assert used > 0
