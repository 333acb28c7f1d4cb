"""Independent runs of a scene's rays, shared by several studies, and their pictures as in an evaluation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from convergence.study import Meter
from lensforge.light.simulation import TracedLens
from lensforge.scene.pixel_grid import bin_flux, flux_in, gaussian3
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec

_SEED = 8 * 2**40  # a range that lensforge.seeds leaves free


@dataclass(frozen=True)
class TracedRun:
    """Hits and flux (W) on the first receiver of one run; ``sampling_s``: seconds of sampling the rays."""

    hits: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]
    seconds: float
    sampling_s: float
    peak_mb: float

    def __len__(self) -> int:
        return len(self.flux)


class RunPicture(NamedTuple):
    """Efficiency and filtered image (W) of a run."""

    efficiency: float
    image: Float[np.ndarray, "h w"]


class Cost(NamedTuple):
    """Cost of a run that was not kept: seconds, and peak memory (MB)."""

    seconds: float
    peak_mb: float


def trace_run(traced: TracedLens, receiver: PosedReceiver, source: Source, rays: int, number: int) -> TracedRun:
    """Trace run ``number`` of ``rays`` rays; other numbers are independent scrambles of the same sequence."""
    with Meter() as whole:
        with Meter() as sampling:
            bundle = source.sample(rays, _SEED + number)
        landed = receiver.land(traced.trace(bundle))
    return TracedRun(landed.hits, landed.flux, whole.seconds, sampling.seconds, whole.peak_mb)


def resample(run: TracedRun, rays: int, generator: np.random.Generator) -> TracedRun:
    """Plain Monte Carlo: ``rays`` rays drawn at random, independently and with replacement, from those of ``run``.

    Its expectation is ``run`` itself and its variance that of independent rays, whatever the source. Nothing is
    traced again: the time is that of ``run``'s tracing, in proportion to the number of rays.
    """
    rows = generator.integers(0, len(run), rays)
    share = rays / len(run)
    tracing = (run.seconds - run.sampling_s) * share
    return TracedRun(run.hits[rows], run.flux[rows] / share, tracing, 0.0, run.peak_mb * share)


def picture_of(spec: Spec, flux_w: float, run: TracedRun) -> RunPicture:
    """The picture of ``run`` by the pixels, filter and window of the evaluation, of a source of ``flux_w``."""
    receiver = receivers_of(spec, spec.evaluate.pixels)[0]
    image = gaussian3(bin_flux(run.hits, run.flux, receiver.grid), spec.evaluate.filter_variance)
    return RunPicture(flux_in(run.hits, run.flux, receiver.window) / flux_w, image)


def long_run(
    trace: Callable[[int], TracedRun], picture: Callable[[TracedRun], RunPicture], numbers: Sequence[int]
) -> tuple[RunPicture, Cost]:
    """Picture and cost of the runs ``numbers`` as one run; no rays are kept."""
    efficiency, image, seconds, peak_mb, parts = 0.0, np.zeros(1), 0.0, 0.0, len(numbers)
    for number in numbers:
        run = trace(number)
        seen = picture(run)
        efficiency, image = efficiency + seen.efficiency / parts, image + seen.image / parts
        seconds, peak_mb = seconds + run.seconds, max(peak_mb, run.peak_mb)
    return RunPicture(efficiency, image), Cost(seconds, peak_mb)
