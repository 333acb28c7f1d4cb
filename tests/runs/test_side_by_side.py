"""The stages after a search give the same files on one thread and on two; what is told of them, and their lines."""

import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
import torch
from made_once import copied
from rich.console import Console
from scenes import small_spec

import lensforge as lf
from lensforge.cli.progress import DesignProgress, StageClock
from lensforge.kernels.parallel import thread_count
from lensforge.report import pipeline
from lensforge.report.folder import RunFolder, opened
from lensforge.report.pipeline import Listener, _second_process, build, run_later_stages
from lensforge.results import child_pool
from lensforge.results.arguments import threads_of_torch
from lensforge.results.child_pool import Called, ChildPool

TIMES = {"seconds", "content_sha256"}  # computing times, and the checksum that covers them
LATER = ["evaluate", "export", "check", "verify", "photometry"]


def without_times(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: without_times(value) for key, value in content.items() if key not in TIMES}
    return [without_times(value) for value in content] if isinstance(content, list) else content


def files(folder: Path) -> dict[str, Any]:
    """Content of each result file, without computing times."""
    return {
        path.name: without_times(json.loads(path.read_text(encoding="utf-8")))
        if path.suffix == ".json"
        else path.read_bytes()
        for path in sorted(folder.iterdir())
        if path.suffix != ".html"
    }


def in_a_copy(run: lf.Run, folder: Path, threads: int) -> list[tuple[str, str]]:
    """What is told while the later stages run in ``folder`` on a copy of the lens."""
    folder.mkdir()
    for name in ("lens.json", "design.json", "run.json"):
        shutil.copy(run.folder / name, folder)
    told: list[tuple[str, str]] = []
    with threads_of_torch(threads):
        before = torch.get_num_threads()
        heard = Listener(lambda name: told.append(("begins", name)), lambda name, _: told.append(("ended", name)))
        with _second_process(small_spec(), warnings.warn) as second:
            run_later_stages(RunFolder(folder), heard, second)
        assert torch.get_num_threads() == before
    return told


@pytest.mark.nightly("fifteen seconds")
def test_one_thread_and_two_make_the_same_files(
    small_run: lf.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Side by side, no stage reads the files as if somebody else had made them: that takes a child, and its limits.

    The small run was made on one thread.
    """
    monkeypatch.setattr("lensforge.proof.sandboxed_casts._cast_in_child", None)
    told = in_a_copy(small_run, tmp_path / "two", threads=2)
    copied(small_run.folder, tmp_path / "one")
    assert [name for what, name in told if what == "begins"] == ["export", "evaluate", "photometry", "check", "verify"]
    assert sorted(name for what, name in told if what == "ended") == sorted(LATER)
    assert told.index(("ended", "evaluate")) < told.index(("ended", "export")), "beside it"

    one, two = files(tmp_path / "one"), files(tmp_path / "two")
    assert sorted(one) == sorted(two) and [name for name in one if one[name] != two[name]] == []
    assert lf.load(tmp_path / "two").verdict == lf.load(tmp_path / "one").verdict


def test_on_one_thread_a_stage_begins_when_the_one_before_it_has_ended(
    small_run: lf.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_pool, "ChildProcess", None)  # none is asked for
    done: list[str] = []

    def in_place_of(name: str) -> Callable[..., None]:
        return lambda *_: done.append(name)

    for verb, name in zip(("evaluate", "build", "check", "verify", "photometry"), LATER, strict=True):
        monkeypatch.setattr(f"lensforge.report.pipeline.{verb}", in_place_of(name))
    monkeypatch.setattr(RunFolder, "write", lambda _, result: result)
    told = in_a_copy(small_run, tmp_path / "one", threads=1)
    assert done == LATER
    assert told == [(what, name) for name in LATER for what in ("begins", "ended")]


def test_light_takes_all_threads_that_the_second_process_leaves(
    small_run: lf.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[str, int]] = []
    part, check = small_run.part, small_run.check

    class Second:
        busy = True

        def call(self, function: object, *_: object) -> Called[lf.Part] | Called[lf.Check]:
            return Called(lambda: part) if function is build else Called(lambda: check)

    second = Second()

    def in_place_of(name: str, result: object) -> Callable[..., object]:
        def stage(*_: object) -> object:
            seen.append((name, thread_count()))
            second.busy = False  # the part is made
            return result

        return stage

    for verb, result in (("evaluate", small_run.light), ("photometry", None), ("verify_with", small_run.proof)):
        monkeypatch.setattr(f"lensforge.report.pipeline.{verb}", in_place_of(verb, result))
    monkeypatch.setattr(RunFolder, "write", lambda _, result: result)
    with opened(copied(small_run.folder, tmp_path / "copy")) as here:
        pipeline._side_by_side(here, Listener(), cast(ChildPool, second), threads=3)
    assert seen == [("evaluate", 2), ("photometry", 3), ("verify_with", 2)]


def test_the_seconds_of_the_whole_command_stay_until_the_next_design(small_run: lf.Run, tmp_path: Path) -> None:
    folder = copied(small_run.folder, tmp_path / "copy")
    whole = small_run.seconds
    assert whole is not None and whole > max(small_run.design.seconds, small_run.part.seconds)
    RunFolder(folder).write(small_run.light)
    assert lf.load(folder).seconds == whole, "a stage that ran again is no whole command"
    RunFolder(folder).write(small_run.design)
    assert lf.load(folder).seconds is None
    RunFolder(folder).renew(seconds=whole + 12.5)
    assert lf.load(folder).seconds == whole + 12.5


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal in the place of stderr."""
    for name, value in {"FORCE_COLOR": "1", "COLUMNS": "80", "TERM": "xterm"}.items():
        monkeypatch.setenv(name, value)


def shown_lines(clock: StageClock) -> list[str]:
    """What a terminal shows now, line by line."""
    console = Console(width=80, no_color=True)
    with console.capture() as capture:
        console.print(clock._progress.get_renderable())
    return capture.get().splitlines()


def test_a_terminal_shows_what_runs_beside(terminal: None) -> None:
    with StageClock("design") as clock:
        shown = DesignProgress(clock, small_spec())
        for name in ("export", "evaluate"):
            shown.on_stage(name)
        assert [line.split() for line in shown_lines(clock)] == [["export", "0.0", "s"], ["evaluate", "0.0", "s"]]
        shown.on_end("export", 1.0)
        assert [line.split() for line in shown_lines(clock)] == [["evaluate", "0.0", "s"]]


@pytest.mark.parametrize(("levels", "phrase"), [([9, 25], "22 s left"), ("auto", "at least 22 s left")])
def test_the_time_left_is_that_of_the_whole_command(levels: list[int] | str, phrase: str, terminal: None) -> None:
    """Half of a search took 10 s; the stages after it take 0.6 of its 20 s at standard accuracy: 22 s are left."""
    with StageClock("design") as clock:
        spec = small_spec(lens__levels=levels, **({"optimise": {}} if levels == "auto" else {}))
        shown = DesignProgress(clock, spec)
        for done in (0, 50, 100):
            step = lf.Progress(
                level=0, step=done, steps_done=done, steps_total=100, nmse=0.1, efficiency=0.9, functions=9,
                level_done=False, seconds=done / 5, accuracy="standard", lens=pytest.fail,
            )  # fmt: skip
            shown.on_step(step)
            if done == 50:
                assert shown_lines(clock)[0].rstrip().endswith(f"NMSE 0.1000, {phrase}")
        shown.on_stage("evaluate")
        assert shown_lines(clock)[0].rstrip().endswith("s, 12 s left"), "of the later stages"
