"""A command in a process of its own, which reads and writes in one folder: its answer, its progress, its pictures.

A process, as a command is ended with all that it has started when the client cancels the call, and as libraries that
it loads stay out of the server. Files that a spec or a table names are read in the folder alone, by ``REACH``.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import time

import anyio
from anyio.abc import ByteReceiveStream
from anyio.streams.text import TextReceiveStream

from lensforge.addons.mcp import tool_process
from lensforge.results.child_process import TEMPORARY
from lensforge.results.files import REACH, temporary_folder

_MOST_PICTURES = 4
_MOST_PICTURE_BYTES = 2**20

Report = Callable[[str], Awaitable[None]]  # takes a line of progress


@dataclass(frozen=True)
class CommandAnswer:
    """Output of a command: ``out`` and ``notes`` are texts on stdout and stderr, ``pictures`` PNG files."""

    code: int
    out: str
    notes: str
    pictures: tuple[Path, ...]


async def call(module_line: Sequence[str], folder: Path, report: Report) -> CommandAnswer:
    """Run a module with its arguments in ``folder``; each line of its progress goes to ``report``."""
    begun_s = time()
    with temporary_folder("mcp") as scratch:
        reach = os.pathsep.join(map(str, (folder, scratch)))
        process = await anyio.open_process(
            [sys.executable, "-P", "-m", tool_process.__name__, str(os.getpid()), *module_line],
            cwd=folder,
            env={**os.environ, REACH: reach, **dict.fromkeys(TEMPORARY, str(scratch))},
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        out: list[str] = []
        notes: list[str] = []

        async def keep(text: str) -> None:
            out.append(text)

        async def tell(text: str) -> None:
            notes.append(text)
            if line := text.strip():
                await report(line)

        try:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(_read, process.stdout, keep)
                tasks.start_soon(_read, process.stderr, tell)
            code = await process.wait()
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            with anyio.CancelScope(shield=True):
                await process.aclose()
    return CommandAnswer(code, "".join(out), "".join(notes).strip(), _pictures_since(begun_s, folder))


async def _read(stream: ByteReceiveStream | None, take: Report) -> None:
    if stream is not None:
        async for text in TextReceiveStream(stream, errors="replace"):
            await take(text)


def _pictures_since(begun_s: float, folder: Path) -> tuple[Path, ...]:
    """The newest PNG files of ``folder`` that have been written since then, of a size that a client takes."""
    written = []
    for path in folder.rglob("*.png"):
        status = path.lstat()
        if status.st_mtime >= begun_s and status.st_size <= _MOST_PICTURE_BYTES and not path.is_symlink():
            written.append((status.st_mtime, path))
    return tuple(path for _, path in sorted(written)[-_MOST_PICTURES:])
