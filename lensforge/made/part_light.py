"""Light of one part, by rays that all parts of a study share, and its change from that of the lens as designed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse

from lensforge.light.judged_limits import colours_left_out, means_left_out, values_left_out
from lensforge.light.receiver_light import ReceiverLight
from lensforge.light.replicate_rays import ReplicateRays
from lensforge.light.simulation import ReplicateMetrics, TracedLens, lit_mask
from lensforge.light.table_trace import trace_tables
from lensforge.results import Metric
from lensforge.results.estimates import Images, jackknife_error, jackknife_metric
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.light_ends import cause_numbers, loss_names, with_beside
from lensforge.scene.limit_readings import LightLimit, zones_on
from lensforge.scene.limit_views import LimitView, limit_views
from lensforge.scene.made_part import MadePart
from lensforge.scene.pixel_grid import bin_replicates, gaussian3
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.region import Region
from lensforge.scene.target_pattern import DrawnTarget, drawn_target, uniform_region
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec
from lensforge.spec.light_limits import ColourSection


class _SeenByLimit(NamedTuple):
    """The light that limits read: the picture of a receiver, or the losses there."""

    receiver: int
    of_losses: bool

    @staticmethod
    def by(limit: LightLimit) -> "_SeenByLimit":
        """The light that ``limit`` reads."""
        return _SeenByLimit(limit.receiver, limit.quantity.of_losses)


Channels = Float[np.ndarray, "k r h w"]  # flux (W) on each pixel by every replicate; X, Y and Z (lm) where they count


def judged_colour(spec: Spec) -> ColourSection | None:
    """The colour section if ``spec`` limits the beam's colour, which alone makes a study trace it; else None."""
    return spec.colour if spec.colour is not None and spec.colour.has_limits else None


def in_channels(
    flux: Float[np.ndarray, " n"], rays: RayBundle, colour: ColourSection | None
) -> list[Float[np.ndarray, " n"]]:
    """``flux`` (W) of ``rays``, or its X, Y and Z (lm) if their colour counts."""
    return [flux] if colour is None else [flux, *(flux * per_watt for per_watt in rays.colours.T)]


@dataclass(frozen=True, eq=False)
class ReceivedImages:
    """Filtered pictures of every replicate on one receiver; shares of the emitted flux in window, target and zones.

    ``in_zones``: those of the limits on shares of the flux. ``emitted_w``: of this part's source. ``losses``: flux (W)
    by cause of its loss, if a limit needs it.
    """

    pictures: Channels
    window: Float[np.ndarray, " r"]
    in_target: Float[np.ndarray, " r"]
    in_zones: Sequence[Float[np.ndarray, " r"]]
    emitted_w: float
    losses: Float[np.ndarray, "r l"] | None = None

    def light(self, seen: _SeenByLimit) -> Float[np.ndarray, "r *_"]:
        """The images, or the losses, that a limit reads."""
        if not seen.of_losses:
            return self.images
        assert self.losses is not None
        return self.losses

    @property
    def images(self) -> Images:
        """Flux (W) on each pixel."""
        return np.asarray(self.pictures[0])


def rays_behind(nominal: TracedLens, part: MadePart | None, rays: RayBundle) -> ExitRays:
    """``rays`` behind one part of a lens; None: behind the lens as designed."""
    if part is None:
        return trace_tables(nominal.tables, nominal.scene, rays)
    scene = replace(nominal.scene, media=part.media(nominal.scene.media), made=part.made)
    return trace_tables(part.tables(nominal.tables), scene, rays)


def flux_by_cause(lens: TracedLens, exits: ExitRays, held: ReplicateRays, flux: float) -> Float[np.ndarray, "r k"]:
    """Flux (W) of the ``held`` rays by cause of loss, in every replicate; ``flux``: of the LED."""
    causes = len(loss_names(lens.scene.chain))
    numbers = cause_numbers(exits, lens.scene.chain)
    places = held.replicate * causes + numbers
    ends = numbers >= 0
    return flux * np.bincount(places[ends], exits.flux[ends], held.replicates * causes).reshape(-1, causes)


