"""Metrics of one lens from its replicates, and their change from one lens to another that the same rays lit."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.evaluation.light import LightMetrics
from lensforge.evaluation.minimum import LeastEstimate, uniformity_estimate
from lensforge.evaluation.noise_free import Images, PairEstimate, RootEstimate, nmse_estimate, rsd_estimate
from lensforge.evaluation.simulate import TracedLens, simulate
from lensforge.jackknife import jackknife_metric
from lensforge.receivers.build import receivers_of
from lensforge.receivers.pixels import gaussian3
from lensforge.records import Image, Metric
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.targets.pattern import target_light
from lensforge.targets.region import uniform_region


@dataclass(frozen=True)
class ReplicateMetrics:
    """Metrics on one receiver before they are records; None where the spec names no mask.

    ``efficiency``: share of the emitted flux in the window, of each replicate.
    """

    nmse: PairEstimate
    uniformity: LeastEstimate | None
    rsd: RootEstimate | None
    efficiency: Float[np.ndarray, " r"]

    @staticmethod
    def of(
        images: Images,
        target: Image,
        mask: Bool[np.ndarray, "h w"] | None,
        efficiency: Float[np.ndarray, " r"],
    ) -> "ReplicateMetrics":
        """Metrics of filtered ``images`` against ``target``, uniformity and RSD in ``mask``."""
        return ReplicateMetrics(
            nmse=nmse_estimate(images, target),
            uniformity=None if mask is None else uniformity_estimate(images, mask),
            rsd=None if mask is None else rsd_estimate(images, mask),
            efficiency=efficiency,
        )

    def metrics(self) -> LightMetrics:
        """Values with their standard errors."""
        return LightMetrics(
            nmse=self.nmse.metric(),
            uniformity=None if self.uniformity is None else self.uniformity.metric(),
            rsd=None if self.rsd is None else self.rsd.metric(),
            efficiency=mean_share(self.efficiency),
        )

    def change_from(self, before: "ReplicateMetrics", rays: int, *, designed_rsd: float | None = None) -> LightMetrics:
        """Differences from ``before``, replicate by replicate: what both have of the noise cancels in their errors.

        ``designed_rsd``: RSD of ``before`` by many rays, to which the change is to be added.

        Of few rays a small change moves none to another pixel, and all replicates agree on none. Errors are at least
        those of one ray: the noise of all ``rays`` over their root.
        """
        least, even, noise = before.uniformity, before.rsd, before.metrics()
        deviation = None
        if self.rsd is not None and even is not None:
            deviation = self.rsd.change_from(even) if designed_rsd is None else self.rsd.change_of(designed_rsd, even)
        return LightMetrics(
            nmse=_with_one_ray(self.nmse.change_from(before.nmse), noise.nmse, rays),
            uniformity=None if self.uniformity is None or least is None else self.uniformity.change_from(least),
            rsd=None if deviation is None else _with_one_ray(deviation, noise.rsd, rays),
            efficiency=_with_one_ray(mean_share(self.efficiency - before.efficiency), noise.efficiency, rays),
        )


@dataclass(frozen=True)
class TracedLight:
    """Light of one lens on its first receiver: metrics by replicates, and its mean map (flux per measure, [y, x])."""

    replicates: ReplicateMetrics
    map: Image

    @property
    def metrics(self) -> LightMetrics:
        """Values with their standard errors."""
        return self.replicates.metrics()


def traced_light(traced: TracedLens, spec: Spec, source: Source, rays: int, seed: int) -> TracedLight:
    """Light on the first receiver of ``spec``, by the rays that its evaluation takes with the same ``seed``."""
    receiver = receivers_of(spec, spec.evaluate.pixels)[0]
    simulation = simulate(traced, source, (receiver,), rays, seed)
    received, targets = simulation.received[0], spec.all_receivers[0].targets
    images = gaussian3(received.images, spec.evaluate.filter_variance)
    target, mask = target_light(targets, receiver), lit_mask(uniform_region(targets, receiver), images)
    replicates = ReplicateMetrics.of(images, target, mask, received.window / simulation.emitted_w)
    return TracedLight(replicates, images.mean(axis=0) / receiver.pixel_measure)


def lit_mask(mask: Bool[np.ndarray, "h w"] | None, images: Images) -> Bool[np.ndarray, "h w"] | None:
    """``mask``; None where there is none, no pixel lies in it, or no light falls anywhere."""
    return mask if mask is not None and mask.any() and images.sum() > 0.0 else None


def _with_one_ray(change: Metric, noisy: Metric | None, rays: int) -> Metric:
    """``change`` with an error that includes that of one of the ``rays`` by which ``noisy`` has its own."""
    if change.standard_error is None or noisy is None or noisy.standard_error is None:
        return change
    error = float(np.hypot(change.standard_error, noisy.standard_error / np.sqrt(rays)))
    return change.model_copy(update={"standard_error": error})


def mean_share(shares: Float[np.ndarray, " r"]) -> Metric:
    """Mean of the ``shares`` of each replicate."""
    return jackknife_metric(shares, float)
