"""One command at a time writes in a folder: another one is refused at once, and a kill frees it."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from addon_rows import addon_rows
from made_once import copied
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.report.pipeline import write_report
from lensforge.report.sweep_runs import run_sweep
from lensforge.report.tradeoff_study import run_tradeoff
from lensforge.report.variation import parse_variation
from lensforge.results.folder_lock import LOCK_FILE, locked
from lensforge.verbs import CHECK, EVALUATE, EXPORT, PHOTOMETRY, SENSITIVITY, STRAY, VERIFY

pytestmark = pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")
_HOLD = """
import sys, time
from pathlib import Path
from lensforge.results.folder_lock import locked
with locked(Path(sys.argv[1]), create=True):
    print("held", flush=True)
    time.sleep(60)
"""


@contextmanager
def holder(folder: Path, script: str = _HOLD) -> Iterator[subprocess.Popen[str]]:
    """A process that holds the lock on ``folder``."""
    process = subprocess.Popen([sys.executable, "-c", script, str(folder)], stdout=subprocess.PIPE, encoding="utf-8")
    try:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.wait()


def test_another_process_is_named_and_a_kill_frees_the_folder(tmp_path: Path) -> None:
    with holder(tmp_path) as process:
        started = time.perf_counter()
        with pytest.raises(InputError) as caught, locked(tmp_path):
            pass
        assert time.perf_counter() - started < 1.0, "it does not wait"
        message = str(caught.value)
        assert message.startswith(f"{tmp_path}: in use by process {process.pid} on ") and "\n" not in message
        assert "`-c " in message and "since 20" in message and "wait until it has ended" in message
        content = (tmp_path / LOCK_FILE).read_bytes()
        with pytest.raises(InputError, match="in use by process"), locked(tmp_path):
            pass
        assert (tmp_path / LOCK_FILE).read_bytes() == content, "the holder's text is not touched"
        process.send_signal(signal.SIGKILL)
        process.wait()
        with locked(tmp_path):
            assert (tmp_path / LOCK_FILE).read_text(encoding="utf-8").startswith(f"{os.getpid()}\n")
    assert list(tmp_path.iterdir()) == []


def test_a_thread_may_lock_again_and_another_thread_may_not(tmp_path: Path) -> None:
    messages: list[str] = []

    def other() -> None:
        try:
            with locked(tmp_path):
                messages.append("locked")
        except InputError as error:
            messages.append(str(error))

    (tmp_path / "link").symlink_to(tmp_path)
    with locked(tmp_path):
        with locked(tmp_path / "link"), locked(tmp_path / "."):
            assert (tmp_path / LOCK_FILE).exists()
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert messages == [
        f"{tmp_path}: in use by another thread of this process; wait until it has ended, or give another folder",
        "locked",
    ]
    assert not (tmp_path / LOCK_FILE).exists()


def test_a_process_of_the_same_number_on_another_machine_is_another_one(tmp_path: Path) -> None:
    """As on a shared disk: the number of a process tells it on its own machine alone."""
    messages: list[str] = []

    def other() -> None:
        with pytest.raises(InputError) as caught, locked(tmp_path):
            pass
        messages.append(str(caught.value))

    with locked(tmp_path):
        (tmp_path / LOCK_FILE).write_text(f"{os.getpid()}\nelsewhere\nlensforge design\n12:00\n", encoding="utf-8")
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
    assert (
        f"in use by process {os.getpid()} on elsewhere (`lensforge design`, since 12:00); if it is gone" in messages[0]
    )


def test_a_lock_file_that_is_left_over_is_taken(tmp_path: Path) -> None:
    for content in (b"", b"\xff\0", b'{"process": 1}', b"[" * 5000):
        (tmp_path / LOCK_FILE).write_bytes(content)
        with locked(tmp_path):
            pass
        assert not (tmp_path / LOCK_FILE).exists()


@pytest.mark.parametrize("folder", ["file/inside", "a\0b", "x" * 300])
def test_a_folder_that_cannot_be_is_said_before_the_search(folder: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        lf.run(small_spec(), tmp_path / folder, progress=lambda _: pytest.fail("searched"))
    assert "\n" not in str(caught.value)


def test_a_folder_whose_name_no_disk_takes_is_said_by_who_reads_it(tmp_path: Path) -> None:
    for read in (lf.load, EVALUATE.run, write_report):
        with pytest.raises(InputError, match=r"cannot be read \(File name too long\); give a result folder$"):
            read(tmp_path / ("x" * 300))


def test_every_stage_that_writes_locks_and_reading_does_not(small_run: lf.Run, tmp_path: Path) -> None:
    folder = copied(small_run.folder, tmp_path / "copy")
    stored = lf.load(folder)
    calls = {
        "run": lambda: lf.run(small_spec(), folder),
        "evaluate": lambda: EVALUATE.run(folder),
        "export": lambda: EXPORT.run(folder),
        "check": lambda: CHECK.run(folder),
        "verify": lambda: VERIFY.run(folder),
        "stray": lambda: STRAY.run(folder),
        "sensitivity": lambda: SENSITIVITY.run(folder),
        "photometry": lambda: PHOTOMETRY.run(folder),
        **{name: partial(call, folder, tmp_path) for name, call in addon_rows("LOCKED").items()},
        "report": lambda: write_report(folder),
        "tradeoff": lambda: run_tradeoff(small_spec(), folder),
        "sweep": lambda: run_sweep(
            small_spec(), parse_variation("constraints.max_radius_mm=6.5,7"), folder, lambda *_: pytest.fail("designed")
        ),
    }  # fmt: skip
    with holder(folder):
        for name, call in calls.items():
            with pytest.raises(InputError) as caught:
                call()
            assert "in use by process" in str(caught.value), name
        assert lf.load(folder) == stored
    with locked(folder):  # the holder was killed
        pass
    assert not (folder / LOCK_FILE).exists()


_COUNT = """
import sys
from pathlib import Path
from lensforge.errors import InputError
from lensforge.results.folder_lock import locked
folder, done = Path(sys.argv[1]), 0
while done < 60:
    try:
        with locked(folder):
            number = int((folder / "number").read_text())
            (folder / "number").write_text(str(number + 1))
            done += 1
    except InputError as error:
        assert "in use by" in str(error), error
"""


def test_many_short_holders_never_meet(tmp_path: Path) -> None:
    """Each deletes the lock's file at its end: who has opened that file meanwhile must not take it for the lock."""
    (tmp_path / "number").write_text("0", encoding="utf-8")
    processes = [subprocess.Popen([sys.executable, "-c", _COUNT, str(tmp_path)]) for _ in range(3)]
    assert [process.wait(timeout=120) for process in processes] == [0, 0, 0]
    assert (tmp_path / "number").read_text(encoding="utf-8") == "180"
    assert [path.name for path in tmp_path.iterdir()] == ["number"]
