"""Checkpoints of a search: damaged, and whole ones with another head or other numbers under a right checksum."""

import hashlib
import json
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

import lensforge as lf
from fuzzing.chance import Chance
from fuzzing.extremes import FLOATS, NO_NUMBERS
from fuzzing.kind import Files, Kind
from fuzzing.noise import damaged
from fuzzing.spec_texts import small
from fuzzing.trees import as_json, changed_tree
from lensforge.spec import parse_spec

_FILE = "checkpoint.bin"
_STOPPED_AT = 3  # steps of eight


@cache
def _spec() -> lf.Spec:
    return parse_spec(small(), "sample")


@cache
def _saved(folder: Path) -> bytes:
    """The checkpoint that a search leaves which its caller has stopped."""
    steps = iter(range(_STOPPED_AT))
    path = folder / "sample.bin"
    with suppress(lf.Cancelled):
        lf.design(
            _spec(), accuracy="draft", threads=1, checkpoint=path, progress=lambda _: next(steps, None) is not None
        )
    return path.read_bytes()


@cache
def _sample() -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        return _saved(Path(folder))


def _make(chance: Chance) -> Files:
    content = _sample()
    if chance.share(0.4):
        return {_FILE: damaged(chance, content)}
    name, _, rest = content.partition(b"\n")
    _, _, rest = rest.partition(b"\n")
    line, _, numbers = rest.partition(b"\n")
    if chance.share(0.5):
        tree, raw = changed_tree(chance, json.loads(line))
        line = as_json(tree, raw).encode("utf-8", "replace")
    if chance.share(0.6):
        values = np.frombuffer(numbers, "<f8").copy()
        for _ in range(chance.few()):
            values[chance.below(len(values))] = chance.pick((*FLOATS, *NO_NUMBERS))
        kind = chance.below(6)
        values = values[:-1] if kind == 0 else np.append(values, values) if kind == 1 else values
        numbers = values.tobytes()
    body = line + b"\n" + numbers
    return {_FILE: name + b"\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body}


def _read(folder: Path) -> object:
    """Resume the search; one more step ends it."""
    path = folder / _FILE
    try:
        return lf.design(_spec(), accuracy="draft", threads=1, checkpoint=path, resume=True, progress=lambda _: False)
    except lf.Cancelled:
        return None


KINDS = [Kind("checkpoint", _make, _read, lambda: [{_FILE: _sample()}], 0.05)]
