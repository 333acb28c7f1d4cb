"""Files of a session, changed by their structure: each is read, or refused in one printable line.

Values of records under a checksum made anew, and their arrays under a hash made anew: what no checksum tells.
LENSFORGE_FUZZ=100: 20,000 of them.
"""

import hashlib
import io
import json
import shutil
import warnings
from pathlib import Path
from random import Random

import numpy as np
import pytest
from made_once import copied
from nightly import scaled
from one_line import require_line
from test_hostile_folders import changed

import lensforge as lf
from lensforge.report.folder import existing
from lensforge.report.stored import Stored
from lensforge.results.stage_result import with_checksum

_CASES = 200
_SIZES = (0.0, -1.0, 1e-320, 1e300, -1e300, np.nan, np.inf, 2.0**31)


def changed_arrays(content: bytes, chance: Random) -> bytes:
    """An archive in which an array has other values, shape or type, is missing, or is added."""
    with np.load(io.BytesIO(content)) as archive:
        arrays = dict(archive)
    name = chance.choice(sorted(arrays))
    array, way = np.array(arrays.pop(name)), chance.randrange(6)
    if way == 0 and array.size:
        flat = array.reshape(-1)
        size = chance.choice(_SIZES)
        flat[chance.randrange(flat.size)] = size if array.dtype.kind == "f" else 0
        arrays[name] = array
    elif way == 1:
        arrays[name] = array[..., None] if chance.random() < 0.5 else array[:0]
    elif way == 2:
        arrays[name] = array.astype(chance.choice(("f4", "i8", "U3", "c16")))
    elif way == 3:
        arrays[name] = np.concatenate([array, array]) if array.ndim else array
    elif way == 4:
        arrays |= {name: array, "more": array}
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def damage(whole: Path, place: Path, chance: Random) -> Path:
    """A file of ``place``, a copy of ``whole``, changed; hashes of what it holds are made anew."""
    path = chance.choice(sorted(file for file in whole.iterdir() if file.suffix in (".json", ".npz")))
    record = path.with_suffix(".json")
    if path.suffix == ".npz" and record.exists():
        content = changed_arrays(path.read_bytes(), chance)
        (place / path.name).write_bytes(content)
        head = json.loads(record.read_bytes()) | {"arrays_sha256": hashlib.sha256(content).hexdigest()}
        (place / record.name).write_text(json.dumps(with_checksum(head)), encoding="utf-8")
        return path
    value = json.loads(path.read_bytes())
    for _ in range(chance.choice((1, 1, 2))):
        value = changed(value, chance)
    held = with_checksum(value) if isinstance(value, dict) else value
    (place / path.name).write_text(json.dumps(held), encoding="utf-8")
    return path


def read(place: Path) -> None:
    """All that a page reads: every record, the verdict, and the rows of all results."""
    results = Stored.read(place).results()
    assert results.verdict.row() and all(result.row() for result in results.found.values())
    existing(place).trusted()


@pytest.mark.nightly("minutes; by day folders and checkpoints have some of each")
def test_a_damaged_session_is_read_or_refused_in_one_line(whole_run: lf.Run, tmp_path: Path) -> None:
    whole, place = whole_run.folder, tmp_path / "session"
    copied(whole, place)
    used = 0
    for number in range(scaled(_CASES)):
        path = damage(whole, place, Random(f"session {number}"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            used += require_line(lambda: read(place), f"session {number}: {path.name}")
        for name in (path.name, path.with_suffix(".json").name):
            shutil.copy(whole / name, place / name)
    assert used < scaled(_CASES)
