"""A checkpoint is read back bit for bit, or refused in one line: damaged, hostile, of another scene or version."""

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.search import checkpoint
from lensforge.search.checkpoint import (
    CHECKPOINT,
    fingerprint,
    is_checkpoint,
    load_checkpoint,
    made_by,
    save_checkpoint,
)
from lensforge.search.merit import Problems
from lensforge.search.optimiser import search
from lensforge.search.schedule import SLICES, FixedSchedule, Judgement, Outcome, Stage
from lensforge.search.search_state import Moments, SearchState, restored
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec

KEY = "0" * 64
NAMES = ("wall_margin_mm", "radius_margin_mm")
STAGES = [Stage(level, (4, 5), functions, 4, 64, 0.1, 4) for level, functions in enumerate((4, 9))]


def numbers(*shape: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(sum(shape)).normal(size=shape))


FRESH = SearchState(numbers(9, 2), numbers(2), numbers(2, 30))
HEAD = {"key": KEY, "made_by": {}, "outcomes": [], "step": 0, "steps_of_moments": 0, "seconds": 0.0}
ENDED = Outcome(steps=4, seconds=1.5)
JUDGED = Judgement(merit=0.25, image=0.125, without=(0.25,) * SLICES)


def state_at(stage: int, step: int) -> SearchState:
    """A state of the search with FRESH and STAGES, its history as long as its steps."""
    moments = (
        Moments(*(numbers(*shape) for shape in ((STAGES[stage].functions, 2),) * 2 + ((2,),) * 2)) if step else None
    )
    counts = [4] * stage + ([step] if step else [])
    history = [
        {"level": level, "functions": STAGES[level].functions}
        | {name: numbers(count).abs().tolist() for name in ("loss", "nmse", "efficiency", *NAMES)}
        for level, count in enumerate(counts)
    ]
    outcomes, steps = (ENDED,) * stage, step if moments else 0
    return replace(
        FRESH, outcomes=outcomes, step=step, moments=moments, steps_of_moments=steps, history=history, seconds=1.5
    )


class OneProblem(Problems):
    """Problems of a search that begins with ``fresh``: what a checkpoint needs of them."""

    def __init__(self, fresh: SearchState, names: tuple[str, ...]) -> None:
        self.only = SimpleNamespace(
            constraints=SimpleNamespace(keys=names, multipliers=fresh.multipliers),
            parametrisation=SimpleNamespace(basis=SimpleNamespace(size=len(fresh.weights))),
        )

    def of(self, levels: tuple[int, ...]) -> Any:
        return self.only


def again(path: Path, fresh: SearchState = FRESH, names: tuple[str, ...] = NAMES) -> SearchState:
    return restored(path, KEY, FixedSchedule(tuple(STAGES)), OneProblem(fresh, names))


def bits(state: SearchState) -> tuple[object, ...]:
    parts = (state.weights, state.offsets, state.multipliers, *(state.moments or ()))
    return (*(part.numpy().tobytes() for part in parts), state.outcomes, state.step, state.history, state.seconds)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    state_at(1, 3).save(tmp_path / CHECKPOINT, KEY)
    return tmp_path / CHECKPOINT


@pytest.mark.parametrize(("stage", "step"), [(0, 0), (0, 3), (1, 0), (1, 4), (2, 0)])
def test_a_state_comes_back_bit_for_bit(stage: int, step: int, tmp_path: Path) -> None:
    state = state_at(stage, step)
    state.save(tmp_path / CHECKPOINT, KEY)
    assert bits(again(tmp_path / CHECKPOINT)) == bits(state)
    assert is_checkpoint(tmp_path / CHECKPOINT)


def test_every_flipped_bit_is_refused_in_one_line(saved: Path) -> None:
    content, draw = saved.read_bytes(), np.random.default_rng(16)
    for place in (*range(120), *draw.integers(0, len(content), 480)):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(draw.integers(8))
        saved.write_bytes(flipped)
        with pytest.raises(InputError, match=r"damaged|no checkpoint of a search") as caught:
            again(saved)
        assert "\n" not in str(caught.value)
        assert not is_checkpoint(saved)


@pytest.mark.parametrize("length", [0, 1, 22, 23, 60, 88, 200, -8, -1])
def test_a_truncated_one_is_refused_in_one_line(length: int, saved: Path) -> None:
    saved.write_bytes(saved.read_bytes()[:length])
    with pytest.raises(InputError, match="delete it, or start anew"):
        again(saved)


@pytest.mark.parametrize(
    "change",
    [{"outcomes": ()}, {"outcomes": (ENDED,) * 2}, {"outcomes": (ENDED,) * 3}, {"step": 0}, {"step": 2}, {"step": 5},
     {"step": 10**15}, {"outcomes": (ENDED,) * 2, "step": 1}, {"steps_of_moments": 0},
     {"outcomes": (Outcome(steps=4, seconds=1.5, light=JUDGED),)}],
)  # fmt: skip
def test_one_of_another_shape_is_refused_in_one_line(change: dict[str, Any], saved: Path) -> None:
    head, found = load_checkpoint(saved, KEY)
    save_checkpoint(saved, head.model_copy(update=change), found)
    with pytest.raises(InputError, match="of another shape") as caught:
        again(saved)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("points", [numbers(2, 31), numbers(3, 30)])
def test_one_of_another_scene_is_refused(points: torch.Tensor, saved: Path) -> None:
    for fresh, names in ((replace(FRESH, multipliers=points), NAMES), (FRESH, NAMES[:1])):
        with pytest.raises(InputError, match="of another shape"):
            again(saved, fresh, names)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e13, -1e308])
