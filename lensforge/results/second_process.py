"""A second process beside this one, for work in which a library holds Python's lock and threads would not help.

It is a fresh Python that imports nothing of the script that called the library, so no script needs a guard around its
main code. It writes no results and decides nothing: functions travel there, and what they return comes back, with the
same bits. It is there to be faster, and for nothing else: where it cannot be had, or a function fails in it, this
process calls the function itself, and raises what the function raises. Work that was done twice is told by a warning.
So it does with a function whose result it needs and that has not begun there: waiting for its turn would leave this
core idle.
"""

import os
import pickle
import subprocess
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from typing import IO, Any, Generic, TypeVar, TypeVarTuple, cast

from lensforge.errors import InputError
from lensforge.results.files import temporary_folder
from lensforge.results.sandbox import kill_group, worker_command

_Given = TypeVarTuple("_Given")
_Result = TypeVar("_Result")
_Before = TypeVar("_Before")
Answer = tuple[bool | None, Any]  # whether a function returned there, and what
NOT_TRIED: Answer = (None, None)


class Called(Generic[_Result]):
    """A call that goes on beside this process, or that has yet to begin in it."""

    def __init__(
        self,
        here: Callable[[], _Result],
        there: "Future[Answer] | None" = None,
        done_again: Callable[[], object] = lambda: None,
    ) -> None:
        self._here, self.there, self._done_again = here, there, done_again
        self._results: list[_Result] = []

    def result(self) -> _Result:
        """Wait for what the function returns; where the second process has failed or not begun, call it here."""
        if not self._results:
            begun = self.there is not None and not self.there.cancel()
            done, result = self.there.result() if self.there is not None and begun else NOT_TRIED
            self._results.append(cast(_Result, result) if done else self._here())
            if done is False:
                self._done_again()
        return self._results[0]


class SecondProcess:
    """Functions called beside this process, one after another; without a process each is called as it is needed."""

    def __init__(
        self,
        process: "subprocess.Popen[bytes] | None" = None,
        thread: ThreadPoolExecutor | None = None,
        warn: Callable[[str], object] = warnings.warn,
    ) -> None:
        self._process, self._thread, self._warn = process, thread, warn
        self._busy, self._ended = False, ""

    @property
    def runs(self) -> bool:
        """True where there is a process."""
        return self._process is not None

    @property
    def busy(self) -> bool:
        """True while it calls a function."""
        return self._busy

    def call(self, function: Callable[[*_Given], _Result], *given: *_Given) -> Called[_Result]:
        """Call a function of a module there, after those that were called before."""

        def here() -> _Result:
            return function(*given)

        if self._thread is None:
            return Called(here)
        return Called(here, self._thread.submit(self._exchange, (function, given)), self._say_done_again)

    def call_after(
        self,
        before: Called[_Before],
        given: Callable[[_Before], tuple[*_Given]],
        function: Callable[[*_Given], _Result],
    ) -> Called[_Result]:
        """Call a function of what is ``given`` by the result of a call ``before``, as soon as that is known."""

        def here() -> _Result:
            return function(*given(before.result()))

        def there() -> Answer:
            if before.there is None or before.there.cancelled():
                return NOT_TRIED
            done, result = before.there.result()  # it had its turn before
            return self._exchange((function, given(result))) if done else NOT_TRIED

        return Called(here, None if self._thread is None else self._thread.submit(there), self._say_done_again)

    def _say_done_again(self) -> None:
        """Warn that work has failed there, and was done again here."""
        cause = f"it has ended: {self._ended}" if self._ended else "a function failed in it alone"
        self._warn(
            f"the second process did not help ({cause}); its work was done again in this one, which takes longer: is "
            "there memory for both?"
        )

    def _exchange(self, call: tuple[Any, ...]) -> Answer:
        """Send a call and wait for its answer; False first where there is none, for whatever reason."""
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        self._busy = True
        try:
            process.stdin.write(pickle.dumps(call, protocol=pickle.HIGHEST_PROTOCOL))
            process.stdin.flush()
            done, result = pickle.load(process.stdout)
        except Exception as error:  # it has ended, or what travels cannot: nothing is lost but the time
            self._ended = self._ended or type(error).__name__
            kill_group(process)  # half a message may be left in a pipe
            return False, None
        finally:
            self._busy = False
        return bool(done), result


IN_TURN = SecondProcess()  # none: all in this process


@contextmanager
def second_process(wanted: bool = True, warn: Callable[[str], object] = warnings.warn) -> Iterator[SecondProcess]:
    """A second process until block or this process ends; none if not ``wanted``, or where the system has no room.

    ``warn`` is called where it has ended before its time, and its work was done again.
    """
    with ExitStack() as stack:
        process = _started(stack) if wanted else None
        if process is None:
            yield IN_TURN
            return
        thread = ThreadPoolExecutor(1)
        stack.callback(thread.shutdown, cancel_futures=True)
        stack.callback(kill_group, process)  # before that, as its thread waits for an answer
        yield SecondProcess(process, thread, warn)


def _started(stack: ExitStack) -> "subprocess.Popen[bytes] | None":
    """The process, with a temporary folder of its own, which goes with the block."""
    try:
        folder = stack.enter_context(temporary_folder("second process"))
        process = subprocess.Popen(
            worker_command(),
            env={**os.environ, **{name: str(folder) for name in ("TMPDIR", "TEMP", "TMP")}},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # an interrupt at the terminal is for this process, which ends the other
        )
    except (InputError, OSError):  # no room in the temporary folder, too many processes
        return None
    for pipe in (process.stdin, process.stdout):
        stack.callback(_close, pipe)
    return process


def _close(pipe: IO[bytes] | None) -> None:
    with suppress(OSError):  # of what the process has not read
        if pipe is not None:
            pipe.close()
