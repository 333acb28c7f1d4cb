"""Records of a result folder, each read by its class: changed anywhere, mostly with the checksum of the new content."""

import hashlib
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import lensforge as lf
from fuzzing.chance import Chance
from fuzzing.kind import Files, Kind
from fuzzing.samples import SNAPSHOT, result_folder
from fuzzing.trees import as_json, changed_tree, damaged_text
from lensforge.report.snapshots import Snapshot
from lensforge.results import StageResult
from lensforge.runs.results import EXTRAS, STAGES
from lensforge.runs.run_record import RUN_FILE, read_record

CHECKSUM = "content_sha256"
_STAMPED = 0.75  # of the cases have the checksum of their changed content: the others all end at the old one
_CLASSES: dict[str, type[StageResult]] = {
    **{kind.stage: kind for kind in STAGES},
    **EXTRAS,
    "sweep": lf.Sweep,
    SNAPSHOT: Snapshot,
}
_HOLD_LENS = ("design", "export")
# Shares of the cases: those whose arrays and files take long to hash are read less often.
_SHARES = {"check": 0.3, "export": 0.3, "lens": 5.0, "run": 3.0}


@cache
def record_text(stem: str) -> str:
    """The JSON of a record of the sample folder."""
    return (result_folder() / f"{stem}.json").read_text(encoding="utf-8")


@cache
def _contents() -> list[bytes]:
    return [path.read_bytes() for path in sorted(result_folder().glob("*.json"))]


def changed_record(chance: Chance, stem: str) -> bytes:
    """The record with a few changes."""
    tree, raw = changed_tree(chance, json.loads(record_text(stem)))
    if chance.share(_STAMPED) and isinstance(tree, dict):
        tree = stamped(tree, raw)
    return damaged_text(chance, as_json(tree, raw), _contents())


def stamped(tree: dict[str, Any], raw: list[str]) -> dict[str, Any]:
    """``tree`` with the checksum of its content as it will be read; as it is, where that is not JSON."""
    try:
        content = json.loads(as_json(tree, raw))
    except (ValueError, RecursionError):
        return tree
    return {**tree, CHECKSUM: checksum(content)} if CHECKSUM in tree else tree


def checksum(content: dict[str, Any]) -> str:
    """SHA-256 of all entries but the checksum's own, sorted and without blanks."""
    rest = {key: value for key, value in content.items() if key != CHECKSUM}
    return hashlib.sha256(
        json.dumps(rest, sort_keys=True, separators=(",", ":")).encode("utf-8", "replace")
    ).hexdigest()


def require_own_checksum(path: Path) -> None:
    """Raise :class:`ValueError` for a record that was accepted with the checksum of other content."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if content.get(CHECKSUM) not in (None, checksum(content)):
        raise ValueError("accepted, with the checksum of other content")


def _read_stage(stem: str) -> Callable[[Path], object]:
    def read(folder: Path) -> object:
        given = {"lens": _lens()} if stem in _HOLD_LENS else {}
        found = _CLASSES[stem].read(folder, stem, **given)
        require_own_checksum(folder / f"{stem}.json")
        return require_usable(found)

    return read


def require_usable(found: StageResult) -> StageResult:
    """Raise :class:`ValueError` where a result that was accepted cannot be hashed, or shown as a row of a table."""
    numbers = [value for value in found.row().values() if isinstance(value, float)]
    if not np.isfinite(numbers).all():
        raise ValueError("accepted, with numbers that are not finite")
    if len(found.sha256) != 64:
        raise ValueError("accepted, without a hash")
    return found


@cache
def _lens() -> lf.Lens:
    return lf.load_lens(result_folder() / "lens.json")


def _read_lens(folder: Path) -> object:
    """Read the lens; what is accepted must be the same after it is written and read again."""
    lens = lf.load_lens(folder / "lens.json")
    require_own_checksum(folder / "lens.json")
    lens.save(folder / "again.json")
    if lf.load_lens(folder / "again.json") != lens:
        raise ValueError("accepted, but written it is another lens")
    directions = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    for surface in (lens.inner, lens.outer):
        if not np.isfinite(surface.radius(directions)).all():
            raise ValueError("accepted, with a surface that is not finite")
    return lens._repr_html_()


def _read_run(folder: Path) -> object:
    found = read_record(folder)
    if found is not None:  # one of an earlier version counts as none
        require_own_checksum(folder / RUN_FILE)
    return found


def _kind(stem: str) -> Kind:
    def make(chance: Chance) -> Files:
        return {f"{stem}.json": changed_record(chance, stem)}

    def original() -> list[Files]:
        return [{f"{stem}.json": record_text(stem).encode()}]

    read = {"lens": _read_lens, "run": _read_run}.get(stem) or _read_stage(stem)
    return Kind(stem, make, read, original, _SHARES.get(stem, 2.0), in_folder=True)


KINDS = [_kind(stem) for stem in ("lens", "run", *_CLASSES)]
