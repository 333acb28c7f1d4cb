"""Standard streams of a command that never stop it: a closed pipe, a full disk or another encoding costs no result.

A command writes its files and renews the verdict between two lines of output, so a stream that fails in the middle
must not end it. What cannot be written is dropped; a reader that has left (``| head``) is no error, and any other
failure is told at the end.
"""

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_STANDARD = (0, 1, 2)


class _Output(io.RawIOBase):
    """A file descriptor that takes everything; ``failure``: the first error but that of a reader who has left."""

    def __init__(self, descriptor: int, name: str) -> None:
        self._descriptor = descriptor
        self.name = name
        self.failure: OSError | None = None
        self._lost = False

    def write(self, content: "ReadableBuffer", /) -> int:
        size = len(memoryview(content).cast("B"))
        if self._lost:
            return size
        try:
            return os.write(self._descriptor, content)
        except BrokenPipeError:
            self._lost = True
        except BlockingIOError:  # a terminal or pipe that another program has set not to wait
            os.set_blocking(self._descriptor, True)
            return self.write(content)
        except OSError as error:
            self._lost = True
            self.failure = error
        return size

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        return True


def open_standard_streams() -> None:
    """Open a standard stream that the shell has closed (``>&-``): else a file gets its number, and the output."""
    for descriptor in _STANDARD:
        try:
            os.fstat(descriptor)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # it gets the lowest free number


@contextmanager
def lasting_streams() -> Iterator[Callable[[], OSError | None]]:
    """Replace stdout and stderr, if files, inside the block; the function flushes stdout and returns its failure."""
    before = sys.stdout, sys.stderr
    sys.stdout, output = _lasting(before[0], 1)
    sys.stderr, _ = _lasting(before[1], 2)

    def failure() -> OSError | None:
        if sys.stdout is not None:
            sys.stdout.flush()
        return None if output is None else output.failure

    try:
        yield failure
    finally:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        sys.stdout, sys.stderr = before


def _lasting(stream: TextIO, descriptor: int) -> tuple[TextIO, _Output | None]:
    """``stream`` by way of an :class:`_Output`; characters that its encoding lacks are written as escapes."""
    try:
        if stream is None or stream.fileno() != descriptor:
            return stream, None
    except (OSError, ValueError):  # no file
        return stream, None
    output = _Output(descriptor, stream.name)
    lines = descriptor == 2 or output.isatty()
    return io.TextIOWrapper(
        io.BufferedWriter(output), stream.encoding, "backslashreplace", line_buffering=lines
    ), output
