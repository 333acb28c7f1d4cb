"""Rays of a scene, traced in independent runs and kept, so that several ladders can look at the same light."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.simulate import TracedLens
from lensforge.receivers.hits import Hits
from lensforge.receivers.receiver import Receiver
from lensforge.sources.bundle import Source
from lensforge.studies.tradeoff.ladder import Meter

_SEED_BASE = 2**43  # apart from the seeds of the design, of its evaluation and of its verification


@dataclass(frozen=True)
class Run:
    """Hits (mm) and flux (W) on the receiver of one run; ``sampling_s``: the part spent on drawing the rays."""

    hits: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]
    seconds: float
    sampling_s: float
    peak_mb: float

    def __len__(self) -> int:
        return len(self.flux)


def trace_run(traced: TracedLens, receiver: Receiver, source: Source, rays: int, number: int) -> Run:
    """Run ``number`` of ``rays`` rays; other numbers are independent scrambles of the same sequence."""
    with Meter() as all_of_it:
        with Meter() as sampling:
            bundle = source.sample(rays, _SEED_BASE + number)
        landed = Hits.of(receiver.land(traced.trace(bundle)))
    return Run(landed.hits, landed.flux, all_of_it.seconds, sampling.seconds, all_of_it.peak_mb)


def resample(run: Run, rays: int, generator: np.random.Generator) -> Run:
    """Plain Monte Carlo: ``rays`` rays drawn at random, independently and with replacement, from those of ``run``.

    Its expectation is ``run`` itself and its variance that of independent rays, whatever the source. Nothing is
    traced again: a run of as many rays takes the share of the time that ``run`` took to trace.
    """
    rows = generator.integers(0, len(run), rays)
    share = rays / len(run)
    tracing = (run.seconds - run.sampling_s) * share
    return Run(run.hits[rows], run.flux[rows] / share, tracing, 0.0, run.peak_mb * share)
