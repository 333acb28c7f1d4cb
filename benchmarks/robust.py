"""A robust search against a nominal one at equal seeds: the light of drawn parts, and the time of both searches.

    python benchmarks/robust.py examples/pi.toml examples/flat_top.toml [--accuracy standard] [--parts 256] [--seeds 2]

Both lenses are measured by the same parts, which neither search has seen, and by the same rays. A ray file's spec may
be given as well. Prints a Markdown table, for NMSE and, where the spec names a mask, RSD: as designed, the mean and the
95th percentile of the parts, and the yield: the share of the parts that are no worse than 95 % of the nominal ones.
"""

import argparse
from pathlib import Path

import numpy as np

import lensforge as lf
from lensforge.made.yield_study import measure_yield

COLUMNS = ("spec", "seed", "search", "s", "steps", "efficiency", "of", "designed", "mean", "95 %", "yield")
_PASSING = 95.0


def measured(spec: lf.Spec, seed: int, robust: bool, options: argparse.Namespace) -> tuple[lf.Design, lf.Yield]:
    """Design one lens, and measure its parts."""
    searched = spec.replace(optimise={"robust": True}) if robust else spec
    design = lf.design(searched, accuracy=options.accuracy, seed=seed)
    return design, measure_yield(design.lens, parts=options.parts, rays=options.rays, with_budget=False)


def print_rows(spec: lf.Spec, seed: int, options: argparse.Namespace) -> None:
    """Both searches of one scene: a row for each metric."""
    found = {name: measured(spec, seed, robust, options) for name, robust in (("nominal", False), ("robust", True))}
    for metric in ("nmse", "rsd"):
        if metric not in found["nominal"][1].metrics:
            continue
        bound = np.percentile(found["nominal"][1].without_noise(metric), _PASSING)
        for name, (design, result) in found.items():
            spread = result.metrics[metric]
            passing = float((result.without_noise(metric) <= bound).mean())
            cells = [spec.name, str(seed), name, f"{design.seconds:.0f}", str(design.steps)]
            cells += [f"{result.metrics['efficiency'].mean.value:.4f}", metric.upper(), f"{spread.designed.value:.5f}"]
            print(
                "| " + " | ".join([*cells, str(spread.mean), f"{spread.p95:.5f}", f"{passing:.3f}"]) + " |", flush=True
            )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("specs", type=Path, nargs="+")
    parser.add_argument("--accuracy", default="standard")
    parser.add_argument("--parts", type=int, default=256)
    parser.add_argument("--rays", type=int, default=2**16)
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    for path in options.specs:
        spec = lf.load_spec(path)
        for seed in range(options.seeds):
            print_rows(spec, seed, options)


if __name__ == "__main__":
    main()
