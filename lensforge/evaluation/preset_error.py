"""Error of an accuracy preset on this scene: light through its tables against light through the exact surfaces.

The same rays pass through both, so that no noise enters; they come in independent scrambles, which give the standard
error. The noise of the rays that evaluate a lens is not included: that is in the standard errors of its metrics.
"""

import numpy as np

from lensforge import seeds
from lensforge.evaluation.light import PresetError, TableError
from lensforge.evaluation.metrics import relative_square
from lensforge.evaluation.simulate import TracedLens
from lensforge.jackknife import jackknife_metric
from lensforge.lens import Lens
from lensforge.receivers.build import receivers_of
from lensforge.receivers.pixels import flux_in, splat_flux
from lensforge.receivers.receiver import Hits, Receiver
from lensforge.sources.bundle import RayBundle, Source
from lensforge.tracing.exact import TableScan, exact_surfaces, trace_exact

_SCRAMBLES, _RAYS = 8, 2**8  # few: each is traced through the exact surfaces, which is slow


def measure_preset(lens: Lens, source: Source, design: TracedLens, evaluation: TracedLens) -> PresetError:
    """Errors of the tables of both stages against the exact surfaces; the evaluation's tables bracket the crossings.

    The light is that on the first receiver, by the four-pixel splat on the design's pixels. With so few rays in a pixel
    the errors of neighbouring rays do not average out: its error is an upper bound.
    """
    count = min(_RAYS, (source.ray_count or _SCRAMBLES * _RAYS) // _SCRAMBLES or 1)
    own_seeds = (seeds.of_preset_error(lens.seed, _SCRAMBLES, k) for k in range(_SCRAMBLES))
    # in one go: many small arrays take longer
    rays = RayBundle.joined([source.sample(count, seed) for seed in own_seeds])
    receiver = receivers_of(lens.spec, lens.spec.optimise.pixels)[0]
    inner, outer = (TableScan(evaluation.scene.grid, table.numpy()) for table in (evaluation.inner, evaluation.outer))
    surfaces = exact_surfaces(lens, (inner, outer))
    exits = evaluation.seen(rays, lambda own: trace_exact(*surfaces, lens.media, own))
    exact = Hits.of(receiver.land_in_torch(exits))
    return PresetError(
        rays=len(rays),
        scrambles=_SCRAMBLES,
        design=_stage(design, rays, exact, receiver, source.flux_w),
        evaluation=_stage(evaluation, rays, exact, receiver, source.flux_w),
    )


def _stage(traced: TracedLens, rays: RayBundle, exact: Hits, receiver: Receiver, emitted_w: float) -> TableError:
    landed = Hits.of(receiver.land(traced.trace(rays)))
    squares, pictures, lost, largest = [], [], [], 0.0
    for rows in np.split(np.arange(len(rays)), _SCRAMBLES):
        tabulated, reference = landed.take(rows), exact.take(rows)
        on = (np.abs(reference.hits) <= 0.5 * np.array(receiver.grid.size)).all(axis=1)
        both = tabulated.arrived & reference.arrived & on
        away = np.linalg.norm(tabulated.hits[both] - reference.hits[both], axis=1)
        largest = max(largest, float(away.max(initial=0.0)))
        squares.append([float(away @ away), float(both.sum())])
        pictures.append([splat_flux(light.hits, light.flux, receiver.grid) for light in (tabulated, reference)])
        detected = [flux_in(light.hits, light.flux, receiver.window) for light in (tabulated, reference)]
        lost.append((detected[0] - detected[1]) / emitted_w)
    return TableError(
        table_error_nm=max(traced.table_error_nm.values()),
        hit_max_mm=largest,
        hit_mm=jackknife_metric(
            np.array(squares), lambda mean: float(np.sqrt(mean[0] / mean[1])) if mean[1] else 0.0, "mm"
        ),
        irradiance_nmse=jackknife_metric(np.array(pictures), relative_square),
        efficiency=jackknife_metric(np.array(lost), float),
    )
