"""Expected light of a second cut: design, first cut and second cut simulated with the same rays."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from lensforge.evaluation.evaluate import receiver_light
from lensforge.evaluation.light import LightMetrics
from lensforge.evaluation.noise_free import Images, nmse_without_noise
from lensforge.evaluation.receiver_light import ReceiverLight
from lensforge.evaluation.simulate import Simulation, TracedLens, simulate
from lensforge.jackknife import jackknife_error
from lensforge.lens import Lens
from lensforge.measurement.comparison import Side
from lensforge.receivers.build import receivers_of
from lensforge.receivers.pixels import gaussian3
from lensforge.receivers.possible import PossibleLight, SourceLight
from lensforge.records import Metric
from lensforge.sources.bundle import Source
from lensforge.surfaces.spline import grid_for, tabulate
from lensforge.surfaces.surface import Surface
from lensforge.targets.pattern import target_light
from lensforge.tracing.tables import Scene

# A change is a thousandth of the radius: five nodes for its shortest wave keep its slopes to some hundredths.
_WIDER = 2.0


@dataclass(frozen=True)
class CutLight:
    """Light of one cut on the first receiver, and its images in each replicate, filtered as for the metrics."""

    received: ReceiverLight
    images: Images
    window: Float[np.ndarray, " r"]

    @property
    def metrics(self) -> LightMetrics:
        """Metrics of the light."""
        one = self.received
        return LightMetrics(nmse=one.nmse, uniformity=one.uniformity, rsd=one.rsd, efficiency=one.efficiency)


@dataclass(frozen=True)
class SecondCut:
    """Simulation of a lens with changed radii on one ``side``, always with the same rays."""

    lens: Lens
    side: Side
    source: Source
    nodes_per_sigma: float
    rays: int

    def lights(self, *changes: Surface | None) -> list[CutLight]:
        """Light of the lens with each of ``changes`` (mm) added to the radius; None: the design."""
        details = [_WIDER * change.detail_rad for change in changes if change is not None]
        grid = grid_for(min(self.lens.detail_rad, *details), self.nodes_per_sigma)
        tables = {name: tabulate(grid, getattr(self.lens, name)) for name in ("inner", "outer")}
        scene, found = Scene(self.lens.refractive_index, grid), []
        for change in changes:
            own = dict(tables)
            if change is not None:
                own[self.side] = own[self.side] + tabulate(grid, change)  # tables are linear in the radius
            inner, outer = (torch.from_numpy(own[name]) for name in ("inner", "outer"))
            found.append(self._light(TracedLens(scene, inner, outer, {})))
        return found

    def _light(self, traced: TracedLens) -> CutLight:
        spec = self.lens.spec
        receiver, section = receivers_of(spec, spec.evaluate.pixels)[0], spec.all_receivers[0]
        simulation: Simulation = simulate(traced, self.source, (receiver,), self.rays, self.lens.seed)
        own, variance = simulation.received[0], spec.evaluate.filter_variance
        images = np.stack([gaussian3(image, variance) for image in own.images])
        light = SourceLight.of(self.source, self.lens.refractive_index)
        physics = PossibleLight(light, receiver, spec.constraints.max_radius_mm)
        return CutLight(
            receiver_light(section, physics, own, images, simulation.emitted_w),
            images,
            own.window / simulation.emitted_w,
        )


def change_of_nmse(lens: Lens, after: CutLight, before: CutLight) -> Metric:
    """NMSE ``after`` less that ``before``, and the standard error of the difference: the noise of common rays cancels.

    By the jackknife over pairs of replicates: the rays of one are the same in both.
    """
    spec = lens.spec
    target = target_light(spec.all_receivers[0].targets, receivers_of(spec, spec.evaluate.pixels)[0])
    return _paired(after.images, before.images, lambda images: nmse_without_noise(images, target).value)


def change_of_efficiency(after: CutLight, before: CutLight) -> Metric:
    """Efficiency ``after`` less that ``before``, and the standard error of the difference by common rays."""
    return _paired(after.window, before.window, lambda shares: float(shares.mean()))


def _paired(
    after: Float[np.ndarray, "r *shape"], before: Float[np.ndarray, "r *shape"], figure: Callable[[np.ndarray], float]
) -> Metric:
    value, count = figure(after) - figure(before), len(after)
    if count < 2:
        return Metric(value=value)
    left = [figure(np.delete(after, k, axis=0)) - figure(np.delete(before, k, axis=0)) for k in range(count)]
    return Metric(value=value, standard_error=jackknife_error(np.array(left)))
