"""Seconds and light of searches alone, from one checkout beside another, taken in turns.

    git worktree add /tmp/before v0.1.0
    python benchmarks/searches.py /tmp/before . --spec pi --spec signal [--seed 0] [--accuracy standard]

Each checkout searches for the lens of its own shipped spec of that name, with the environment of this Python; nothing
else should run. Seconds are those of ``lf.design``, with the libraries that it loads. A search at draft accuracy comes
first, which compiles the kernels that it needs, and is not counted.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from result_tables import table

COLUMNS = ("spec", "s before", "s now", "ratio", "steps", "NMSE", "efficiency")


def searched(checkout: Path, spec: str, accuracy: str, seed: int) -> dict[str, Any]:
    """Seconds and steps of a search in a process of its own, and the first receiver's light."""
    command = [sys.executable, __file__, "--one", spec, "--accuracy", accuracy, "--seed", str(seed)]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    found = subprocess.run(command, cwd=checkout, env=environment, stdout=subprocess.PIPE, check=True)
    result: dict[str, Any] = json.loads(found.stdout.splitlines()[-1])
    return result


def search_here(spec: str, accuracy: Any, seed: int) -> dict[str, Any]:
    """Search with the package that Python finds first."""
    import lensforge as lf

    examples = Path(lf.__file__).parents[1] / "examples"
    given = lf.load_spec(examples / f"{spec}.toml")
    begun = time.perf_counter()
    design = lf.design(given, accuracy=accuracy, seed=seed)
    seconds = time.perf_counter() - begun
    light = lf.evaluate(design.lens)
    figures = {name: getattr(light, name) for name in ("nmse", "efficiency")}
    return {"seconds": seconds, "steps": design.steps} | {
        name: None if found is None else [found.value, found.standard_error] for name, found in figures.items()
    }


def row(spec: str, before: dict[str, Any], now: dict[str, Any]) -> tuple[str, ...]:
    """Both searches of a spec beside each other."""

    def both(name: str) -> str:
        values = (found[name] for found in (before, now))
        return " → ".join("–" if each is None else f"{each[0]:.5f} ± {each[1]:.0e}" for each in values)

    seconds = before["seconds"], now["seconds"]
    steps = f"{before['steps']} → {now['steps']}"
    return (
        spec,
        *(f"{each:.1f}" for each in seconds),
        f"{seconds[1] / seconds[0]:.2f}",
        steps,
        *map(both, ("nmse", "efficiency")),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs="*")
    parser.add_argument("--spec", action="append", default=[])
    parser.add_argument("--accuracy", default="standard")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(search_here(options.one, options.accuracy, options.seed)))
        return
    before, now = (path.resolve() for path in options.checkouts)
    rows = []
    for spec in options.spec:
        for checkout in (before, now):
            searched(checkout, spec, "draft", options.seed)
        found = [searched(checkout, spec, options.accuracy, options.seed) for checkout in (before, now)]
        rows.append(row(spec, *found))
        print(*rows[-1], sep=" | ", flush=True)
    print(table(rows, COLUMNS))


if __name__ == "__main__":
    main()
