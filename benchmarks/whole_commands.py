"""Seconds and memory of `lensforge design` from one checkout beside another, taken in turns.

    git worktree add /tmp/before v0.1.0
    python benchmarks/whole_commands.py /tmp/before . --spec flat_top --spec pi [--accuracy draft] [--rounds 3]

Each checkout designs its own shipped spec of that name, with the environment of this Python; nothing else should run.
A first design of each checkout, at draft accuracy, compiles the kernels and is not counted. Memory is the largest sum
over the processes of a command, of what they hold alone and their part of what they share. Linux only.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from statistics import median

from watched import watched

STAGES = ("design", "evaluate", "photometry", "export", "check", "verify")


def timed(checkout: Path, spec: str, accuracy: str) -> dict[str, float]:
    """Seconds of a command and of its stages, and its peak memory (MiB)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lensforge", "design", f"examples/{spec}.toml", "--accuracy", accuracy]
        peak = watched([*command, "--quiet", "--out", folder], checkout, PYTHONPATH=str(checkout))
        found = {name: json.loads((Path(folder) / f"{name}.json").read_text())["seconds"] for name in STAGES}
    return {"whole": peak.seconds, **found, "MiB": peak.held}


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
