"""A search that goes on from a finished lens against one from hemispheres, after one thing has changed.

    python benchmarks/warm_start.py examples/cross.toml [--accuracy standard] [--rays 1048576]

Designs the spec, then for each change: cold, from hemispheres; warm, from the finished lens; and warm again in half of
the seconds that the cold search took. All are judged with the same rays. Prints the rows of docs/results.md.
"""

import argparse
from pathlib import Path

import lensforge as lf

CHANGES = {
    "another LED: 1.3 times as wide": lambda spec: {"source": {"side_mm": 1.3 * spec.source.side_mm}},
    "the target 10 % farther away": lambda spec: {"target": {"distance_mm": 1.1 * spec.target.distance_mm}},
    "PC instead of PMMA": lambda spec: {"lens": {"material": "PC at 564 nm", "refractive_index": 1.588}},
}
COLUMNS = ("change", "search", "seconds", "NMSE", "efficiency")


def row(change: str, kind: str, design: lf.Design, options: argparse.Namespace) -> None:
    """Judge a lens, and print it."""
    light = lf.evaluate(design.lens, rays=options.rays).first
    cells = (change, kind, f"{design.seconds:.0f}", str(light.nmse), str(light.efficiency))
    print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("spec", type=Path)
    parser.add_argument("--accuracy", default="standard")
    parser.add_argument("--rays", type=int, default=2**20)
    options = parser.parse_args()
    spec = lf.load_spec(options.spec)
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    first = lf.design(spec, accuracy=options.accuracy)
    row("none", "cold", first, options)
    for name, change in CHANGES.items():
        changed = spec.replace(**change(spec))
        cold = lf.design(changed, accuracy=options.accuracy)
        row(name, "cold", cold, options)
        row(name, "warm", lf.design(changed, accuracy=options.accuracy, start=first.lens), options)
        halved = changed.replace(optimise={"seconds": 0.5 * cold.seconds})
        row(name, "warm, half the time", lf.design(halved, accuracy=options.accuracy, start=first.lens), options)


if __name__ == "__main__":
    main()
