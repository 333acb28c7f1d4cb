"""Bias and coverage of the metrics: do they state the light, and as well as their standard errors say?

    lensforge design examples/flat_top.toml
    python benchmarks/ray_noise.py cad_out/flat_top --rays 1048576 --seeds 100
    python benchmarks/ray_noise.py --pictures

A lens is evaluated under many seeds. The light itself is known from all their rays together: replicates with the same
number are averaged over the seeds, which gives 16 replicates of many more rays, and these are evaluated in turn.
``--pictures``: the uniformity of known pictures with noise added, also by other estimates of it.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lensforge.light.metrics import (
    _Choices,
    _halves,
    jackknife_metric,
    least_over_mean,
    nmse,
    nmse_estimate,
    relative_deviation,
    rsd_estimate,
    uniformity,
)
from lensforge.light.simulation import REPLICATES, TracedLens, simulate
from lensforge.results import Metric
from lensforge.scene.lens import load_lens
from lensforge.scene.pixel_grid import gaussian3
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light, uniform_region
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS

COLUMNS = ("metric", "light", "with ray noise", "stated error", "bias", "scatter", "within 1", "within 2")
PICTURES = ("picture", "noise", "with noise", "halves read apart", "slope 1/2", "the estimate", "within 1", "within 2")
SIDE = 90  # pixels of a known picture


@dataclass(frozen=True)
class Replicates:
    """Filtered pictures, and shares of the emitted flux in the window and in the target, of each replicate."""

    images: np.ndarray
    shares: dict[str, np.ndarray]

    @staticmethod
    def mean(of: list["Replicates"]) -> "Replicates":
        """Replicates with the same number, averaged."""
        shares = {name: np.mean([one.shares[name] for one in of], axis=0) for name in of[0].shares}
        return Replicates(np.mean([one.images for one in of], axis=0), shares)


@dataclass(frozen=True)
class Scene:
    """The target on the pixels of the first receiver, and the mask of the uniformity."""

    target: np.ndarray
    mask: np.ndarray | None

    def metrics(self, found: Replicates) -> dict[str, Metric]:
        """The metrics as ``evaluate`` states them."""
        metrics = {"NMSE": nmse_estimate(found.images, self.target).metric()}
        if self.mask is not None:
            metrics["RSD"] = rsd_estimate(found.images, self.mask).metric()
            metrics["uniformity"] = least_over_mean(found.images[:, self.mask]).metric()
        for name, share in found.shares.items():
            metrics[name] = jackknife_metric(share[:, None], lambda mean: float(mean[0]))
        return metrics

    def raw(self, found: Replicates) -> dict[str, float]:
        """The same, with ray noise."""
        mean = found.images.mean(axis=0)
        metrics = {"NMSE": nmse(mean, self.target)}
        if self.mask is not None:
            metrics["RSD"] = relative_deviation(mean, self.mask)
            metrics["uniformity"] = uniformity(mean, self.mask)
        return metrics | {name: float(share.mean()) for name, share in found.shares.items()}


def evaluations(directory: Path, rays: int, seeds: range) -> tuple[Scene, Iterator[Replicates]]:
    """The scene of a lens, and its replicates under each seed."""
    lens = load_lens(directory / "lens.json")
    spec, source = lens.spec, build_source(lens.spec.source, lens.spec.lens.dispersion)
    traced = TracedLens.of(lens, PRESETS[lens.accuracy].evaluate_nodes_per_sigma)
    targets, receiver = spec.all_receivers[0].targets, receivers_of(spec, spec.evaluate.pixels)[0]
    target = target_light(targets, receiver)
    bright = in_target(target)

    def under(seed: int) -> Replicates:
        simulation = simulate(traced, source, (receiver,), rays, seed)
        (found,), emitted = simulation.received, simulation.emitted_w
        images = np.stack([gaussian3(image, spec.evaluate.filter_variance) for image in found.images])
        inside = found.images[:, bright].sum(axis=1)
        shares = {"efficiency": found.window / emitted, "share in the target": inside / emitted}
        return Replicates(images.astype(np.float32), shares)

    return Scene(target, uniform_region(targets, receiver)), map(under, seeds)


def table(scene: Scene, found: list[Replicates]) -> Iterator[str]:
    """Rows of the table: bias and scatter in stated standard errors, and shares of the seeds within them."""
    light = scene.metrics(Replicates.mean(found))
    metrics, raw = [scene.metrics(one) for one in found], [scene.raw(one) for one in found]
    yield row(COLUMNS)
    yield "|" + "---|" * len(COLUMNS)
    for name, truth in light.items():
        values = np.array([one[name].value for one in metrics])
        errors = np.array([one[name].standard_error for one in metrics])
        away, stated = values - truth.value, errors.mean()
        yield row(
            (
                name,
                f"{truth.value:.6f} ± {truth.standard_error:.1g}",
                f"{np.mean([one[name] for one in raw]):.6f}",
                f"{stated:.2g}",
                f"{away.mean() / stated:+.2f}",
                f"{away.std(ddof=1) / stated:.2f}",
                *(f"{np.mean(np.abs(away) <= times * errors):.2f}" for times in (1, 2)),
            )
        )


def row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cells) + " |"


def known_pictures() -> dict[str, np.ndarray]:
    """Pictures whose darkest pixel is known: alike everywhere, bumps, one spot, one pixel, a dark edge."""
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE / 2.0
    waves = np.random.default_rng(0)
    bumps = sum(
        np.cos(0.06 * (1 + k % 5) * (x * np.cos(a) + y * np.sin(a)) + p)
        for k, (a, p) in enumerate(2.0 * np.pi * waves.random((40, 2)))
    )
    bumps *= 0.007 / bumps.std()
    return {
        "even": np.ones_like(x),
        "bumps of 0.7 %": 1.0 + bumps,
        "a spot of 5 %": 1.0 - 0.05 * np.exp(-(x**2 + y**2) / 160.0),
        "bumps, and 8 % in one corner": 1.0 + bumps - 0.08 * np.exp(-((x + 44.5) ** 2 + (y + 44.5) ** 2) / 8.0),
        "a slope of 20 %": 1.0 + 0.2 * x / SIDE,
    }


def picture_row(name: str, truth: np.ndarray, noise: float, repeats: int) -> str:
    """Bias ± scatter of several estimates in units of one pixel's noise, and the coverage of the stated one."""
    rng, point, mask = np.random.default_rng(1), np.zeros((5, 5)), np.ones(truth.shape, dtype=bool)
    point[2, 2] = 1.0
    scale = noise * np.sqrt(REPLICATES) / np.linalg.norm(gaussian3(point, 1.0))
    found, errors = [], []
    for _ in range(repeats):
        white = rng.normal(size=(REPLICATES, *truth.shape))
        images = truth + scale * np.stack([gaussian3(image, 1.0) for image in white])
        metric = least_over_mean(images[:, mask]).metric()
        relative = images[:, mask] / images.mean()
        halves = _Choices.of(relative, _halves())
        found.append((uniformity(images.mean(axis=0), mask), halves.read, halves.extrapolated(0.5), metric.value))
        errors.append(metric.standard_error)
    away = np.array(found) - uniformity(truth, mask)
    units = [
        f"{bias:+.2f} ± {spread:.2f}" for bias, spread in zip(away.mean(0) / noise, away.std(0) / noise, strict=True)
    ]
    within = [f"{np.mean(np.abs(away[:, 3]) <= times * np.array(errors)):.2f}" for times in (1, 2)]
    return row((name, f"{noise:g}", *units, *within))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path, nargs="?", help="result folder with lens.json")
    parser.add_argument("--rays", type=int, default=2**20)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--pictures", action="store_true", help="known pictures instead of a lens")
    parser.add_argument("--repeats", type=int, default=100, help="of each picture")
    given = parser.parse_args()
    if given.pictures:
        print(row(PICTURES), "|" + "---|" * len(PICTURES), sep="\n")
        for name, truth in known_pictures().items():
            for noise in (0.001, 0.005, 0.02):
                print(picture_row(name, truth, noise, given.repeats), flush=True)
        return
    if given.directory is None:
        parser.error("name a result folder, or --pictures")
    scene, found = evaluations(given.directory, given.rays, range(given.seeds))
    print("\n".join(table(scene, list(found))))


if __name__ == "__main__":
    main()