def test_a_number_that_no_search_has_is_refused(value: float, saved: Path) -> None:
    head, found = load_checkpoint(saved, KEY)
    found[7] = value
    save_checkpoint(saved, head, found)
    with pytest.raises(InputError, match="a number beyond"):
        again(saved)


def test_a_history_that_no_search_has_is_refused(saved: Path) -> None:
    head, found = load_checkpoint(saved, KEY)
    found[-4 * 3] = -1.0  # of the NMSE in the second level: loss, NMSE, efficiency and two constraints, 3 steps each
    save_checkpoint(saved, head, found)
    with pytest.raises(InputError, match=r"nmse.*= -1.*delete it, or start anew"):
        again(saved)


def rewritten(path: Path, head: bytes, rest: bytes = b"") -> None:
    """A file with a right checksum over any content."""
    content = head + b"\n" + rest
    path.write_bytes(b"lensforge checkpoint 3\n" + hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


@pytest.mark.parametrize(
    "head",
    [
        b"", b"[]", b"null", b"{}", b"\xff\xfe", b"[" * 4000, b"9" * 4000, b"x" * 10_000, b'{"step": 1e999}',
        *(
            json.dumps(HEAD | bad).encode()
            for bad in (
                {"outcomes": [[0.0]]}, {"outcomes": [{"seconds": float("nan")}]}, {"outcomes": [{"seconds": -1.0}]},
                {"outcomes": [{"seconds": 1.0, "light": {"merit": 1.0, "image": 0.0, "without": [1.0] * SLICES}}]},
                {"outcomes": [{"seconds": 1.0, "light": {"merit": 1.0, "image": 1.0, "without": [1.0]}}]},
                {"step": -1}, {"step": True}, {"made_by": []}, {"more": 1}, {"seconds": float("nan")},
            )
        ),
    ],
)  # fmt: skip
def test_a_hostile_head_with_a_right_checksum_is_one_line(head: bytes, tmp_path: Path) -> None:
    rewritten(tmp_path / CHECKPOINT, head)
    with pytest.raises(InputError) as caught:
        again(tmp_path / CHECKPOINT)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600


def test_no_pickle_of_an_earlier_version_is_opened(tmp_path: Path) -> None:
    path = tmp_path / CHECKPOINT
    torch.save({"key": KEY, "state": {}}, path)
    with pytest.raises(InputError, match="no checkpoint of a search by this version"):
        again(path)


@pytest.mark.skipif(os.name != "posix", reason="makes a pipe")
def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name in ("folder", "pipe", "missing"):
        with pytest.raises(InputError):
            again(tmp_path / name)


def test_one_that_is_too_large_is_not_read(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "_MOST_BYTES", saved.stat().st_size - 1)
    with pytest.raises(InputError, match="must be at most"):
        again(saved)


@pytest.mark.parametrize("name", ["lensforge", "torch", "numba"])
def test_one_of_another_version_names_both(name: str, saved: Path) -> None:
    head, found = load_checkpoint(saved, KEY)
    save_checkpoint(saved, head.model_copy(update={"made_by": {**made_by(), name: "0.0.1"}}), found)
    with pytest.raises(InputError, match=rf"written with {name} 0\.0\.1, here is \d"):
        again(saved)


def with_picture(path: Path) -> Spec:
    target = {"kind": "image", "file": str(path), "width_mm": 100.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    return small_spec(target=target, optimise__steps_per_level=[1, 1], optimise__rays=256)


def test_a_picture_that_was_turned_is_refused(tmp_path: Path) -> None:
    arrow, path = np.zeros((32, 32), np.uint8), tmp_path / CHECKPOINT
    arrow[4:20, 6:12] = arrow[4:9, 6:24] = 255
    Image.fromarray(arrow).save(tmp_path / "arrow.png")
    spec = with_picture(tmp_path / "arrow.png")
    search(spec, build_source(spec.source), accuracy="draft", checkpoint=path)
    search(spec, build_source(spec.source), accuracy="draft", checkpoint=path, resume=True)
    Image.fromarray(arrow[::-1, ::-1]).save(tmp_path / "arrow.png")
    with pytest.raises(InputError, match="belongs to another spec, file"):
        search(spec, build_source(spec.source), accuracy="draft", checkpoint=path, resume=True)


def test_the_fingerprint_holds_contents_not_folders(tmp_path: Path) -> None:
    def key(spec: Spec) -> str:
        return fingerprint(spec, 0, "draft", None, None)

    for folder, value in (("a", 1), ("b", 2), ("c", 1)):
        (tmp_path / folder).mkdir()
        Image.fromarray(np.full((4, 4), value, np.uint8)).save(tmp_path / folder / "arrow.png")
    a, b, c = (key(with_picture(tmp_path / folder / "arrow.png")) for folder in "abc")
    assert a == c != b
    plain = small_spec()
    assert key(plain) == key(small_spec(evaluate__rays=999, base__diameter_mm=20.0)), "not part of the search"
    assert key(plain) != key(small_spec(optimise__rays=999))
    assert key(plain) != fingerprint(plain, 1, "draft", None, None)


def test_a_search_that_starts_anew_drops_the_checkpoint_of_an_earlier_one(tmp_path: Path) -> None:
    class Stop(KeyboardInterrupt):
        pass

    def stop(_: object) -> None:
        raise Stop

    spec, path = small_spec(), tmp_path / CHECKPOINT
    path.write_bytes(b"of an earlier version")
    with pytest.raises(Stop):
        search(spec, build_source(spec.source), accuracy="draft", checkpoint=path, progress=stop)
    head, _ = load_checkpoint(path, fingerprint(spec, 0, "draft", None, None))
    assert (head.outcomes, head.step) == ((), 0), "the step whose observer was interrupted is taken again"
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="cannot be replaced"):
        search(spec, build_source(spec.source), accuracy="draft", checkpoint=path)
