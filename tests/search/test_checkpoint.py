"""A checkpoint is read back bit for bit, or refused in one line: damaged, hostile, of another scene or version."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.results.json_npz import Form, parse_json, require_forms
from lensforge.search import checkpoint
from lensforge.search.checkpoint import CHECKPOINT, fingerprint, is_checkpoint, load_checkpoint, save_checkpoint
from lensforge.search.design_result import Level
from lensforge.search.optimiser import search
from lensforge.search.schedule import SLICES, Judgement, Outcome
from lensforge.search.search_state import Moments, Parameters, SearchState
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.version import made_by

KEY = "0" * 64
JUDGED = Judgement(merit=0.1, image=0.125, without=(1.0 / 3.0,) * SLICES)


def numbers(*shape: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(sum(shape)).normal(size=shape))


FRESH = SearchState(numbers(9, 2), numbers(2), numbers(2, 30))
SOME = replace(
    FRESH,
    outcomes=(Outcome(steps=3, seconds=1.0 / 7.0, light=JUDGED),),
    step=2,
    moments=Moments(numbers(4, 2), numbers(4, 2) ** 2, numbers(2), numbers(2) ** 2),
    steps_of_moments=5,
    best=Parameters(numbers(5, 2), numbers(2)),
    accepted=Parameters(numbers(6, 2), numbers(2)),
    history=(Level(level=0, functions=9, loss=(0.1, 2e-17), nmse=(1.0, 2.0 / 3.0), efficiency=(0.5, 0.25),
                   constraints={"wall_margin_mm": (-0.1, 0.3)}),),
    seconds=1.1,
)  # fmt: skip


def bits(state: SearchState) -> tuple[object, ...]:
    parts = (state.weights, state.offsets, state.multipliers, *(state.moments or ()))
    parts += (*(state.best or ()), *(state.accepted or ()))
    others = (state.outcomes, state.step, state.steps_of_moments, state.history, state.seconds)
    return (*(part.numpy().tobytes() for part in parts), *others)


def as_they_are(_: object, arrays: Mapping[str, np.ndarray]) -> dict[str, Form]:
    """The forms that the arrays have."""
    return {name: Form(array.shape) for name, array in arrays.items()}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    SOME.save(tmp_path / CHECKPOINT, KEY)
    return tmp_path / CHECKPOINT


@pytest.mark.parametrize("state", [FRESH, SOME, replace(SOME, accepted=None)])
def test_a_state_comes_back_bit_for_bit(state: SearchState, tmp_path: Path) -> None:
    state.save(tmp_path / CHECKPOINT, KEY)
    assert bits(SearchState.load(tmp_path / CHECKPOINT, KEY, as_they_are)) == bits(state)
    assert is_checkpoint(tmp_path / CHECKPOINT)


def test_every_flipped_bit_and_every_cut_is_refused_in_one_line(saved: Path) -> None:
    content = saved.read_bytes()
    draw = np.random.default_rng(16)
    for place in (*range(0, 120, 7), *draw.integers(0, len(content), 60)):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(draw.integers(8))
        for damaged in (bytes(flipped), content[:place]):
            saved.write_bytes(damaged)
            with pytest.raises(InputError, match=r"damaged|no checkpoint of a search") as caught:
                SearchState.load(saved, KEY, as_they_are)
            assert "\n" not in str(caught.value)
            assert not is_checkpoint(saved)


@pytest.mark.parametrize(
    "head",
    [b"", b"[]", b"{}", b"\xff\xfe", b"[" * 4000, b'{"step": 1e999}', json.dumps({"key": KEY, "step": -1}).encode()],
)
def test_a_hostile_head_with_a_right_checksum_is_one_line(head: bytes, tmp_path: Path) -> None:
    content = head + b"\n"
    path = tmp_path / CHECKPOINT
    path.write_bytes(checkpoint._FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
    with pytest.raises(InputError) as caught:
        SearchState.load(path, KEY, as_they_are)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600


@pytest.mark.skipif(os.name != "posix", reason="makes a pipe")
def test_what_is_no_checkpoint_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    torch.save({"key": KEY}, tmp_path / "pickle")
    for name in ("folder", "pipe", "missing", "pickle"):
        with pytest.raises(InputError):
            SearchState.load(tmp_path / name, KEY, as_they_are)


@pytest.mark.parametrize("name", ["lensforge", "torch", "numba"])
def test_one_of_another_version_names_both(name: str, saved: Path) -> None:
    head, arrays = load_checkpoint(saved, KEY)
    save_checkpoint(saved, head.model_copy(update={"made_by": {**made_by(), name: "0.0.1"}}), arrays)
    with pytest.raises(InputError, match=rf"written with {name} 0\.0\.1, here is \d"):
        SearchState.load(saved, KEY, as_they_are)


def with_picture(path: Path) -> Spec:
    target = {"kind": "image", "file": str(path), "width_mm": 100.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    return small_spec(target=target, optimise__steps_per_level=[1, 1], optimise__rays=256)


def test_the_fingerprint_holds_contents_not_folders(tmp_path: Path, saved: Path) -> None:
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
    with pytest.raises(InputError, match="belongs to another spec, file"):
        SearchState.load(saved, key(plain), as_they_are)


def test_a_search_that_starts_anew_drops_the_checkpoint_of_an_earlier_one(tmp_path: Path) -> None:
    class Stop(KeyboardInterrupt):
        pass

    def stop(_: object) -> None:
        raise Stop

    spec = small_spec()
    path = tmp_path / CHECKPOINT
    path.write_bytes(b"of an earlier version")
    with pytest.raises(Stop):
        search(spec, build_source(spec.source), accuracy="draft", checkpoint=path, progress=stop)
    head, _ = load_checkpoint(path, fingerprint(spec, 0, "draft", None, None))
    assert ([outcome.steps for outcome in head.outcomes], head.step) == ([0], 0), (
        "the step whose observer was interrupted is taken again"
    )
    with pytest.raises(InputError, match="belongs to another spec"):  # fewer steps are not the same search
        search(spec, build_source(spec.source), accuracy="draft", checkpoint=path, resume=True, preview=True)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="cannot be replaced"):
        search(spec, build_source(spec.source), accuracy="draft", checkpoint=path)


def test_a_script_resumes_from_a_checkpoint_unless_it_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / CHECKPOINT
    path.write_bytes(b"of an earlier version")
    with pytest.raises(InputError, match="no checkpoint of a search by this version"):
        lf.design(small_spec(), accuracy="draft", checkpoint=path)
    assert path.read_bytes() == b"of an earlier version"
    with pytest.raises(lf.Cancelled):
        lf.design(small_spec(), accuracy="draft", checkpoint=path, resume=False, progress=lambda _: False)
    load_checkpoint(path, fingerprint(small_spec(), 0, "draft", None, None))


FORMS = {"a": Form(("n", 2)), "b": Form((3,), "int64", least=0.0)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, ""),
        ({"a": np.ones((5, 2)), "b": np.array([0, 1, 2])}, ""),
        ({"a": np.ones((4, 3))}, r"array 'a' has the shape \(4, 3\), must be \(n, 2\)"),
        ({"a": np.ones(8)}, r"'a' has the shape \(8,\)"),
        ({"a": np.ones((4, 2), ">f8")}, "'a' is of type >f8, must be float64"),
        ({"a": np.ones((4, 2), "f4")}, "'a' is of type float32, must be float64"),
        ({"a": np.array([[1.0, np.nan]])}, r"'a' holds nan, must be from -1e\+30 to 1e\+30"),
        ({"b": np.array([1, -1, 2])}, "'b' holds -1, must be from 0"),
        ({"b": None}, "'b' is missing"),
        ({"c": np.ones(1)}, "'c' is none of it"),
    ],
)
def test_arrays_are_compared_with_their_forms(changes: dict[str, np.ndarray], message: str) -> None:
    arrays = {"a": np.ones((4, 2)), "b": np.ones(3, np.int64)} | changes
    there = {name: array for name, array in arrays.items() if array is not None}
    if not message:
        require_forms(there, FORMS)
        return
    with pytest.raises(ValueError, match=message):
        require_forms(there, FORMS)


def test_sizes_of_one_name_are_the_same() -> None:
    with pytest.raises(ValueError, match=r"'b' has the shape \(3,\), must be \(4\)"):
        require_forms({"a": np.ones(4), "b": np.ones(3)}, {"a": Form(("n",)), "b": Form(("n",))})


def test_json_of_too_many_values_is_refused_before_it_takes_memory() -> None:
    with pytest.raises(ValueError, match="20000001 values, at most 20000000"):
        parse_json(b"[" + b"," * 20_000_001 + b"]")
