"""What a preset leaves on the very scene: light through its tables against light through the exact surfaces.

The same rays go both ways, so that no noise enters; they come in independent scrambles, so that it is known how well
the few of them tell. The noise of the rays that judge a lens is no part of it: that is ``nmse_of_noise``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.exact import trace_exact_sum
from lensforge.evaluation.light import PresetError, TableError
from lensforge.evaluation.metrics import jackknife, relative_square
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.receivers.bins import flux_in_square
from lensforge.receivers.hits import Hits
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.splat import splat_flux
from lensforge.records import Metric
from lensforge.sources.bundle import RayBundle, Source

_SCRAMBLES, _RAYS = 8, 2**8  # few: the exact surface is asked for each of them, and no run may wait for it
_SEED_BASE = 2**45  # apart from the seeds of the design and of every judgement


def measure_preset(lens: Lens, source: Source, design: TracedLens, evaluation: TracedLens) -> PresetError:
    """Errors of the tables of both stages against the exact surfaces; those of the evaluation bracket the crossings.

    The irradiance is that of the four-pixel splat on the design's pixels. With so few rays in a pixel the errors of
    neighbours do not average out: its error is an upper bound.
    """
    count = min(_RAYS, (source.population or _SCRAMBLES * _RAYS) // _SCRAMBLES or 1)
    seeds = (_SEED_BASE + lens.seed * _SCRAMBLES + k for k in range(_SCRAMBLES))
    rays = RayBundle.joined([source.sample(count, seed) for seed in seeds])  # in one go: many small arrays take longer
    by_name = {"inner": evaluation.inner.numpy(), "outer": evaluation.outer.numpy()}
    view = _View.of(lens)
    exact = Hits.of(view.receiver.land_in_torch(trace_exact_sum(lens, evaluation.scene.grid, by_name, rays)))
    return PresetError(
        rays=len(rays),
        scrambles=_SCRAMBLES,
        design=_stage(design, rays, exact, view, source.flux_w),
        evaluation=_stage(evaluation, rays, exact, view, source.flux_w),
    )


@dataclass(frozen=True)
class _View:
    """Where the light is looked at."""

    receiver: PlaneReceiver
    window_mm: float

    @staticmethod
    def of(lens: Lens) -> "_View":
        spec = lens.spec
        receiver = PlaneReceiver.of(spec.target, spec.optimise.pixels)
        return _View(receiver, spec.evaluate.window_mm or receiver.grid.side_mm)

    def picture(self, light: Hits) -> Float[np.ndarray, "p p"]:
        return splat_flux(light.hits, light.flux, self.receiver.grid)

    def detected(self, light: Hits) -> float:
        return flux_in_square(light.hits, light.flux, self.window_mm)


def _stage(traced: TracedLens, rays: RayBundle, exact: Hits, view: _View, emitted_w: float) -> TableError:
    everywhere = Hits.of(view.receiver.land(traced.trace(rays)))
    squares, pictures, lost, largest = [], [], [], 0.0
    for rows in np.split(np.arange(len(rays)), _SCRAMBLES):
        seen, truth = everywhere.take(rows), exact.take(rows)
        on = (np.abs(truth.hits) <= 0.5 * view.receiver.grid.side_mm).all(axis=1)
        both = seen.arrived & truth.arrived & on
        away = np.linalg.norm(seen.hits[both] - truth.hits[both], axis=1)
        largest = max(largest, float(away.max(initial=0.0)))
        squares.append([float(away @ away), float(both.sum())])
        pictures.append([view.picture(seen), view.picture(truth)])
        lost.append([(view.detected(seen) - view.detected(truth)) / emitted_w])
    return TableError(
        table_error_nm=max(traced.table_error_nm.values()),
        hit_max_mm=largest,
        hit_mm=_metric(squares, lambda mean: float(np.sqrt(mean[0] / mean[1])) if mean[1] else 0.0, "mm"),
        irradiance_nmse=_metric(pictures, relative_square),
        efficiency=_metric(lost, lambda mean: float(mean[0])),
    )


def _metric(replicates: Sequence[object], statistic: Callable[[np.ndarray], float], unit: str = "") -> Metric:
    value, error = jackknife(np.array(replicates), statistic)
    return Metric(value=value, unit=unit, standard_error=error)
