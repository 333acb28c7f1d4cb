"""The pipe from the studio to its process: jobs come as lines of JSON, frames go, each after its length (uint32)."""

import _thread
import json
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

import numpy as np

from lensforge.addons.studio.page_frames import Fields, packed


class JobPipe:
    """Jobs in their order, and the frames that answer them.

    ``asked``: "pause", "stop" or "enough" of the job that runs, "" for nothing. ``figure``: of the faces, as the page
    has it. ``newest``: version of the text that is to be judged last.
    """

    def __init__(self) -> None:
        self.asked = ""
        self.figure = "sag"
        self.newest = 0
        self._interruptible = False
        self._jobs = SimpleQueue[Fields | None]()
        self._lock = threading.Lock()
        self._out = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)  # what libraries print
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            job = json.loads(line)
            if job["job"] == "figure":
                self.figure = job["name"]
            elif job["job"] in ("pause", "stop", "enough"):
                self._ask(job["job"])
            else:
                if job["job"] == "judge":
                    self.newest = job["version"]
                elif job["job"] in ("search", "part"):
                    self.asked = ""  # now, not when it begins: what is asked from here on is of this job
                self._jobs.put(job)
        self._ask("stop")
        self._jobs.put(None)

    def _ask(self, what: str) -> None:
        self.asked = what
        if self._interruptible:
            _thread.interrupt_main()

    def jobs(self) -> Iterator[Fields]:
        """The jobs in their order, until the studio ends."""
        while (job := self._jobs.get()) is not None:
            yield job

    @contextmanager
    def interrupting(self, job: Mapping[str, Any]) -> Iterator[None]:
        """Interrupt the ``job`` of the block at "pause" or "stop", if it is of a kind that does not poll ``asked``."""
        self._interruptible = job["job"] in ("part", "look")
        try:
            yield
        finally:
            self._interruptible = False

    def send(self, kind: str, arrays: Mapping[str, np.ndarray] | None = None, **more: object) -> None:
        """Send a frame."""
        frame = packed({"kind": kind, **more}, arrays or {})
        with self._lock:
            self._out.write(len(frame).to_bytes(4, "little") + frame)
            self._out.flush()

    def warn(self, warning: str) -> None:
        """Send a warning."""
        self.send("warning", words=warning)
