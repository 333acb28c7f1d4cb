"""Checkpoints with a sound digest and another content: the search goes on from it, or one line refuses it.

Names, kinds, shapes, byte order and values of the arrays, and what the head states. LENSFORGE_FUZZ=10: ten times as
many; the search of a level that it chooses itself has stages, judgements and kept parameters, too.
"""

import hashlib
import io
import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import scaled
from presets import FEW_STEPS
from refusals import one_line
from scenes import small_spec

import lensforge as lf
from lensforge.search.checkpoint import _FORMAT, CHECKPOINT
from lensforge.search.optimiser import search
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec

Arrays = dict[str, Any]
Head = dict[str, Any]
_VALUES = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e30, -1e6, 1e-320, -0.0)
_WORDS = (0, 1, -1, 2, 7, 10**6, 2**53, 10**400, 0.5, -0.0, 1e30, 1e308, True, None, "", "x", [], {}, [0], {"a": 1})
_KINDS = ("?", "i1", "<i8", "<f2", "<f4", ">f8", ">i4", "c16", "U3", "S4", "M8[s]", "V8", "O")


def whole(path: Path, spec: Spec, **options: Any) -> lf.Design:
    return search(spec, build_source(spec.source), accuracy=FEWEST, checkpoint=path, **options)


def stopped_after(steps: int, spec: Spec, path: Path) -> tuple[Head, Arrays]:
    """Head and arrays of a checkpoint after so many steps."""
    with pytest.raises(lf.Cancelled):
        whole(path, spec, progress=lambda step: step.steps_done < steps)
    line, _, archive = path.read_bytes().split(b"\n", 2)[2].partition(b"\n")
    return json.loads(line), dict(np.load(io.BytesIO(archive)))


def write(path: Path, head: Head, arrays: Arrays) -> None:
    """A checkpoint with the digest of its content."""
    archive = io.BytesIO()
    np.savez(archive, **arrays)
    content = json.dumps(head).encode() + b"\n" + archive.getvalue()
    path.write_bytes(_FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


def of_other_kind(array: np.ndarray, chance: random.Random) -> np.ndarray:
    return array.astype(chance.choice(_KINDS))


def of_other_shape(array: np.ndarray, chance: random.Random) -> np.ndarray:
    shapes = (array.T, array[:-1], array[None], array[..., None], array.ravel(), array[:0], np.float64(1.0))
    return np.asarray(chance.choice((*shapes, np.concatenate([array, array]), np.repeat(array, 2, axis=-1))))


def of_other_values(array: np.ndarray, chance: random.Random) -> np.ndarray:
    changed = array.copy()
    if chance.random() < 0.2:
        changed[...] = chance.choice(_VALUES)
    else:
        changed.flat[chance.randrange(changed.size)] = chance.choice(_VALUES)
    return changed


def change_arrays(arrays: Arrays, chance: random.Random) -> None:
    name = chance.choice(sorted(arrays))
    kind = chance.randrange(6)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[chance.choice(("extra", "best.weights", "accepted.offsets", "moments", "", "a/b", "x.npy"))] = np.ones(2)
    elif kind == 2:
        arrays[chance.choice(sorted(arrays))] = arrays.pop(name)
    else:
        change = chance.choice((of_other_kind, of_other_shape, of_other_values))
        arrays[name] = change(arrays[name], chance)


def change_head(value: Any, chance: random.Random) -> Any:
    """``value`` with one of its leaves or branches changed."""
    if isinstance(value, dict) and value and chance.random() < 0.9:
        key = chance.choice(sorted(value))
        if chance.random() < 0.1:
            return {name: item for name, item in value.items() if name != key}
        return {**value, key: change_head(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.9:
        place = chance.randrange(len(value))
        kind = chance.random()
        if kind < 0.15:
            return value[:place] + value[place + 1 :]
        if kind < 0.3:
            return value[: place + 1] + value[place:]
        return [*value[:place], change_head(value[place], chance), *value[place + 1 :]]
    return chance.choice(_WORDS)


def changed(head: Head, arrays: Arrays, chance: random.Random) -> tuple[Head, Arrays]:
    arrays = dict(arrays)
    for _ in range(chance.randint(1, 2)):
        if arrays and chance.random() < 0.6:
            change_arrays(arrays, chance)
        else:
            key = chance.choice(sorted(set(head) - {"key", "made_by"}))
            head = {**head, key: change_head(head[key], chance)}
    return head, arrays


def given(**changes: Any) -> Spec:
    return small_spec(optimise__rays=64, evaluate__pixels=8, **changes)


FEWEST = FEW_STEPS.replace("fewest", effort={"steps": (2, 2), "rays": (64, 64), "validation_rays": 64})
SEARCHES = {
    "first level": (given(optimise__steps_per_level=[2, 2]), 1),
    "second level": (given(optimise__steps_per_level=[2, 2]), 3),
    "chosen levels": (small_spec(lens__levels="auto", optimise__steps_per_level=None, optimise__rays=None), 5),
}


def ended(path: Path, spec: Spec) -> str:
    """Why a search does not go on from the checkpoint to its end; empty where it does."""
    try:
        whole(path, spec, resume=True)
    except lf.InputError:
        caught = pytest.ExceptionInfo.from_current()
        return one_line(caught)
    return ""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SEARCHES)
def test_another_content_is_searched_on_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    (spec, steps), path = SEARCHES[name], tmp_path / CHECKPOINT
    head, arrays = stopped_after(steps, spec, path)
    write(path, head, arrays)
    assert ended(path, spec) == ""
    for number in range(scaled(20, by_day=8)):
        write(path, *changed(head, arrays, random.Random(f"{name} {number}")))
        try:
            ended(path, spec)
        except Exception as error:
            raise AssertionError(f"case {name} {number}") from error
