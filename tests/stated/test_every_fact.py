"""Every fact and every number that is stated of the crooked designs, against oracles that share no code with lensforge.

An oracle is a function of the case and the place of what it tells, written from docs/definitions.md: ``ORACLES`` of a
module have those of facts, by "stage.key" without the number at the end of a key, ``RECORDS`` the expected record of a
stage, as its JSON has it. A fact and a number without an oracle fail, and an oracle of nothing, too.
"""

import ast
import re
from collections.abc import Callable, Iterator
from math import isclose
from pathlib import Path
from typing import Any

import oracle_far
import oracle_light
import oracle_mould
import oracle_part
import oracle_photo
import oracle_points
import oracle_proof
import oracle_search
import oracle_shop
import oracle_stray
import oracle_study
import oracle_turning
import pytest
import record_check
import record_export
import record_verify
from addon_rows import has_addon
from crooked import BY_LED, NAMES, Case, Expected, Place

import lensforge as lf
from lensforge.results.fact import Fact

MODULES = (
    oracle_search,
    oracle_light,
    oracle_far,
    oracle_part,
    oracle_mould,
    oracle_shop,
    oracle_turning,
    oracle_proof,
    oracle_stray,
    oracle_study,
    *([oracle_points, oracle_photo] if has_addon("measure") else []),
    record_export,
    record_check,
    record_verify,
)
ORACLES: dict[str, Callable[[Case, Place], Expected]] = {
    name: oracle for module in MODULES for name, oracle in getattr(module, "ORACLES", {}).items()
}
RECORDS: dict[str, Callable[[Case], Any]] = {
    stage: record for module in MODULES for stage, record in getattr(module, "RECORDS", {}).items()
}
# Entries of a record that are no figures of the design: how long it took, and what it was made from.
NO_FIGURE_OF = re.compile(r"(others\.\d+\.)?(seconds|version|inputs|content_sha256|arrays_sha256|schema)")


def name_of(place: Place, fact: Fact) -> str:
    """The name by which the oracle of a fact is found."""
    stage = "evaluate" if place.stage == "warm" else place.stage
    return f"{stage}.{fact.key.rstrip('0123456789').rstrip('_ ')}"


@pytest.mark.parametrize("name", NAMES)
def test_every_fact(case: Callable[[str], Case], name: str) -> None:
    """Value, unit, standard error, limit, bound and state of each."""
    scene = case(name)
    wrong = []
    for place, fact in scene.stated():
        key = name_of(place, fact)
        if key not in ORACLES:
            wrong.append(f"{key} ({place}): no oracle; it says {fact.sentence}")
            continue
        wrong += [
            f"{key} ({place.title}, {fact.label}): {difference}"
            for difference in differences(fact, ORACLES[key](seen(scene, place.stage, place.led), place))
        ]
    assert not wrong, "\n".join(wrong)


def seen(case: Case, stage: str, led: int) -> Case:
    """The case as an oracle of this stage sees it, which knows nothing of several LEDs where each has a result."""
    return case.with_led(led) if stage in BY_LED else case


def expected_record(case: Case, stage: str) -> Any:
    """The record of a stage, with those of further LEDs where it has them."""
    names = [led["name"] for led in case.lens["spec"]["sources"]]
    first, *rest = (
        RECORDS[stage](seen(case, stage, led)) for led, _ in enumerate(names or [""]) if not led or stage in BY_LED
    )
    if not rest:
        return first
    others = [record | {"led": name} for name, record in zip(names[1:], rest, strict=True)]
    return first | {"led": names[0], "others": others}


@pytest.mark.parametrize("name", NAMES)
def test_a_folder_is_read_back_with_every_judgement_made_again(case: Callable[[str], Case], name: str) -> None:
    scene = case(name)
    assert lf.load(scene.folder).found == {stage: result for stage, result in scene.results.items() if stage != "warm"}


