"""What a preset leaves on the very scene: light through its tables against light through the exact surfaces.

The same rays go both ways, so that no noise enters; they come in independent scrambles, so that it is known how well
the few of them tell. The noise of the rays that judge a lens is no part of it: that is ``nmse_of_noise``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.exact import ExactHits, trace_exact_sum
from lensforge.evaluation.metrics import jackknife, relative_square
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.receivers.bins import flux_in_square
from lensforge.receivers.plane import Receiver
from lensforge.receivers.splat import splat_flux
from lensforge.sources.bundle import RayBundle, Source

_SCRAMBLES, _RAYS = 8, 2**8  # few: the exact surface is asked for each of them, and no run may wait for it
_SEED_BASE = 2**45  # apart from the seeds of the design and of every judgement


def measure_preset(lens: Lens, source: Source, tables: Mapping[str, TracedLens]) -> dict[str, Any]:
    """Errors of the ``tables`` of each stage against the exact surfaces; the last of them brackets the crossings.

    By stage: ``hit_mm`` (root mean square over rays that arrive on the receiver both ways) and ``hit_max_mm``;
    ``irradiance_nmse``, of the four-pixel splat on the design's pixels; ``efficiency``. With so few rays in a pixel the
    errors of neighbours do not average out: the irradiance error is an upper bound.
    """
    finest = list(tables.values())[-1]
    count = min(_RAYS, (source.population or _SCRAMBLES * _RAYS) // _SCRAMBLES or 1)
    seeds = (_SEED_BASE + lens.seed * _SCRAMBLES + k for k in range(_SCRAMBLES))
    rays = RayBundle.joined([source.sample(count, seed) for seed in seeds])  # in one go: many small arrays take longer
    by_name = {"inner": finest.inner.numpy(), "outer": finest.outer.numpy()}
    exact = trace_exact_sum(lens, finest.scene.grid, by_name, rays)
    view = _View.of(lens)
    return {
        "rays": len(rays),
        "scrambles": _SCRAMBLES,
        **{stage: _stage(traced, rays, exact, view, source.flux_w) for stage, traced in tables.items()},
    }


@dataclass(frozen=True)
class _View:
    """Where the light is looked at."""

    receiver: Receiver
    window_mm: float

    @staticmethod
    def of(lens: Lens) -> "_View":
        spec = lens.spec
        receiver = Receiver(spec.target.receiver_mm, spec.optimise.pixels)
        return _View(receiver, spec.evaluate.window_mm or receiver.side_mm)

    def picture(self, light: ExactHits) -> Float[np.ndarray, "p p"]:
        return splat_flux(light.hits, light.flux, self.receiver)

    def detected(self, light: ExactHits) -> float:
        return flux_in_square(light.hits, light.flux, self.window_mm)


def _stage(traced: TracedLens, rays: RayBundle, exact: ExactHits, view: _View, emitted_w: float) -> dict[str, Any]:
    arrivals = traced.trace(rays)
    everywhere = ExactHits(arrivals.hits.numpy(), arrivals.flux.numpy())
    squares, pictures, lost, largest = [], [], [], 0.0
    for rows in np.split(np.arange(len(rays)), _SCRAMBLES):
        seen, truth = everywhere.take(rows), exact.take(rows)
        on = (np.abs(truth.hits) <= 0.5 * view.receiver.side_mm).all(axis=1)
        both = seen.arrived & truth.arrived & on
        away = np.linalg.norm(seen.hits[both] - truth.hits[both], axis=1)
        largest = max(largest, float(away.max(initial=0.0)))
        squares.append([float(away @ away), float(both.sum())])
        pictures.append([view.picture(seen), view.picture(truth)])
        lost.append([(view.detected(seen) - view.detected(truth)) / emitted_w])
    found: dict[str, Any] = {"table_error_nm": max(traced.table_error_nm.values()), "hit_max_mm": largest}
    for name, replicates, statistic in (
        ("hit_mm", squares, lambda mean: float(np.sqrt(mean[0] / mean[1])) if mean[1] else 0.0),
        ("irradiance_nmse", pictures, relative_square),
        ("efficiency", lost, lambda mean: float(mean[0])),
    ):
        found[name], found[f"{name}_standard_error"] = jackknife(np.array(replicates), statistic)
    return found
