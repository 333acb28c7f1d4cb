"""A robust search against a nominal one at equal seeds: the light of drawn parts, and the time of both searches.

    python benchmarks/robust.py examples/pi.toml examples/flat_top.toml [--accuracy standard] [--parts 256] [--seeds 2]

Both lenses are measured by the same parts, which neither search has seen, and by the same rays. A ray file's spec may
be given as well. Prints a Markdown table: the lens as designed, the mean and the 95th percentile of its parts.
"""

import argparse
from pathlib import Path

import lensforge as lf
from lensforge.tolerancing.yield_study import measure_yield

COLUMNS = (
    "spec", "seed", "search", "s", "steps", "NMSE designed", "mean", "p95", "efficiency designed", "mean",
    "RSD designed", "mean",
)  # fmt: skip


def row(spec: lf.Spec, seed: int, robust: bool, options: argparse.Namespace) -> float:
    """Design one lens, measure its parts, print both; the mean NMSE."""
    searched = spec.replace(optimise={"robust": True}) if robust else spec
    design = lf.design(searched, accuracy=options.accuracy, seed=seed)
    metrics = measure_yield(design.lens, parts=options.parts, rays=options.rays, with_budget=False).metrics
    cells = [spec.name, str(seed), "robust" if robust else "nominal", f"{design.seconds:.0f}", str(design.steps)]
    nmse = metrics["nmse"]
    cells += [f"{nmse.designed.value:.5f}", str(nmse.mean), f"{nmse.p95:.5f}"]
    for name in ("efficiency", "rsd"):
        found = metrics.get(name)
        cells += ["", ""] if found is None else [f"{found.designed.value:.4f}", f"{found.mean.value:.4f}"]
    print("| " + " | ".join(cells) + " |", flush=True)
    return nmse.mean.value


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
            nominal, robust = (row(spec, seed, each, options) for each in (False, True))
            print(f"\n{spec.name}, seed {seed}: robust over nominal mean NMSE {robust / nominal:.3f}\n", flush=True)


if __name__ == "__main__":
    main()
