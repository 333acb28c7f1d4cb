"""First code of a second process: it calls the functions that its parent sends, one after another, until the last.

Arguments: folder that holds the package, number of the parent process. Calls come on stdin and answers go to stdout, as
pickles of pickles: a call that cannot be read leaves the next one readable. What libraries print goes nowhere.
"""

import os
import pickle
import sys
from pathlib import Path
from typing import IO

if __name__ == "__main__":
    sys.path.append(sys.argv[1])  # last: where the package is installed, this folder is in the path already

import lensforge
from lensforge.results.freed_memory import return_freed_memory
from lensforge.results.worker import collect_garbage_seldom, end_with_parent
from lensforge.results.working_folder import ignore_settings_in_working_folder


def send(message: bytes, pipe: IO[bytes]) -> None:
    """Send one message."""
    pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.flush()


def receive(pipe: IO[bytes]) -> bytes:
    """Wait for the next message. Raises :class:`EOFError` where there will be none."""
    message: bytes = pickle.load(pipe)
    return message


def packed(content: object) -> bytes:
    """A call or an answer as a message."""
    return pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)


def answer_calls(calls: IO[bytes], answers: IO[bytes]) -> None:
    """Answer every call until there are no more: True and what the function returns, or False where it raises."""
    while True:
        try:
            message = receive(calls)
        except EOFError:
            return
        answer = _answer(message)
        del message  # tens of MB, as is the answer
        send(answer, answers)
        del answer
        return_freed_memory()


def _answer(message: bytes) -> bytes:
    try:
        function, arguments = pickle.loads(message)
        return packed((True, function(*arguments)))
    except Exception:  # the parent calls the function itself, and raises what it raises there
        return packed((False, None))


def _own_pipes() -> tuple[IO[bytes], IO[bytes]]:
    """Pipes of calls and of answers; nothing else reads from the one or writes into the other."""
    pipes = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1):
        os.dup2(nothing, number)
    return pipes


if __name__ == "__main__":
    if Path(lensforge.__file__).resolve().parents[1] != Path(sys.argv[1]):
        os._exit(1)  # another version is installed: its parent would get other bits
    end_with_parent(int(sys.argv[2]))
    collect_garbage_seldom()
    ignore_settings_in_working_folder()
    answer_calls(*_own_pipes())
    os._exit(0)  # nothing to be saved; the CAD kernel would take a second to end