def blocked_flux(landings: Landings, exits: ExitRays, held: ReplicateRays, flux: float) -> Float[np.ndarray, " r"]:
    """Flux (W) of the ``held`` rays that bodies of the scene take, in every replicate; ``flux``: of the LED."""
    if landings.shadow is None:
        return np.zeros(held.replicates)
    (blocked,) = held.flux_in((landings.shadow.lost > 0.0,), flux * exits.flux * landings.shadow.lost)
    return np.asarray(blocked)


@dataclass(frozen=True, eq=False)
class PartLight:
    """Simulation of parts of one lens: ``receivers`` of ``spec``, their ``limits``, and the rays of all parts."""

    spec: Spec
    nominal: TracedLens
    receivers: tuple[PosedReceiver, ...]
    limits: tuple[LightLimit, ...]
    held: ReplicateRays

    def exit_rays(self, part: MadePart | None) -> ExitRays:
        """Rays behind one part; None: behind the lens as designed."""
        return rays_behind(self.nominal, part, self.held.rays)

    def received(self, parts: Sequence[MadePart] | None) -> tuple[ReceivedImages, ...]:
        """Light of a part on each receiver, by each of its lenses, here one; None: of the lens as designed.

        Behind them stands what each eye sees.
        """
        part = None if parts is None else parts[0]
        exits = self.exit_rays(part)
        flux = 1.0 if part is None else part.flux
        held = self.held
        by_cause = flux_by_cause(self.nominal, exits, held, flux) if self.counts_losses else None
        colour = judged_colour(self.spec)
        images = []
        for receiver, target, zones in zip(self.receivers, self.targets[0], self.zones, strict=True):
            landings = receiver.land(exits)
            hits = landings.hits
            carried = landings.flux * flux
            inside = (receiver.window.contains(hits), *(region.contains(hits) for region in (target, *zones)))
            emitted_w = flux * held.emitted_w
            window, lit, *in_zones = held.flux_in(inside, carried) / emitted_w
            raw = [
                bin_replicates(hits, channel_rays, receiver.grid, held.replicate, held.replicates)
                for channel_rays in in_channels(carried, held.rays, colour)
            ]
            smooth = gaussian3(np.stack(raw), self.spec.evaluate.filter_variance)
            losses = None
            if by_cause is not None:
                losses = with_beside(by_cause, window * emitted_w, blocked_flux(landings, exits, held, flux))
            images.append(ReceivedImages(smooth, window, lit, in_zones, emitted_w, losses))
        return (*images, *self.seen(exits, held, flux))

    @cached_property
    def views(self) -> tuple[LimitView, ...]:
        """Views of limits, of eyes as coarse as those of a search: a part has too few rays for a fine spot."""
        return limit_views(self.spec, coarse=True) if any(limit.quantity.of_view for limit in self.limits) else ()

    def seen(self, exits: ExitRays, held: ReplicateRays, flux: float) -> Iterator[ReceivedImages]:
        """Pictures of every view by the ``exits`` of the ``held`` rays; ``flux``: of the LED over theirs."""
        none = np.zeros(held.replicates)
        for view in self.views:
            landings = view.land(exits)
            image = bin_replicates(landings.hits, flux * landings.flux, view.grid, held.replicate, held.replicates)
            if (again := landings.again) is not None:
                numbers = held.replicate[again.rows]
                image += bin_replicates(again.hits, flux * again.flux, view.grid, numbers, held.replicates)
            yield ReceivedImages(image[None] / view.averaged_over_mm2(exits), none, none, (), flux * held.emitted_w)

    @property
    def counts_losses(self) -> bool:
        """True if a limit depends on where useless light ends."""
        return any(limit.quantity.of_losses for limit in self.limits)

    def measured(self, received: tuple[ReceivedImages, ...]) -> "MeasuredPart":
        """Metrics of one part from its replicates."""
        metrics = []
        shares = []
        for light, target, mask in zip(received, *self.targets, strict=False):
            images = light.images
            metrics.append(ReplicateMetrics.of(images, target.light, lit_mask(mask, images), light.window))
            shares.append(light.in_target)
        return MeasuredPart(tuple(metrics), tuple(shares), tuple(self._limits(received)))

    def _limits(self, received: tuple[ReceivedImages, ...]) -> Iterator[Float[np.ndarray, " v"]]:
        """The deciding value of each limit by all replicates, then with each left out in turn."""
        read = {}
        for seen, matrix in self._readings.items():  # all limits at once: to read pixels takes longer than to judge
            light = received[seen.receiver].light(seen)
            limits = [limit for limit in self.limits if limit.region is None and _SeenByLimit.by(limit) == seen]
            ends = np.cumsum([limit.readings.shape[0] for limit in limits])[:-1]
            read[seen] = iter(np.split(matrix @ light.reshape(len(light), -1).T, ends))
        in_zones = [iter(light.in_zones) for light in received]
        for limit in self.limits:
            if limit.region is not None:
                yield means_left_out(next(in_zones[limit.receiver]))
                continue
            seen = _SeenByLimit.by(limit)
            light_there = received[seen.receiver]
            value = values_left_out(limit, next(read[seen]), light_there.light(seen))
            yield value * (self.held.emitted_w / light_there.emitted_w) if limit.quantity.is_share else value
        for on_receiver in received[: len(self.receivers)]:
            yield from colours_left_out(judged_colour(self.spec), on_receiver.pictures[1:])

    @cached_property
    def _readings(self) -> dict[_SeenByLimit, sparse.csr_array]:
        rows = dict[_SeenByLimit, list[sparse.csr_array]]()
        for limit in self.limits:
            if limit.region is None:  # else it is counted by ray
                rows.setdefault(_SeenByLimit.by(limit), []).append(limit.readings)
        return {seen: sparse.csr_array(sparse.vstack(row)) for seen, row in rows.items()}

    @cached_property
    def zones(self) -> list[tuple[Region, ...]]:
        """Zones of the limits on shares of the flux, by receiver."""
        return [zones_on(number, self.limits) for number in range(len(self.receivers))]

    @cached_property
    def targets(self) -> tuple[list[DrawnTarget], list[Bool[np.ndarray, "_ _"] | None]]:
        """Target of each receiver, and its region of uniform light, if any."""
        pairs = list(zip((section.targets for section in self.spec.all_receivers), self.receivers, strict=True))
        targets = [drawn_target(section, receiver) for section, receiver in pairs]
        return targets, [uniform_region(section, receiver) for section, receiver in pairs]


