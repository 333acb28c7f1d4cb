"""Checkpoints of a search: damaged, and whole ones with another head or other numbers under a right checksum."""

import hashlib
import json
import tempfile
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

# Steps until it is stopped: of eight; and where levels are automatic, in the second of them.
_STOPPED_AT = {"checkpoint.bin": 3, "automatic.bin": 45}


@cache
def _spec(name: str) -> lf.Spec:
    content = small()
    if name == "automatic.bin":
        content["lens"].pop("levels")
        content.pop("optimise")
    return parse_spec(content, "sample")


@cache
def _sample(name: str) -> bytes:
    """The checkpoint that a search leaves which its caller has stopped."""
    steps = iter(range(_STOPPED_AT[name]))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        with suppress(lf.Cancelled):
            lf.design(
                _spec(name),
                accuracy="draft",
                threads=1,
                checkpoint=path,
                progress=lambda _: next(steps, None) is not None,
            )
        return path.read_bytes()


def _make(chance: Chance) -> Files:
    file = chance.pick(tuple(_STOPPED_AT))
    content = _sample(file)
    if chance.share(0.4):
        return {file: damaged(chance, content)}
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
    return {file: name + b"\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body}


def _read(folder: Path) -> object:
    """Resume the search; one more step ends it."""
    path = next(folder / name for name in _STOPPED_AT if (folder / name).exists())
    try:
        spec = _spec(path.name)
        return lf.design(spec, accuracy="draft", threads=1, checkpoint=path, resume=True, progress=lambda _: False)
    except lf.Cancelled:
        return None


def _originals() -> list[Files]:
    return [{name: _sample(name)} for name in _STOPPED_AT]


KINDS = [Kind("checkpoint", _make, _read, _originals, 0.05)]
