"""Functions called in child processes, where a library holds Python's lock and threads would not help.

A pool writes no results and decides nothing: functions travel to its processes, and what they return comes back, with
the same bits. Its only purpose is speed: if no process starts, or a function fails there, this process calls the
function itself, and raises what the function raises. A warning tells of work that was done twice.
"""

import pickle
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any, Generic, TypeVar, TypeVarTuple, cast

from lensforge.results.child_process import ChildProcess

_Given = TypeVarTuple("_Given")
_Result = TypeVar("_Result")
_Shared = TypeVar("_Shared")
_Item = TypeVar("_Item")
Answer = tuple[bool | None, Any]  # whether a function returned there, and what
NOT_TRIED: Answer = (None, None)


class Called(Generic[_Result]):
    """A call in progress in a child process, or one that this process has yet to make."""

    def __init__(
        self,
        call: Callable[[], _Result],
        answer: "Future[Answer] | None" = None,
        done_again: Callable[[], object] = lambda: None,
    ) -> None:
        self._call = call
        self.answer = answer
        self._done_again = done_again
        self._results: list[_Result] = []

    @property
    def is_done(self) -> bool:
        """True if nobody has to wait for the other process."""
        return self.answer is None or self.answer.done()

    def result(self) -> _Result:
        """Wait for the function's result; call it here if it failed there or has not begun.

        Waiting for its turn would leave this core idle.
        """
        if not self._results:
            begun = self.answer is not None and not self.answer.cancel()
            done, result = self.answer.result() if self.answer is not None and begun else NOT_TRIED
            self._results.append(cast(_Result, result) if done else self._call())
            if done is False:
                self._done_again()
        return self._results[0]


class ChildPool:
    """Child processes that call functions beside this one, in order; without any, calls are made when needed."""

    def __init__(self, children: Sequence[ChildProcess] = (), warn: Callable[[str], object] = warnings.warn) -> None:
        self._living = set(children)
        self._warn = warn
        self._ended = ""
        threads = len(children)
        self._threads = ThreadPoolExecutor(threads) if children else None
        self._idle = SimpleQueue[ChildProcess | None]()
        for child in children:
            self._idle.put(child)

    @property
    def runs(self) -> bool:
        """True if there are processes."""
        return self._threads is not None

    @property
    def busy(self) -> int:
        """Number of processes with a call in progress."""
        return max(0, len(self._living) - self._idle.qsize())

    def call(self, function: Callable[[*_Given], _Result], *given: *_Given) -> Called[_Result]:
        """Call a function of a module in a child process, after earlier calls."""

        def call_here() -> _Result:
            return function(*given)

        if self._threads is None:
            return Called(call_here)
        return Called(call_here, self._threads.submit(self._answer_of_idle, (function, given)), self._say_done_again)

    def map(
        self, function: Callable[[_Shared, _Item], _Result], shared: _Shared, items: Sequence[_Item]
    ) -> Iterator[tuple[int, _Result]]:
        """``function(shared, item)`` for every item, in order of completion: number of the item, and result."""
        calls = [self.call(function, shared, item) for item in items]
        numbers = {call.answer: number for number, call in enumerate(calls) if call.answer is not None}
        try:
            for number in map(numbers.__getitem__, as_completed(numbers)) if numbers else range(len(calls)):
                yield number, calls[number].result()
        finally:
            for answer in numbers:
                answer.cancel()

    def close(self) -> None:
        """Drop calls that have not begun, and wait for the others; the processes were ended before."""
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)

    def _answer_of_idle(self, call: tuple[Any, ...]) -> Answer:
        """Answer of the next idle process; False first if there is none, for whatever reason."""
        try:
            message = pickle.dumps(call, protocol=pickle.HIGHEST_PROTOCOL)
        except Exception:  # it cannot travel: no process is to blame
            return False, None
        child = self._idle.get()
        if child is not None:
            try:
                answer = child.ask(message)
            except Exception as error:  # it has ended, or its answer cannot travel: nothing is lost but the time
                self._ended = self._ended or type(error).__name__
                child.close()  # half a message may be left in a pipe
                self._living.discard(child)
            else:
                self._idle.put(child)
                return answer
        if not self._living:
            self._idle.put(None)  # for all that wait
        return False, None

    def _say_done_again(self) -> None:
        """Warn that work failed in a child and was repeated here."""
        cause = f"it has ended: {self._ended}" if self._ended else "a function failed in it alone"
        self._warn(
            f"a child process failed ({cause}); its work was repeated in this one, which takes longer; is "
            "there enough memory?"
        )


IN_TURN = ChildPool()  # none: all in this process


@contextmanager
def child_pool(count: int, warn: Callable[[str], object] = warnings.warn) -> Iterator[ChildPool]:
    """``count`` child processes until block or this process ends; none if the system has no room.

    ``warn`` is called if one has ended prematurely, and its work was repeated.
    """
    with ExitStack() as stack:
        children = list[ChildProcess]()
        try:
            for _ in range(count):
                folder = stack.enter_context(TemporaryDirectory(prefix="lensforge-", ignore_cleanup_errors=True))
                children.append(stack.enter_context(ChildProcess(Path(folder))))
        except OSError:  # no room for temporary files, too many processes
            children = []
        pool = ChildPool(children, warn) if children else IN_TURN
        try:
            yield pool
        finally:
            for child in children:  # first: the threads of the pool wait for their answers
                child.close()
            pool.close()
