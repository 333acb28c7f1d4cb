"""Cases of the fuzzer over every kind of file, those that have failed once, and the fuzzer's own judgement.

LENSFORGE_FUZZ=10 reads ten times as many.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import pytest
from fuzzing import driver, kinds, outcome, samples
from fuzzing.chance import Chance
from fuzzing.kept import kept_cases
from fuzzing.kind import Kind
from fuzzing.worker import Batch
from nightly import NIGHTLY, scaled

import lensforge as lf

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
CASES = scaled(1000)
FEWEST = 5  # of each kind, whatever its share
CHILDREN = ("step", "base", "threemf")  # read in a process of their own, which takes seconds
BOTH_ENDS = ("spec", "tm25", "csv", "png", "tiff")
SLOW = {"report": 2, "handover": 2, "first_step": 3, "checkpoint": 5, **dict.fromkeys(CHILDREN, 1)}


@pytest.fixture(scope="module")
def folder(whole_run: lf.Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the whole result folder, with the files that are read elsewhere."""
    copy = tmp_path_factory.mktemp("fuzz") / "samples"
    shutil.copytree(whole_run.folder, copy)
    samples.add_samples(copy)
    samples.use_folder(copy, False)
    return copy


@pytest.fixture
def batch(folder: Path, tmp_path: Path):
    with tempfile.TemporaryFile() as printed:
        yield lambda kind: Batch(kind, tmp_path, folder, printed.fileno())


def share_of(name: str) -> int:
    found = kinds.chosen(())
    counts = kinds.counts_of(found, CASES, CASES // 5)
    return next(count for kind, count in zip(found, counts, strict=True) if kind.name == name)


def require_record(folder: Path, name: str) -> None:
    if name in kinds.OPTIONAL and not (folder / f"{name}.json").exists():
        pytest.skip("the samples have no such record")


@pytest.mark.parametrize("name", kinds.NAMES)
def test_every_case_is_read_or_refused_in_one_line(folder: Path, batch, name: str) -> None:
    require_record(folder, name)
    if name in CHILDREN and not NIGHTLY:
        pytest.skip("seconds for each case; nightly")
    reader = batch(kinds.kind_named(name))
    unchanged = reader.read(reader.kind.original()[0], -1)
    assert unchanged.state == "accepted", unchanged
    for seed in range(max(share_of(name), FEWEST) if name not in SLOW else SLOW[name] * CASES // 1000):
        found = reader.read(reader.kind.case(seed), seed)
        assert found.state != "failed", f"python benchmarks/fuzz.py --kind {name} --seed {seed}: {found}"
    if name in BOTH_ENDS:  # a mutator that leaves nothing readable tests one line of a reader
        assert reader.counts["accepted"] >= 3 and reader.counts["refused"] >= 10


@pytest.mark.parametrize("name", [name for name in kinds.NAMES if name not in SLOW])
def test_unchanged_files_are_accepted(folder: Path, batch, name: str) -> None:
    require_record(folder, name)
    kind = kinds.kind_named(name)
    reader = batch(kind)
    for files in kind.original():
        found = reader.read(files, 0)
        assert found.state == "accepted", found


@pytest.mark.parametrize("case", kept_cases(), ids=lambda case: f"{case.kind}-{case.seed}")
def test_cases_that_have_failed_once_do_not_again(batch, case) -> None:
    found = batch(kinds.kind_named(case.kind)).read(case.files, case.seed)
    assert found.state != "failed", f"{case.was}; now {found}"


@pytest.mark.nightly("another process with all kinds")
def test_a_seed_means_the_same_case_in_another_process() -> None:
    names = ("spec", "tm25", "csv", "ies", "png", "tiff", "stl", "radiance")
    code = (
        "import hashlib, sys; from fuzzing.kinds import kind_named\n"
        f"for name in {names!r}:\n"
        "    for seed in range(20):\n"
        "        print(hashlib.sha256(repr(sorted(kind_named(name).case(seed).items())).encode()).hexdigest())\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(BENCHMARKS), "PYTHONHASHSEED": "7"}
    there = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True, env=environment
    )
    here = [repr(sorted(kinds.kind_named(name).case(seed).items())) for name in names for seed in range(20)]
    assert there.stdout.split() == [hashlib.sha256(text.encode()).hexdigest() for text in here]


def fake(read) -> Kind:
    return Kind("fake", lambda chance: {"x": chance.bytes(4)}, read, lambda: [{"x": b""}])


def raises(error: BaseException):
    def read(folder: Path) -> None:
        raise error

    return read


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (raises(ValueError("x")), "ValueError"),
        (raises(SystemExit(1)), "SystemExit"),
        (raises(MemoryError()), "MemoryError"),
        (raises(lf.InputError("two\nlines")), "printable"),
        (raises(lf.InputError("half a character \ud800")), "printable"),
        (raises(lf.InputError("x" * 1000)), "characters"),
        (raises(lf.InputError("")), "empty"),
        (raises(lf.InputError("x: damaged (MemoryError)")), "memory"),
        (lambda folder: warnings.warn("overflow", RuntimeWarning, stacklevel=1), "RuntimeWarning"),
    ],
)
def test_all_but_one_line_is_a_failure(tmp_path: Path, read, words: str) -> None:
    found = outcome.outcome_of(read, tmp_path)
    assert found.state == "failed" and words in found.message


