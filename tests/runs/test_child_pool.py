"""Child processes that call functions: the same answers, however they end, and nothing that they leave behind."""

import operator
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TypeVar

import pytest
from kills import default_signals
from nightly import first_by_day

from lensforge.errors import InputError
from lensforge.kernels.parallel import thread_count
from lensforge.results.child_pool import IN_TURN, Called, ChildPool, child_pool
from lensforge.results.cluster import connected

Result = TypeVar("Result")


@pytest.fixture(scope="module")
def second() -> ChildPool:  # type: ignore[misc]
    with child_pool(1) as pool:
        yield pool


def there(call: Called[Result]) -> Result:
    """Result of a call that has had its turn."""
    assert call.answer is not None
    call.answer.result()
    return call.result()


def test_functions_are_called_in_another_process_one_after_another(second: ChildPool) -> None:
    assert second.runs
    numbers = [second.call(os.getpid) for _ in range(3)]
    assert len({there(number) for number in numbers} - {os.getpid()}) == 1


def test_it_is_busy_while_it_calls_a_function() -> None:
    with child_pool(1) as second:
        assert not second.busy and not IN_TURN.busy
        quick = second.call(os.getpid)
        there(quick)
        assert not second.busy
        second.call(time.sleep, 300.0)
        deadline = time.monotonic() + 60.0
        while not second.busy and time.monotonic() < deadline:
            time.sleep(0.01)
        assert second.busy


_FAULTS = """
import resource, sys
from lensforge.results.worker import keep_freed_memory, return_freed_memory

if sys.argv[1] == "kept":
    keep_freed_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    for block in [bytearray(2**24), bytearray(2**24)]:  # not freed one after the other: the first lies below the second
        block[::4096] = b"1" * 4096
    if sys.argv[2] == "returned":
        del block
        return_freed_memory()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc keeps and returns memory by these calls")
def test_freed_memory_is_kept_for_what_follows_until_it_is_returned() -> None:
    def faults(*how: str) -> int:
        return int(subprocess.check_output([sys.executable, "-c", _FAULTS, *how]))

    pages = 20 * 2 * 2**24 // 4096
    assert faults("kept", "no") < 0.2 * pages, "one pair of blocks"
    assert faults("kept", "returned") > 0.9 * pages


def test_what_has_not_begun_there_is_computed_here() -> None:
    with child_pool(1) as second:
        second.call(time.sleep, 300.0)
        assert [second.call(os.getpid).result() for _ in range(2)] == [os.getpid()] * 2


def test_what_fails_there_alone_is_computed_here_and_told(tmp_path: Path) -> None:
    told: list[str] = []
    with child_pool(1, told.append) as second:
        call = second.call(Path.read_text, tmp_path / "later")
        assert call.answer is not None and call.answer.result() == (False, None)
        (tmp_path / "later").write_text("here")
        assert call.result() == "here"
        assert "a function failed in it alone" in told.pop() and not told
        assert there(second.call(lambda: os.getpid())) == os.getpid()  # it cannot travel
        assert "failed in it alone" in told.pop() and not told and len(second._living) == 1, "no process is to blame"


def test_a_process_that_was_killed_costs_time_alone() -> None:
    told: list[str] = []
    with child_pool(1, told.append) as second:
        sleeps = second.call(time.sleep, 60.0)
        after = second.call(os.getpid)
        (child,) = second._living
        child._process.kill()
        assert there(after) == os.getpid()
        assert len(told) == 1 and "it has ended: EOFError" in told[0]
        del sleeps


def test_a_child_takes_one_thread_and_rounds_as_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of linear algebra depend on its number of threads."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with child_pool(1) as second:
        assert there(second.call(thread_count)) == 1
        assert there(second.call(os.getenv, "OPENBLAS_NUM_THREADS")) == "3"
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    with child_pool(1) as second:
        assert there(second.call(os.getenv, "OPENBLAS_NUM_THREADS")) == "2"


_WHO = "__import__('time').sleep(0.2) or __import__('os').getpid()"  # of the standard library: tests do not travel


def test_items_are_shared_out_and_those_of_a_lost_process_are_done_here() -> None:
    told: list[str] = []
    with child_pool(2, told.append) as pool:
        assert dict(pool.map(operator.mul, 2.0, [1.0, 3.0, 5.0])) == {0: 2.0, 1: 6.0, 2: 10.0}
        assert len({number for _, number in pool.map(eval, _WHO, [{} for _ in range(4)])} - {os.getpid()}) == 2
        with pytest.raises(ZeroDivisionError):
            dict(pool.map(operator.truediv, 1.0, [0.0]))
        assert not told
        for lost in (1, 2):
            child = next(iter(pool._living))
            child._process.kill()
            numbers = [number for _, number in pool.map(eval, _WHO, [{} for _ in range(4)])]
            assert (os.getpid() in numbers) and len(pool._living) == 2 - lost, "the other one goes on"
        assert numbers == [os.getpid()] * 4 and "it has ended" in told[0] and "was repeated in this one" in told[0]
    assert dict(IN_TURN.map(operator.sub, 2.0, [1.0, 3.0])) == {0: 1.0, 1: -1.0}


def test_processes_of_this_machine_are_workers_and_where_there_is_no_room_it_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with connected("local:1") as workers:
        assert dict(workers.map(operator.mul, 2.0, [1.0, 3.0])) == {0: 2.0, 1: 6.0}
    with connected(None) as workers:
        assert workers is IN_TURN

    def full(*_: object) -> None:
        raise OSError("no room")

    monkeypatch.setattr("lensforge.results.child_pool.ChildProcess", full)
    with child_pool(1) as pool:
        assert pool is IN_TURN
    with pytest.raises(InputError, match="local:2: its processes do not start"), connected("local:2"):
        pytest.fail("connected")


# No guard around the main code: a child that imported it would print a second line.
SCRIPT = """
import os, sys, time
from lensforge.results.child_pool import child_pool
print("script", flush=True)
with child_pool(1) as second:
    number = second.call(os.getpid)
    number.answer.result()
    print(number.result(), flush=True)
    asleep = second.call(time.sleep, 300.0)
    if "wait" in sys.argv:
        asleep.there.result()
"""


def started(temporary: Path, *arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, "TMPDIR": str(temporary)},
        preexec_fn=default_signals if os.name == "posix" else None,
    )


def has_ended(number: int) -> bool:
    """True once no such process runs, within some seconds."""
    for _ in range(100):
        try:
            os.kill(number, 0)
            if Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True  # its parent has ended, and nobody has collected it yet
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.1)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it ends with its work")
def test_a_script_needs_no_guard_and_its_end_is_that_of_the_other_process(tmp_path: Path) -> None:
    process = started(tmp_path)
    output, errors = process.communicate(timeout=60)
    first, number = output.splitlines()
    assert (first, errors, process.returncode) == ("script", "", 0)
    assert has_ended(int(number)) and not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it ends with its work")
@pytest.mark.parametrize("how", first_by_day(1, [signal.SIGKILL, signal.SIGINT, signal.SIGTERM], "other signals"))
def test_no_process_is_left_however_the_first_one_ends(how: signal.Signals, tmp_path: Path) -> None:
    process = started(tmp_path, "wait")
    assert process.stdout is not None and process.stdout.readline() == "script\n"
    number = int(process.stdout.readline())
    time.sleep(0.5)  # until it sleeps, and does not wait for a call: the end of the pipe would end it then
    process.send_signal(how)
    process.communicate(timeout=60)
    assert has_ended(number)
    if how is signal.SIGINT:
        assert not list(tmp_path.iterdir()), "its temporary folder, too"
