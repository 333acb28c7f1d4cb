"""Whole result folders with one file changed: loaded, and made into a report and the shop's documents."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import lensforge as lf
from fuzzing.chance import Chance
from fuzzing.kind import Files, Kind
from fuzzing.noise import damaged
from fuzzing.records import CHECKSUM, changed_record, checksum, require_usable
from fuzzing.samples import BASE_FILE, SNAPSHOT, result_folder
from lensforge.report.solid_view import SolidViews
from lensforge.runs import pipeline
from lensforge.runs.results import Results

_BINARY = 0.3  # of the cases change arrays, STEP, STL or 3MF
_OTHER_RECORDS = ("handover", "rays", "sweep", SNAPSHOT)  # that a folder does not hold, or that are not read
_OTHER_FILES = (BASE_FILE, f"{SNAPSHOT}.npz")
_SUFFIXES = (".npz", ".step", ".stl", ".3mf")


@cache
def _names() -> tuple[list[str], list[str]]:
    """Names of the records in the sample folder, and of the files that their hashes protect."""
    paths = sorted(result_folder().iterdir())
    records = [path.stem for path in paths if path.suffix == ".json" and path.stem not in _OTHER_RECORDS]
    return records, [path.name for path in paths if path.suffix in _SUFFIXES and path.name not in _OTHER_FILES]


@cache
def _content(name: str) -> bytes:
    return (result_folder() / name).read_bytes()


@cache
def _hashes() -> dict[str, str]:
    """The hash of each result of the samples, and of the lens."""
    run = lf.load(result_folder())
    return {"lens": run.lens.sha256, **{stem: result.sha256 for stem, result in run.found.items()}}


def _make(chance: Chance) -> Files:
    records, binary = _names()
    if chance.share(_BINARY):
        name = chance.pick(binary)
        return {name: damaged(chance, _content(name), [_content(chance.pick(binary))])}
    stem = chance.pick(records)
    content = changed_record(chance, stem) if chance.share(0.7) else _one_number(chance, stem)
    return {f"{stem}.json": content}


def _one_number(chance: Chance, stem: str) -> bytes:
    """The record with one number a little better or worse, and the checksum of that: it looks sound in itself."""
    content = json.loads(_content(f"{stem}.json"))
    places = list(_numbers(content))
    holder, key = chance.pick(places)
    factor = chance.pick((0.5, 0.99, 1.0 + 1e-9, 2.0, 1e-3, 1e3))
    holder[key] = holder[key] * factor if isinstance(holder[key], float) else holder[key] + chance.pick((-1, 1, 10))
    if CHECKSUM in content:
        content[CHECKSUM] = checksum(content)
    return json.dumps(content).encode()


def _numbers(content: Any) -> Any:
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield content, key
        else:
            yield from _numbers(value)


def _read_load(folder: Path) -> object:
    """Load the folder: each result that is there must be the one that was written."""
    run = lf.load(folder)
    for stem, result in run.found.items():
        if result.sha256 != _hashes()[stem]:
            raise ValueError(f"loaded, though {stem} is not the result whose hash run.json holds")
        require_usable(result)
    run.row()
    return run


def _require_same(found: Results) -> None:
    """Raise :class:`ValueError` where a command ended well in a folder whose content is not the one written."""
    hashes = {"lens": found.lens.sha256, **{stem: result.sha256 for stem, result in found.found.items()}}
    changed = [stem for stem, value in _hashes().items() if hashes.get(stem) != value]
    if changed:
        raise ValueError(f"exit 0, though {', '.join(changed)} is not what was written")


class _NoViews:
    """No three-dimensional views: they take a process and seconds, and read the mesh alone, which has its own kind."""

    def __init__(self, *_: object) -> None:
        pass

    def result(self) -> SolidViews:
        return SolidViews({}, problem="not drawn")

    def close(self) -> None:
        pass


def _read_report(folder: Path) -> object:
    with mock.patch("lensforge.report.lens_page.Rendering", _NoViews):
        pipeline.run_report(folder)
    _require_same(lf.load(folder))
    return None


def _read_handover(folder: Path) -> object:
    pipeline.run_handover(folder)
    _require_same(lf.load(folder))
    return None


def _kind(name: str, read: Callable[[Path], object], share: float) -> Kind:
    def original() -> list[Files]:
        return [{"run.json": _content("run.json")}]

    return Kind(name, _make, read, original, share, in_folder=True)


KINDS = [_kind("load", _read_load, 0.5), _kind("report", _read_report, 0.02), _kind("handover", _read_handover, 0.02)]
