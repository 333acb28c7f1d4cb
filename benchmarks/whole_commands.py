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
from pathlib import Path
from statistics import median

STAGES = ("design", "evaluate", "photometry", "export", "check", "verify")
PAUSE_S = 0.2  # between two looks at the memory


def held_mib(group: int) -> float:
    """Memory (MiB) of a process and all that it has started."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended
            continue
    family = {group}
    for _ in range(4):  # generations
        family |= {child for child, parent in parents.items() if parent in family}
    total = 0
    for number in family:
        try:
            lines = Path(f"/proc/{number}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total / 1024


def timed(checkout: Path, spec: str, accuracy: str) -> dict[str, float]:
    """Seconds of a command and of its stages, and its peak memory (MiB)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lensforge", "design", f"examples/{spec}.toml", "--accuracy", accuracy]
        environment = {**os.environ, "PYTHONPATH": str(checkout)}
        began, peak = time.perf_counter(), 0.0
        process = subprocess.Popen(
            [*command, "--quiet", "--out", folder], cwd=checkout, env=environment, stderr=subprocess.DEVNULL
        )
        while process.poll() is None:
            peak = max(peak, held_mib(process.pid))
            time.sleep(PAUSE_S)
        seconds = time.perf_counter() - began
        if process.returncode not in (0, 1):  # 1: a criterion is missed, the files are there
            raise SystemExit(f"{checkout}: {' '.join(command)} ended with {process.returncode}")
        found = {name: json.loads((Path(folder) / f"{name}.json").read_text())["seconds"] for name in STAGES}
    return {"whole": seconds, **found, "MiB": peak}


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