@dataclass(frozen=True, eq=False)
class MeasuredPart:
    """Metrics of one part on each receiver, by replicates; shares of flux in the targets; values of its limits."""

    metrics: tuple[ReplicateMetrics, ...]
    shares: tuple[Float[np.ndarray, " r"], ...]
    limits: tuple[Float[np.ndarray, " k"], ...]

    def change_from(self, before: "MeasuredPart", designed: Sequence[ReceiverLight]) -> list[dict[str, Metric]]:
        """Differences from ``before``, the lens as designed by the same rays: of each receiver, then of the limits.

        ``designed``: the light of that lens by many rays, to which they are to be added.
        """
        changes_by_light = []
        parts = zip(self.metrics, before.metrics, self.shares, before.shares, strict=True)
        for light, (metrics, metrics_before, share, share_before) in zip(designed, parts, strict=True):
            rsd = None if light.rsd is None else light.rsd.value
            uniformity = None if light.uniformity is None else light.uniformity.value
            changes = metrics.change_from(metrics_before, designed_rsd=rsd, designed_uniformity=uniformity)
            change = {name: value for name, value in changes if value is not None}
            changes_by_light.append({**change, "share_in_target": jackknife_metric(share - share_before, float)})
        return [*changes_by_light, {str(number): change for number, change in enumerate(self.limit_changes(before))}]

    @property
    def noise(self) -> list[Float[np.ndarray, " r"]]:
        """Noise of every value by replicate, in the order of their changes, up to a factor."""
        receivers = zip(self.metrics, self.shares, strict=True)
        on_receivers = [row for metrics, share in receivers for row in (*metrics.noise, share)]
        return [*on_receivers, *(limit[1:] for limit in self.limits)]

    def limit_changes(self, before: "MeasuredPart") -> Iterator[Metric]:
        """Difference of each limit's deciding value from ``before``, by the same rays."""
        for limit, limit_before in zip(self.limits, before.limits, strict=True):
            difference = limit - limit_before
            error = jackknife_error(difference[1:]) if len(difference) > 1 else None
            yield Metric(value=float(difference[0]), standard_error=error)
