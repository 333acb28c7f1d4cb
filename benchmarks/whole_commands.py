"""Seconds and memory of `lensforge design` from one checkout beside another, taken in turns.

    git worktree add /tmp/before v0.1.0
    python benchmarks/whole_commands.py /tmp/before . --spec flat_top --spec pi [--accuracy draft] [--rounds 3]

Each checkout designs its own shipped spec of that name, with the environment of this Python; nothing else should run.
A first design of each checkout, at draft accuracy, compiles the kernels and is not counted. Memory is the largest sum
over the processes of a command, of what they hold alone and their part of what they share. Linux only.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

PAUSE_S = 0.5  # between two looks at the memory, which take 20 ms: more often they would take a quarter of a core
STAGES = ("design", "evaluate", "photometry", "export", "check", "verify")


def timed(checkout: Path, spec: str, accuracy: str) -> dict[str, float]:
    """Seconds of a command and of its stages, and its peak memory (MiB)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lensforge", "design", f"examples/{spec}.toml", "--accuracy", accuracy]
        seconds, held = seconds_and_memory([*command, "--quiet", "--out", folder], checkout)
        found = {name: json.loads((Path(folder) / f"{name}.json").read_text())["seconds"] for name in STAGES}
    return {"whole": seconds, **found, "MiB": held}


def seconds_and_memory(command: Sequence[str], checkout: Path) -> tuple[float, float]:
    """Seconds of a command, which may miss a criterion (exit code 1), and its peak memory (MiB)."""
    started = time.perf_counter()
    peak = 0.0
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    process = subprocess.Popen(command, cwd=checkout, env=environment, stderr=subprocess.DEVNULL)
    while process.poll() is None:
        peak = max(peak, sum(_held_mib(pid) for pid in _family(process.pid)))
        time.sleep(PAUSE_S)
    if process.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return time.perf_counter() - started, peak


def _family(pid: int) -> list[int]:
    """The process ``pid`` and all that it started."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
        children = [child for task in tasks for child in (task / "children").read_text().split()]
    except OSError:  # it has just ended
        return []
    return [pid, *(other for child in children for other in _family(int(child)))]


def _held_mib(pid: int) -> float:
    """Memory (MiB) of a process, with its part of what it shares; 0 where it has just ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("Pss:"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkouts", type=Path, nargs=2)
    parser.add_argument("--spec", action="append", required=True)
    parser.add_argument("--accuracy", default="standard")
    parser.add_argument("--rounds", type=int, default=1)
    options = parser.parse_args()
    checkouts = [path.resolve() for path in options.checkouts]
    for checkout in checkouts:
        timed(checkout, options.spec[0], "draft")
    print("| spec, accuracy | checkout | whole |", " | ".join(STAGES), "| MiB |")
    for spec in options.spec:
        rounds = [[timed(checkout, spec, options.accuracy) for checkout in checkouts] for _ in range(options.rounds)]
        both = [{key: median(each[k][key] for each in rounds) for key in rounds[0][k]} for k in (0, 1)]
        for checkout, one in zip(checkouts, both, strict=True):
            cells = [f"{one[name]:.1f}" for name in ("whole", *STAGES)]
            print(f"| {spec}, {options.accuracy} | {checkout.name} | {' | '.join(cells)} | {one['MiB']:.0f} |")
        print(f"{spec}: {both[1]['whole'] / both[0]['whole']:.2f} of the time", flush=True)


if __name__ == "__main__":
    main()
