"""Quality over time of several optimisers: the paper's SGD, Adam, and L-BFGS on fixed samples.

    python benchmarks/optimisers.py [examples/pi.toml] [--seconds 60] [--output docs/optimisers]

All vary the same parameters, coarse to fine through the same levels with the same share of the time for each, on the
same loss; SGD and Adam see fresh rays at every step, L-BFGS (strong Wolfe line search) a fixed sample that is renewed
at every restart. All are evaluated alike: NMSE of 2^20 rays that no search has seen; that time is not
counted. Learning rates are the best of a series for each method. Writes a table (Markdown) and a plot.
"""

import lensforge  # noqa: F401  before torch, whose idle threads then sleep

# isort: split
import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch

from lensforge.accuracy import PRESETS
from lensforge.errors import InputError
from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.merit import Evaluated, MeritFunction
from lensforge.optimisation.parameters import Parametrisation
from lensforge.sources.build import build_source
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec, load_spec

SHARES = (0.05, 0.1, 0.2, 0.65)  # of the time, for the levels from coarse to fine
UNSEEN_RAYS, UNSEEN_SEED, ROUND = 2**20, 2**41, 10
THRESHOLDS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.015, 0.012, 0.01)


@dataclass
class SearchInProgress:
    """A search in progress: parameters, and a clock that is stopped during evaluations."""

    merit: MeritFunction
    constraints: AugmentedLagrangian
    source: Source
    rays: int
    weights: torch.Tensor
    offsets: torch.Tensor
    draws: int = 0
    spent: float = 0.0

    def fresh_rays(self) -> RayBundle:
        self.draws += 1
        return self.source.sample(self.rays, self.draws)

    def loss(self, weights: torch.Tensor, offsets: torch.Tensor, rays: RayBundle) -> Evaluated:
        return self.merit.evaluate(weights, offsets, rays, self.constraints, False)


Method = Callable[[SearchInProgress, list[torch.Tensor], float, float], Iterator[None]]


def gradient_descent(make: Callable[[list[torch.Tensor]], torch.optim.Optimizer]) -> Method:
    """A method whose rate falls by a cosine to a twentieth over each level."""

    def level(run: SearchInProgress, active: list[torch.Tensor], seconds: float, fine: float) -> Iterator[None]:
        optimiser = make(active)
        top = [group["lr"] * 0.2**fine for group in optimiser.param_groups]
        begun, step = run.spent, 0
        while run.spent < begun + seconds:
            progress = (run.spent - begun) / seconds
            for group, rate in zip(optimiser.param_groups, top, strict=True):
                group["lr"] = rate * (0.05 + 0.95 * 0.5 * (1.0 + np.cos(np.pi * progress)))
            start = time.perf_counter()
            result = run.loss(*active, run.fresh_rays())
            optimiser.zero_grad()
            result.loss.backward()
            optimiser.step()
            step += 1
            if step % ROUND == 0:
                run.constraints.update(result.fields)
            run.spent += time.perf_counter() - start
            yield

    return level


def quasi_newton(iterations: int) -> Method:
    """L-BFGS restarted every ``iterations``, on a new sample each; a run that leaves the surfaces' domain is undone."""

    def restart(run: SearchInProgress, active: list[torch.Tensor]) -> None:
        rays = run.fresh_rays()
        optimiser = torch.optim.LBFGS(active, max_iter=iterations, history_size=20, line_search_fn="strong_wolfe")

        def closure() -> torch.Tensor:
            optimiser.zero_grad()
            loss = run.loss(*active, rays).loss
            loss.backward()
            return loss

        optimiser.step(closure)
        with torch.no_grad():
            run.constraints.update(run.loss(*active, rays).fields)

    def level(run: SearchInProgress, active: list[torch.Tensor], seconds: float, fine: float) -> Iterator[None]:
        begun = run.spent
        while run.spent < begun + seconds:
            start, before = time.perf_counter(), [parameter.detach().clone() for parameter in active]
            try:
                restart(run, active)
            except InputError as error:
                print(f"   undone: {error}"[:110])
                with torch.no_grad():
                    for parameter, old in zip(active, before, strict=True):
                        parameter.copy_(old)
            run.spent += time.perf_counter() - start
            yield

    return level


