"""Quality of several optimisers after the same time, on five scenes: first order, L-BFGS, damped Gauss-Newton.

    python benchmarks/optimisers.py [pi cross ...] [--seconds 20] [--methods Adam ...] [--output docs/optimisers]

All vary the same parameters through the levels that an automatic search takes, with the same share of the time for
each, on the same loss. First-order methods see fresh rays at every step, and their rate falls by a cosine to a
twentieth over each level; L-BFGS (strong Wolfe line search) and Gauss-Newton take a sample that is renewed at every
restart. The last row is the automatic search itself, which has its own share for each level, judges itself, and pays
for its set-up. All are judged alike: NMSE of 2^20 rays that no search has seen, on the pixels of the search; that time
is not counted. Writes a table (Markdown) and, for the first scene, a plot over time.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from descents import Method, SearchInProgress, adabelief, first_order, gauss_newton, quasi_newton, sgd
from torch import optim

from lensforge.search.schedule import UsefulLevels
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, load_spec
from lensforge.spec.accuracy import PRESETS

EXAMPLES = Path(__file__).parents[1] / "examples"
SCENES = ("pi", "cross", "flat_top", "image", "text")
AUTOMATIC = "the automatic search"
SHARE_BEFORE_LAST = 0.35  # of the time, for all levels but the last, halved for each that is coarser

adam = partial(optim.Adam, betas=(0.9, 0.99))
METHODS: dict[str, Method] = {
    "SGD with momentum 0.9, rate 0.01": first_order(partial(sgd, momentum=0.9), 0.01),
    "Adam, rate 0.002": first_order(adam, 0.002),
    "Adam, rate 0.006": first_order(adam, 0.006),
    "Adam, rate 0.018": first_order(adam, 0.018),
    "Adam, momentum 0.95": first_order(partial(optim.Adam, betas=(0.95, 0.99)), 0.006),
    "Adam, half the rate for each finer level": first_order(adam, 0.006, by_level=0.5),
    "Adam, 2^14 rays a step": first_order(adam, 0.006, rays=2**14),
    "Adam, 2^17 rays a step": first_order(adam, 0.006, rays=2**17),
    "AdaBelief (rates from the gradient's noise)": first_order(adabelief, 0.006),
    "L-BFGS, 30 iterations a sample": quasi_newton(30),
    "Gauss-Newton, 10 conjugate gradients a sample": gauss_newton(10),
    "Gauss-Newton, 40 conjugate gradients a sample": gauss_newton(40),
}


def automatic(name: str) -> tuple[Spec, tuple[int, ...]]:
    """The scene with the levels that a search of standard accuracy may take."""
    spec = load_spec(EXAMPLES / f"{name}.toml").with_automatic_levels()
    levels = UsefulLevels.of(spec, build_source(spec.source), PRESETS["standard"].effort.finest).counts
    return spec, levels


def shares(levels: Sequence[int]) -> list[float]:
    """Share of the time for each level."""
    before = [0.5 ** (len(levels) - 1 - k) for k in range(len(levels) - 1)]
    return [SHARE_BEFORE_LAST * share / sum(before) for share in before] + [1.0 - SHARE_BEFORE_LAST]


def curve(name: str, method: Method, seconds: float, looks: int) -> list[tuple[float, float]]:
    """(seconds spent, NMSE of unseen rays) along a run, at its end and ``looks`` times before."""
    spec, levels = automatic(name)
    run = SearchInProgress.of(spec, levels)
    found = [(run.spent, run.unseen_nmse())]

    def look(every_s: float, steps: Iterator[None]) -> None:
        for _ in steps:
            if looks and run.spent >= found[-1][0] + every_s:
                found.append((run.spent, run.unseen_nmse()))

    for level, share in enumerate(shares(levels)):
        run.begin(levels[: level + 1])
        look(seconds / max(looks, 1), method(run, share * seconds, level))
    return [*found, (run.spent, run.unseen_nmse())]


def automatic_search(name: str, seconds: float) -> float:
    """NMSE of unseen rays of an automatic search of so many seconds, for the image alone."""
    spec, _ = automatic(name)
    lens = lf.design(spec.replace({"optimise.seconds": seconds, "target.uniform_mm": None})).lens
    run = SearchInProgress.of(spec, lens.basis.levels)
    run.begin(lens.basis.levels)
    run.parameters = list(run.problem.parametrisation.parameters_of(lens))
    return run.unseen_nmse()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--methods", nargs="*", default=list(METHODS))
    parser.add_argument("--output", type=Path, default=Path("docs/optimisers"))
    options = parser.parse_args()
    curves = {}
    for name in options.scenes:
        for method in options.methods:
            curves[name, method] = curve(name, METHODS[method], options.seconds, 12 if name == options.scenes[0] else 0)
            print(f"{name:14s} {method:46s} NMSE {curves[name, method][-1][1]:.5f}", flush=True)
        curves[name, AUTOMATIC] = [(options.seconds, automatic_search(name, options.seconds))]
        print(f"{name:14s} {AUTOMATIC:46s} NMSE {curves[name, AUTOMATIC][-1][1]:.5f}", flush=True)
    write_table(curves, options)
    draw({method: curves[options.scenes[0], method] for method in options.methods}, options)


def write_table(curves: dict[tuple[str, str], list[tuple[float, float]]], options: argparse.Namespace) -> None:
    lines = ["| method | " + " | ".join(options.scenes) + " |", "|" + " --- |" * (len(options.scenes) + 1)]
    for method in (*options.methods, AUTOMATIC):
        cells = " | ".join(f"{curves[name, method][-1][1]:.4f}" for name in options.scenes)
        lines.append(f"| {method} | {cells} |")
    text = "\n".join([f"NMSE after {options.seconds:g} s, set-up not counted but for the last row:", "", *lines, ""])
    options.output.with_suffix(".table.md").write_text(text, encoding="utf-8")
    print(text)


def draw(curves: dict[str, list[tuple[float, float]]], options: argparse.Namespace) -> None:
    figure, axes = plt.subplots(figsize=(10, 4.5), layout="constrained")
    for number, (name, points) in enumerate(curves.items()):
        colour = plt.get_cmap("tab20")(number)
        axes.plot(*np.array(points).T, label=name, color=colour, linestyle="-" if name.startswith("Adam") else "--")
    axes.set(xscale="linear", yscale="log", xlabel="time of the search (s)", ylabel="NMSE, rays unseen")
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.savefig(options.output.with_suffix(".png"), dpi=130)


if __name__ == "__main__":
    main()