def test_one_line_and_silence_are_no_failures(tmp_path: Path) -> None:
    assert outcome.outcome_of(raises(lf.InputError("x: 3, must be 4")), tmp_path).state == "refused"
    assert outcome.outcome_of(lambda folder: None, tmp_path).state == "accepted"


WORKER = """
import os, sys, time
from pathlib import Path
sys.path.insert(0, {benchmarks!r})
from fuzzing.kind import Kind
from fuzzing import worker

def read(folder):
    seed = int((folder / "x").read_bytes() or b"0")
    if seed == 3:
        os.abort()
    if seed == 5:
        time.sleep(60)
    if seed == 6:
        print("noise", flush=True)
    if seed == 7:
        block = bytearray(200 * 2**20)
        block[::4096] = b"x" * len(block[::4096])
    if seed == 8:
        bytearray(10**12)

worker.MOST_MIB = 100
options = dict(zip(sys.argv[1::2], sys.argv[2::2]))
first, count = int(options["--seed"]), int(options["--cases"])
class Numbered(Kind):
    def case(self, seed):
        return {{"x": str(seed).encode()}}
worker.work(Numbered("fake", None, read, lambda: [{{"x": b""}}]), first, count, Path(options["--state"]), None)
"""


def test_a_case_that_ends_its_process_hangs_prints_or_takes_all_memory_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "_PATIENCE", 0.3)
    script = tmp_path / "worker.py"
    script.write_text(WORKER.format(benchmarks=str(BENCHMARKS)))
    (tally,) = driver.run([fake(lambda folder: None)], [12], 0, 1, [sys.executable, str(script)])
    found = {failure["seed"]: str(failure["message"]) for failure in tally.failures}
    assert set(found) == {3, 5, 6, 7, 8}
    assert "ended the process" in found[3] and "hung" in found[5] and "noise" in found[6]
    assert "MiB" in found[7] and "MemoryError" in found[8]
    assert tally.cases == 12


def test_choices_do_not_depend_on_the_version_of_python() -> None:
    """The first numbers of a case, written down: kept seeds mean what they meant."""
    chance = Chance("ldt", 123)
    assert [chance.below(1000) for _ in range(5)] == [486, 477, 242, 486, 929]


@pytest.mark.parametrize(
    ("name", "guard", "words"),
    [
        ("load", "lensforge.runs.run_folder.require_recorded", "is not the result whose hash"),
        ("evaluate", "lensforge.results.stage_result.require_checksum", "the checksum of other content"),
    ],
)
def test_the_fuzzer_finds_a_guard_that_is_missing(
    batch, monkeypatch: pytest.MonkeyPatch, name: str, guard: str, words: str
) -> None:
    reader = batch(kinds.kind_named(name))
    reader.read(reader.kind.original()[0], -1)
    cases = [reader.kind.case(seed) for seed in range(150)]
    monkeypatch.setattr(guard, lambda content, *_: content)
    assert any(words in reader.read(files, seed).message for seed, files in enumerate(cases))