METHODS: dict[str, Method] = {
    **{f"SGD, rate {rate:g}": gradient_descent(lambda p, r=rate: torch.optim.SGD(p, lr=r)) for rate in (0.003, 0.03)},
    **{
        f"SGD with momentum 0.9, rate {rate:g}": gradient_descent(
            lambda p, r=rate: torch.optim.SGD(p, lr=r, momentum=0.9)
        )
        for rate in (0.001, 0.01)
    },
    **{
        f"Adam, rate {rate:g}": gradient_descent(lambda p, r=rate: torch.optim.Adam(p, lr=r, betas=(0.9, 0.99)))
        for rate in (0.003, 0.01, 0.03)
    },
    **{f"L-BFGS, restart after {count}": quasi_newton(count) for count in (10, 30)},
}


def search(spec: Spec, method: Method, seconds: float, rays: int) -> list[tuple[float, float]]:
    """(seconds spent, NMSE of unseen rays) along a run."""
    source = build_source(spec.source)
    parametrisation = Parametrisation.of(spec, PRESETS["standard"].nodes_per_sigma)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    count = parametrisation.basis.size
    weights = torch.zeros(count, 2, dtype=torch.float64)
    run = SearchInProgress(
        MeritFunction.of(spec, source, parametrisation), constraints, source, rays, weights, torch.ones(2).double()
    )
    unseen = source.sample(UNSEEN_RAYS, UNSEEN_SEED)
    curve, functions, next_look = [], 0, 0.0
    for number, (level, share) in enumerate(zip(spec.lens.levels, SHARES[-len(spec.lens.levels) :], strict=True)):
        functions += level
        active = [run.weights[:functions].clone().requires_grad_(), run.offsets.clone().requires_grad_()]
        for _ in method(run, active, share * seconds, number / max(1, len(spec.lens.levels) - 1)):
            if run.spent >= next_look:
                with torch.no_grad():
                    curve.append((run.spent, run.loss(*active, unseen).nmse))
                next_look = run.spent + 0.02 * seconds
        run.weights[:functions], run.offsets = active[0].detach(), active[1].detach()
    with torch.no_grad():
        curve.append((run.spent, run.loss(run.weights, run.offsets, unseen).nmse))
    return curve


def first_below(curve: list[tuple[float, float]], threshold: float) -> str:
    return next((f"{seconds:.1f}" for seconds, value in curve if value <= threshold), "–")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("spec", nargs="?", type=Path, default=Path(__file__).parents[1] / "examples" / "pi.toml")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rays", type=int, default=2**16)
    parser.add_argument("--output", type=Path, default=Path("docs/optimisers"))
    options = parser.parse_args()
    spec = load_spec(options.spec)
    curves = {}
    for name, method in METHODS.items():
        curves[name] = search(spec, method, options.seconds, options.rays)
        print(f"{name:40s} NMSE {curves[name][-1][1]:.4f} after {curves[name][-1][0]:.0f} s", flush=True)
    write_table(curves, options)
    draw(curves, options)


def write_table(curves: dict[str, list[tuple[float, float]]], options: argparse.Namespace) -> None:
    head = "| method | " + " | ".join(f"{t:g}" for t in THRESHOLDS) + f" | after {options.seconds:g} s |"
    lines = [head, "|" + " --- |" * (len(THRESHOLDS) + 2)]
    for name, curve in curves.items():
        cells = " | ".join(first_below(curve, threshold) for threshold in THRESHOLDS)
        lines.append(f"| {name} | {cells} | {curve[-1][1]:.4f} |")
    title = f"Seconds to an NMSE of …, `{options.spec.name}`, {options.rays} rays per step:"
    text = "\n".join([title, "", *lines, ""])
    options.output.with_suffix(".table.md").write_text(text, encoding="utf-8")
    print(text)


def draw(curves: dict[str, list[tuple[float, float]]], options: argparse.Namespace) -> None:
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for name, curve in curves.items():
        axes.plot(*np.array(curve).T, label=name, linestyle="-" if name.startswith("Adam") else "--")
    axes.set(xscale="linear", yscale="log", xlabel="time of the search (s)", ylabel="NMSE, rays unseen")
    axes.legend(fontsize="small")
    figure.savefig(options.output.with_suffix(".png"), dpi=130)


if __name__ == "__main__":
    main()
