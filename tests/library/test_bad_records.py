"""Every field of every record of a result folder, one after the other: missing, foreign, impossible; one line each."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import annotated_types
import numpy as np
import pytest
from pydantic import ValidationError

import lensforge as lf
from lensforge.records import Record
from lensforge.results import Results

Where = tuple[str | int, ...]

FILES = ("lens", "design", "evaluate", "export", "check", "verify", "stray", "sensitivity", "photometry")
# A spec is the user's: what it leaves out has a default.
FREE = {("lens", "spec")}


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
    """A copy of a whole result folder, with all that can be asked for besides."""
    copy = tmp_path_factory.mktemp("records") / "run"
    shutil.copytree(whole_run.folder, copy)
    return copy


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("change", ["missing", "foreign", "infinite"])
def test_no_field_of_a_record_is_taken_as_it_comes(folder: Path, name: str, change: str) -> None:
    path = folder / f"{name}.json"
    whole = path.read_bytes()
    content = json.loads(whole)
    tried = 0
    try:
        for place in places(content):
            if change == "missing" and (isinstance(place[-1], int) or (name, place[0]) in FREE):
                continue  # a shorter list is another result, not a broken one
            path.write_text(json.dumps(changed(content, place, change)).replace("Infinity", "1e999"))
            message = refusal(folder)
            assert message is not None, f"{name}.json: {change} {place} was taken"
            assert len(message.splitlines()) == 1 and f"{name}.json" in message, (place, message)
            tried += 1
    finally:
        path.write_bytes(whole)
    assert tried >= 5
    assert lf.load(folder) is not None


def refusal(folder: Path) -> str | None:
    """Why the folder does not load; of what is said to be of another version, that. None where all of it is taken."""
    try:
        return next(iter(lf.load(folder).outdated.values()), None)
    except lf.InputError as error:
        return str(error)


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
                found.append(float(low) - 1.0)
            case annotated_types.Gt(gt=low):
                found.append(float(low))
            case annotated_types.Le(le=high) | annotated_types.Lt(lt=high):
                found.append(float(high) + 1.0)
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


@pytest.mark.parametrize("name", ["evaluate", "check", "verify", "stray", "photometry"])
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