def differences(fact: Fact, expected: Expected) -> Iterator[str]:
    if isinstance(fact.value, float | int) and isinstance(expected.value, float | int):
        if not abs(fact.value - expected.value) <= expected.within:
            yield f"{fact.value!r}, must be {expected.value!r} within {expected.within:.2g}"
    elif fact.value != expected.value:
        yield f"{fact.value!r}, must be {expected.value!r}"
    if fact.unit != expected.unit:
        yield f"in {fact.unit!r}, must be in {expected.unit!r}"
    errors = fact.standard_error, expected.standard_error
    known = [error for error in errors if error is not None]
    if len(known) == 1 or (known and abs(known[0] - known[1]) > expected.error_within):
        yield f"standard error {errors[0]!r}, must be {errors[1]!r}"
    if fact.state != expected.state:
        yield f"state {fact.state!r}, must be {expected.state!r}"
    yield from bounds_differ("limit", fact.sense, fact.limit, expected.limit, expected.limit_within)
    best = {"<=": ">=", ">=": "<="}[fact.sense]  # physics sets the other side
    yield from bounds_differ("possible", best, fact.possible, expected.possible, expected.possible_within)


def bounds_differ(what: str, sense: str, bound: float | None, expected: Any, within: float) -> Iterator[str]:
    if expected is ...:
        return
    if (bound is None) != (expected is None):
        yield f"{what} {bound}, must be {expected}"
    elif bound is not None and expected is not None:
        near = isclose(bound, expected[1], rel_tol=1e-9, abs_tol=within)
        if sense != expected[0] or not near:
            yield f"{what} {sense} {bound!r}, must be {expected}"


def leaves(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number, text and flag of a record, by its path."""
    if isinstance(content, dict):
        for key, entry in content.items():
            yield from leaves(entry, f"{path}.{key}" if path else key)
    elif isinstance(content, list | tuple):
        for number, entry in enumerate(content):
            yield from leaves(entry, f"{path}.{number}")
    else:
        yield path, content


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("stage", RECORDS)
def test_every_number_of_a_record(case: Callable[[str], Case], stage: str, name: str) -> None:
    """A record that is expected has tuples (value, within) in the place of numbers that are not exact."""
    scene = case(name)
    if stage not in scene.results:
        return
    expected = dict(pairs(expected_record(scene, stage)))
    skipped = tuple(path for path, value in expected.items() if value is ...)
    expected = {path: value for path, value in expected.items() if value is not ...}
    stored = {
        path: value
        for path, value in leaves(scene.json(stage))
        if not (NO_FIGURE_OF.match(path) or path.startswith(skipped))
    }
    wrong = [f"{path}: {stored[path]!r}, nothing is expected" for path in stored if path not in expected]
    wrong += [f"{path}: missing" for path in expected if path not in stored]
    for path, wanted in expected.items():
        if path in stored and not same(stored[path], wanted):
            wrong.append(f"{path}: {stored[path]!r}, must be {wanted!r}")
    assert not wrong, "\n".join(wrong)


def pairs(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of an expected record; a tuple of a value and its tolerance is one, and so is an Ellipsis."""
    if isinstance(content, dict):
        for key, entry in content.items():
            yield from pairs(entry, f"{path}.{key}" if path else key)
    elif isinstance(content, list):
        for number, entry in enumerate(content):
            yield from pairs(entry, f"{path}.{number}")
    else:
        yield path, content


def same(stored: Any, expected: Any) -> bool:
    """True within the tolerance, or to rounding."""
    value, within = expected if isinstance(expected, tuple) else (expected, None)
    if isinstance(stored, bool) or not isinstance(stored, float | int) or not isinstance(value, float | int):
        return bool(stored == value)
    return abs(stored - value) <= (1e-9 * abs(value) if within is None else within)


def test_every_oracle_has_a_fact(case: Callable[[str], Case]) -> None:
    named = {name_of(place, fact) for name in NAMES for place, fact in case(name).stated()}
    assert set(ORACLES) <= named


def test_oracles_share_no_code() -> None:
    for module in MODULES:
        tree = ast.parse(Path(module.__file__ or "").read_text(encoding="utf-8"))
        imported = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
        imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not [name for name in imported if name.split(".")[0] == "lensforge"]
