"""Fields of every record of a result folder, one after the other: missing, foreign, impossible; one line each."""

import json
import random
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import annotated_types
import numpy as np
import pytest
from nightly import NIGHTLY
from pydantic import ValidationError

import lensforge as lf
from lensforge.report.results import EXTRAS, STAGES, Results
from lensforge.report.sweep import sweep_of, variation_of
from lensforge.results import Record

Where = tuple[str | int, ...]

STEMS = {**{kind.stage: kind for kind in STAGES}, **EXTRAS, "sweep": lf.Sweep, "rays": lf.RayFileSummary}
FILES = ("lens", *(stem for stem in STEMS if stem not in ("compare_outer", "correct_outer")), "run")
# A spec may leave out what has a default, a lens of another program its hash; tables have as many rows as there are.
BY_DAY = 20  # fields of each record and change, always the same ones; nightly all, up to 250 of a record
FREE = {
    ("lens", "spec"),
    ("lens", "content_sha256"),
    ("sweep", "spec"),
    ("sweep", "inputs"),
    ("sweep", "changes"),
    ("run", "results"),
}


def places(content: Any, path: Where = ()) -> Iterator[Where]:
    """The way to every value; of a list only the first entry, as all have one type."""
    if path:
        yield path
    if isinstance(content, dict):
        for key, value in content.items():
            yield from places(value, (*path, key))
    elif isinstance(content, list) and content:
        yield from places(content[0], (*path, 0))


def changed(content: Any, path: Where, change: str) -> Any:
    copy = json.loads(json.dumps(content))
    table = copy
    for key in path[:-1]:
        table = table[key]
    if change == "missing":
        del table[path[-1]]
    else:
        table[path[-1]] = foreign(table[path[-1]]) if change == "foreign" else float("inf")
    return copy


def foreign(value: Any) -> Any:
    """A value of a type that is never right in the place of this one."""
    return 3.5 if isinstance(value, str | dict | list) else {"a": "table"}


@pytest.fixture(scope="module")
def folder(whole_run: lf.Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of a whole result folder, with the record of a sweep and that of a ray file."""
    copy = tmp_path_factory.mktemp("records") / "run"
    shutil.copytree(whole_run.folder, copy)
    variation = variation_of("constraints.max_radius_mm", [7.0, 8.0], ())
    designs = [(variant, whole_run) for variant in variation.variants(whole_run.spec)]
    sweep_of(whole_run.spec, variation, designs).write(copy)
    lf.rays(Path(__file__).parents[2] / "examples" / "led.tm25ray").write(copy)
    return copy


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("change", ["missing", "foreign", "infinite"])
def test_no_field_of_a_record_is_taken_as_it_comes(folder: Path, name: str, change: str) -> None:
    path = folder / f"{name}.json"
    whole = path.read_bytes()
    content = json.loads(whole)
    tried = 0
    try:
        for place in chosen(list(places(content))):
            if change == "missing" and (isinstance(place[-1], int) or any((name, part) in FREE for part in place)):
                continue  # a shorter list is another result, not a broken one
            if (name, *place[:1]) == ("rays", "header") and len(place) > 1:
                continue  # it holds whatever the ray file's own header says
            path.write_text(json.dumps(changed(content, place, change)).replace("Infinity", "1e999"))
            message = refusal(folder, name)
            assert message is not None, f"{name}.json: {change} {place} was taken"
            assert len(message.splitlines()) == 1 and f"{name}.json" in message, (place, message)
            tried += 1
    finally:
        path.write_bytes(whole)
    assert tried >= 5
    assert refusal(folder, name) is None


def chosen(every: list[Where]) -> list[Where]:
    """All places, or those of the day: first those at the top, which every record has, then a sample of the deeper."""
    top, deeper = [[place for place in every if (len(place) > 1) == deep] for deep in (False, True)]
    if NIGHTLY or len(every) <= BY_DAY:
        return every
    return top + random.Random(16).sample(deeper, max(0, BY_DAY - len(top)))


def refusal(folder: Path, name: str) -> str | None:
    """Why one record does not load, as its stage or the library reads it; None where all of it is taken."""
    try:
        if name == "run":
            lf.load(folder)
        elif name == "lens":
            lf.load_lens(folder / "lens.json")
        else:
            lens = {"lens": lf.load_lens(folder / "lens.json")} if name in ("design", "export") else {}
            STEMS[name].read(folder, name, **lens)
    except lf.InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", [name for name in FILES if name not in ("sweep", "rays")])
def test_a_folder_with_a_broken_record_does_not_load(folder: Path, name: str) -> None:
    path = folder / f"{name}.json"
    whole = path.read_bytes()
    try:
        path.write_text(json.dumps(changed(json.loads(whole), ("version",), "foreign")))
        with pytest.raises(lf.InputError, match=rf"{name}\.json: version"):
            lf.load(folder)
    finally:
        path.write_bytes(whole)
    assert lf.load(folder) is not None


def records_in(value: object) -> Iterator[Record]:
    """A record, and all that are parts of it."""
    if isinstance(value, Record):
        yield value
        for field in type(value).model_fields:
            yield from records_in(getattr(value, field))
    elif isinstance(value, dict):
        for entry in value.values():
            yield from records_in(entry)
    elif isinstance(value, tuple):
        for entry in value:
            yield from records_in(entry)


def beyond(bounds: list[Any]) -> list[float]:
    """Numbers outside of a field's range."""
    found = []
    for bound in bounds:
        match bound:
            case annotated_types.Ge(ge=low):
                found.append(min(float(low) - 1.0, 2.0 * float(low)))
            case annotated_types.Gt(gt=low):
                found.append(float(low))
            case annotated_types.Le(le=high) | annotated_types.Lt(lt=high):
                found.append(max(float(high) + 1.0, 2.0 * float(high)))
    return found


def test_no_number_beyond_its_range_is_taken(whole_run: Results) -> None:
    tried = set()
    for result in whole_run.found.values():
        for record in records_in(result):
            for field, info in type(record).model_fields.items():
                key = (type(record).__name__, field)
                if key in tried or getattr(record, field) is None:
                    continue
                given = {name: getattr(record, name) for name in type(record).model_fields}
                whole = isinstance(given[field], int)
                for value in beyond(info.metadata):
                    tried.add(key)
                    with pytest.raises((ValidationError, lf.InputError)):
                        type(record)(**(given | {field: int(value) if whole else value}))
    assert len(tried) > 80


@pytest.mark.parametrize("name", ["evaluate", "check", "verify", "stray", "photometry", "compare", "compare_inner"])
@pytest.mark.parametrize("change", ["missing", "shape", "not finite", "no archive", "none"])
def test_arrays_are_held_to_their_shape(folder: Path, name: str, change: str) -> None:
    path = folder / f"{name}.npz"
    whole = path.read_bytes()
    try:
        with np.load(path) as archive:
            arrays = dict(archive)
        first = next(iter(arrays))
        if change == "missing":
            del arrays[first]
        elif change == "shape":
            arrays[first] = arrays[first][:-1]
        elif change == "not finite":
            arrays[first] = np.full_like(arrays[first], np.inf)
        np.savez(path, **arrays)
        if change == "no archive":
            path.write_bytes(whole[: len(whole) // 2])
        elif change == "none":
            path.unlink()
        with pytest.raises(lf.InputError) as refusal:
            lf.load(folder)
        assert len(str(refusal.value).splitlines()) == 1 and name in str(refusal.value)
    finally:
        path.write_bytes(whole)
