"""Light of many parts by the same rays: held in memory, traced through each part, its metrics against the nominal ones.

Parts share their rays with the lens as designed, so that most of the ray noise cancels in the change from it. A metric
of a part is that of the lens as designed, by many rays, plus this change.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.deviations.made_part import MadePart
from lensforge.evaluation.limits import limit_value
from lensforge.evaluation.noise_free import Images
from lensforge.evaluation.receiver_light import ReceiverLight
from lensforge.evaluation.replicate_metrics import ReplicateMetrics, lit_mask, mean_share
from lensforge.evaluation.simulate import REPLICATES, TracedLens, bundles
from lensforge.jackknife import jackknife_error
from lensforge.receivers.pixels import bin_replicates, gaussian3
from lensforge.receivers.posed import PosedReceiver
from lensforge.records import Metric
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.targets.limits import LightLimit
from lensforge.targets.pattern import DrawnTarget, drawn_target
from lensforge.targets.region import uniform_region
from lensforge.tracing.exit_rays import ExitRays
from lensforge.tracing.tables import trace_tables

_COLUMNS = 32  # into which rays are sorted


@dataclass(frozen=True, eq=False)
class HeldLight:
    """Rays of all replicates in one bundle, and the number of the replicate of each."""

    rays: RayBundle
    replicate: Int[np.ndarray, " n"]
    replicates: int
    emitted_w: float

    @staticmethod
    def of(source: Source, rays: int, seed: int) -> "HeldLight":
        """The rays by which an evaluation of so many ``rays`` with ``seed`` simulates."""
        count = min(REPLICATES, rays, source.ray_count or rays)
        parts, numbers = [], []
        for replicate, share, bundle in bundles(source, rays, count, seed):
            parts.append(replace(bundle, flux=bundle.flux * share))
            numbers.append(np.full(len(bundle), replicate))
        joined, replicate_of = RayBundle.joined(parts), np.concatenate(numbers)
        # neighbours use the same part of a table: in order of direction a trace takes a sixth less time
        order = np.lexsort((joined.directions[:, 1], np.floor(_COLUMNS * joined.directions[:, 0])))
        return HeldLight(joined.take(order), replicate_of[order], count, source.flux_w)

    def __len__(self) -> int:
        return len(self.replicate)


@dataclass(frozen=True, eq=False)
class ReceivedImages:
    """Filtered image of flux (W) of every replicate on one receiver; shares of the emitted flux in window and target.

    ``emitted_w``: of this part's source.
    """

    images: Images
    window: Float[np.ndarray, " r"]
    in_target: Float[np.ndarray, " r"]
    emitted_w: float


@dataclass(frozen=True, eq=False)
class PartLight:
    """Simulation of parts of one lens: ``receivers`` of ``spec``, their ``limits``, and the rays of all parts."""

    spec: Spec
    nominal: TracedLens
    receivers: tuple[PosedReceiver, ...]
    limits: tuple[LightLimit, ...]
    held: HeldLight

    def exit_rays(self, part: MadePart | None) -> ExitRays:
        """Rays behind one part; None: behind the lens as designed."""
        nominal, rays = self.nominal, self.held.rays
        if part is None:
            return trace_tables(nominal.inner, nominal.outer, nominal.scene, rays)
        scene = replace(nominal.scene, media=part.media(nominal.scene.media), made=part.made)
        return trace_tables(*part.tables(nominal.inner, nominal.outer), scene, part.rays(rays))

    def received(self, part: MadePart | None) -> tuple[ReceivedImages, ...]:
        """Light of one part on each receiver; None: of the lens as designed."""
        exits, flux = self.exit_rays(part), 1.0 if part is None else part.flux
        found = []
        for receiver, target in zip(self.receivers, self._targets[0], strict=True):
            landings = receiver.land(exits)
            hits, carried = landings.hits.numpy(), landings.flux.numpy() * flux
            held, inside = self.held, (receiver.window.contains(hits), target.contains(hits))
            window, lit = (np.bincount(held.replicate[own], carried[own], minlength=held.replicates) for own in inside)
            images = bin_replicates(hits, carried, receiver.grid, held.replicate, held.replicates)
            emitted_w = flux * held.emitted_w
            smooth = gaussian3(images, self.spec.evaluate.filter_variance)
            found.append(ReceivedImages(smooth, window / emitted_w, lit / emitted_w, emitted_w))
        return tuple(found)

    def measured(self, received: tuple[ReceivedImages, ...]) -> "MeasuredPart":
        """Metrics of one part by its replicates."""
        metrics, shares = [], []
        for found, target, mask in zip(received, *self._targets, strict=True):
            images = found.images
            metrics.append(ReplicateMetrics.of(images, target.light, lit_mask(mask, images), found.window))
            shares.append(found.in_target)
        return MeasuredPart(tuple(metrics), tuple(shares), tuple(self._limit(limit, received) for limit in self.limits))

    @cached_property
    def _targets(self) -> tuple[list[DrawnTarget], list[Bool[np.ndarray, "_ _"] | None]]:
        """Target of each receiver, and its region of uniform light, if any."""
        pairs = list(zip((section.targets for section in self.spec.all_receivers), self.receivers, strict=True))
        targets = [drawn_target(own, receiver) for own, receiver in pairs]
        return targets, [uniform_region(own, each) for own, each in pairs]

    def _limit(self, limit: LightLimit, received: tuple[ReceivedImages, ...]) -> Float[np.ndarray, " k"]:
        """The value that decides on ``limit``, of all replicates and then with one after the other left out."""
        images = received[limit.receiver].images
        kept = [images, *(np.delete(images, k, axis=0) for k in range(len(images)) if len(images) > 1)]
        return np.array([limit_value(limit, each).value for each in kept])


@dataclass(frozen=True, eq=False)
class MeasuredPart:
    """Metrics of one part on each receiver, by replicates; shares of flux in the targets; values of its limits."""

    metrics: tuple[ReplicateMetrics, ...]
    shares: tuple[Float[np.ndarray, " r"], ...]
    limits: tuple[Float[np.ndarray, " k"], ...]

    def change_from(
        self, before: "MeasuredPart", rays: int, designed: Sequence[ReceiverLight]
    ) -> list[dict[str, Metric]]:
        """Differences from ``before``, the lens as designed by the same rays: of each receiver, then of the limits.

        ``designed``: the light of that lens by many rays, to which they are to be added.
        """
        found = []
        parts = zip(self.metrics, before.metrics, self.shares, before.shares, strict=True)
        for light, (own, other, share, other_share) in zip(designed, parts, strict=True):
            rsd = None if light.rsd is None else light.rsd.value
            changes = own.change_from(other, rays, designed_rsd=rsd)
            change = {name: value for name, value in changes if value is not None}
            if light.uniformity is not None and "uniformity" in change:
                change["uniformity"] = _within_one(light.uniformity.value, change["uniformity"])
            found.append({**change, "share_in_target": mean_share(share - other_share)})
        limits = {}
        for number, (own_limit, other_limit) in enumerate(zip(self.limits, before.limits, strict=True)):
            difference = own_limit - other_limit
            error = jackknife_error(difference[1:]) if len(difference) > 1 else None
            limits[str(number)] = Metric(value=float(difference[0]), standard_error=error)
        return [*found, limits]


def _within_one(designed: float, change: Metric) -> Metric:
    """``change`` of a ratio that lies between 0 and 1, however the noise of few rays moves it."""
    return change.model_copy(update={"value": min(max(change.value, -designed), 1.0 - designed)})
