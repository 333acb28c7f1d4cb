"""Seconds and memory of a command and of all processes that it starts. Linux only."""

import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PAUSE_S = 0.5  # between two looks at the memory, which take 20 ms: more often they would take a quarter of a core


@dataclass(frozen=True)
class Peak:
    """Seconds of a command, and the largest memory (MiB) of all its processes together.

    ``anonymous``: what they have allocated; ``held``: with their part of what they share; ``resident``: with the pages
    of mapped files, once for each process.
    """

    seconds: float
    anonymous: float
    held: float
    resident: float


def watched(command: Sequence[str], folder: Path | None = None, **environment: str) -> Peak:
    """Run a command, which may miss a criterion (exit code 1), and look at its memory until it ends."""
    started, peak = time.perf_counter(), np.zeros(3)
    process = subprocess.Popen(command, cwd=folder, env={**os.environ, **environment}, stderr=subprocess.DEVNULL)
    while process.poll() is None:
        peak = np.maximum(peak, sum((np.array(_memory(pid)) for pid in _family(process.pid)), np.zeros(3)))
        time.sleep(PAUSE_S)
    if process.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return Peak(time.perf_counter() - started, *peak.tolist())


def _family(pid: int) -> list[int]:
    """The process ``pid`` and all that it started."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
        children = [child for task in tasks for child in (task / "children").read_text().split()]
    except OSError:  # it has just ended
        return []
    return [pid, *(other for child in children for other in _family(int(child)))]


def _memory(pid: int) -> tuple[float, float, float]:
    """Anonymous, held and resident memory (MiB) of a process; 0 where it has just ended."""
    try:
        found = _kib(Path(f"/proc/{pid}/status")) | _kib(Path(f"/proc/{pid}/smaps_rollup"))
    except OSError:
        return 0.0, 0.0, 0.0
    anonymous, held, resident = (found.get(name, 0) / 1024.0 for name in ("RssAnon", "Pss", "VmRSS"))
    return anonymous, held, resident


def _kib(path: Path) -> Mapping[str, int]:
    lines = (line.split() for line in path.read_text().splitlines())
    return {words[0].rstrip(":"): int(words[1]) for words in lines if len(words) == 3 and words[2] == "kB"}
