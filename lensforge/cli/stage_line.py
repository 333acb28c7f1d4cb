"""The line of a running stage; as a script, the process that draws it where the command cannot.

The CAD kernel and the renderer compute for seconds without letting go of Python's lock: no thread of the command runs
then, and its clock would stand. A process of its own draws the line as soon as the command is silent. It imports
nothing but the standard library, so that it starts in hundredths of a second.
"""

import json
import os
import select
import signal
import time

NAME_COLUMNS, TIME_COLUMNS = 12, 12
_FRAME_SECONDS, _SILENT_SECONDS = 0.25, 1.0


def duration(seconds: float) -> str:
    """Format a time: "0.8 s", "47 s", "7 min 05 s", "1 h 12 min"."""
    whole = round(seconds)
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def stage_line(name: str, seconds: float, detail: str) -> str:
    """Format a stage, its time, and how far it is."""
    return f"{name:<{NAME_COLUMNS}} {duration(seconds):>{TIME_COLUMNS}}  {detail}".rstrip()


def report(pipe: int, name: str, began: float, detail: str, columns: int) -> None:
    """Tell the process that reads ``pipe`` what to draw; ``began``: the stage, by the monotonic clock (s)."""
    os.write(pipe, json.dumps([name, began, detail, columns]).encode() + b"\n")


def draw_when_silent() -> None:
    """Read reports from stdin until it ends; where none comes for a second, draw the line of the last one on stderr."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the command, whose end this process sees
    last, heard, rest = None, time.monotonic(), b""
    while True:
        if select.select([0], [], [], _FRAME_SECONDS)[0]:
            data = os.read(0, 1 << 16)
            if not data:
                return
            *lines, rest = (rest + data).split(b"\n")
            last, heard = json.loads(lines[-1]) if lines else last, time.monotonic()
        elif last is not None and time.monotonic() - heard > _SILENT_SECONDS:
            name, began, detail, columns = last
            line = stage_line(name, time.monotonic() - began, detail) if name else ""
            os.write(2, f"\r\x1b[2K{line[:columns]}".encode())


if __name__ == "__main__":
    draw_when_silent()
