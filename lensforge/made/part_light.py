"""Light of one part, of one lens or of lamps together, by rays that all parts of a study share, and its change.

The change is from the light of the lens as designed.

The picture of a board or a plate is the sum over its lamps of that of the lens as designed, by many rays, times the
flux of each lamp, and of the change that the errors of each lamp make to its picture. For the change every lamp is
traced by its share of the rays, which are added where they land and taken off where the lens as designed would send
them. So the flux of the lamps adds no noise, rays that an error does not move add none, and a board takes as many rays
as one lamp.

Of a lattice without an end a patch of some periods is drawn, and repeated without an end: its light is measured over
all of the patch, its limits in each of its periods.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import radians

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from lensforge.errors import InputError
from lensforge.kernels.image_sums import add_to_bins
from lensforge.light.judged_limits import values_left_out
from lensforge.light.metrics import Images, jackknife_error, jackknife_metric
from lensforge.light.receiver_light import ReceiverLight
from lensforge.light.simulation import REPLICATES, ReplicateMetrics, TracedLens, bundles, lit_mask
from lensforge.light.table_trace import trace_tables
from lensforge.results import Metric
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lamp_pictures import LampPictures, patch_pictures, seen_by
from lensforge.scene.limit_readings import LightLimit
from lensforge.scene.made_part import MadePart
from lensforge.scene.perturbations import Deviations
from lensforge.scene.pixel_grid import bin_flux, bin_replicates, gaussian3
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.target_pattern import DrawnTarget, drawn_target, uniform_region
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.lamps_section import Place

_COLUMNS = 32  # into which rays are sorted
_SHARING = 7  # seed: any number


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

    def shared_out(self, lamps: int) -> "list[HeldLight]":
        """Rays for each of several lamps: at random, from every replicate as many, and its share of the flux."""
        order = np.random.default_rng(_SHARING).permutation(len(self))
        order = order[np.argsort(self.replicate[order], kind="stable")]
        first = np.searchsorted(self.replicate[order], self.replicate[order])
        lamp = np.empty(len(self), dtype=np.int64)
        lamp[order] = (np.arange(len(self)) - first) % lamps
        found, every = [], np.bincount(self.replicate, minlength=self.replicates)
        for number in range(lamps):
            rows = np.flatnonzero(lamp == number)
            rays, replicate = self.rays.take(rows), self.replicate[rows]
            share = every / lamps / np.bincount(replicate, minlength=self.replicates)
            shared = replace(rays, flux=rays.flux * share[replicate])
            found.append(HeldLight(shared, replicate, self.replicates, self.emitted_w / lamps))
        return found


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

    def exit_rays(self, part: MadePart | None, rays: RayBundle | None = None) -> ExitRays:
        """Rays, by default all that are held, behind one part; None: behind the lens as designed."""
        nominal, rays = self.nominal, self.held.rays if rays is None else rays
        if part is None:
            return trace_tables(nominal.tables, nominal.scene, rays)
        scene = replace(nominal.scene, media=part.media(nominal.scene.media), made=part.made)
        return trace_tables(part.tables(nominal.tables), scene, rays)

    def received(self, parts: Sequence[MadePart] | None) -> tuple[ReceivedImages, ...]:
        """Light of a part on each receiver, by each of its lenses, here one; None: of the lens as designed."""
        part = None if parts is None else parts[0]
        exits, flux = self.exit_rays(part), 1.0 if part is None else part.flux
        found = []
        for receiver, target in zip(self.receivers, self.targets[0], strict=True):
            landings = receiver.land(exits)
            hits, carried = landings.hits, landings.flux * flux
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
        for found, target, mask in zip(received, *self.targets, strict=True):
            images = found.images
            metrics.append(ReplicateMetrics.of(images, target.light, lit_mask(mask, images), found.window))
            shares.append(found.in_target)
        return MeasuredPart(tuple(metrics), tuple(shares), tuple(self._limits(received)))

    def _limits(self, received: tuple[ReceivedImages, ...]) -> Iterator[Float[np.ndarray, " v"]]:
        """The values that decide on each limit, by all replicates, then with one after the other left out."""
        read = {}
        for receiver, matrix in self._readings.items():  # all limits at once: to read pixels takes longer than to judge
            images, asked = received[receiver].images, [each for each in self.limits if each.receiver == receiver]
            ends = np.cumsum([each.readings.shape[0] for each in asked])[:-1]
            read[receiver] = iter(np.split(matrix @ images.reshape(len(images), -1).T, ends))
        for limit in self.limits:
            yield values_left_out(limit, next(read[limit.receiver]), received[limit.receiver].images)

    @cached_property
    def _readings(self) -> dict[int, sparse.csr_array]:
        """Readings of all limits on each receiver that has some, as one matrix."""
        numbers = dict.fromkeys(limit.receiver for limit in self.limits)
        rows = {each: [limit.readings for limit in self.limits if limit.receiver == each] for each in numbers}
        return {each: sparse.csr_array(sparse.vstack(own)) for each, own in rows.items()}

    @cached_property
    def targets(self) -> tuple[list[DrawnTarget], list[Bool[np.ndarray, "_ _"] | None]]:
        """Target of each receiver, and its region of uniform light, if any."""
        pairs = list(zip((section.targets for section in self.spec.all_receivers), self.receivers, strict=True))
        targets = [drawn_target(own, receiver) for own, receiver in pairs]
        return targets, [uniform_region(own, each) for own, each in pairs]


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
                ratio, moved = light.uniformity.value, change["uniformity"]  # within 0 and 1, however few the rays
                within = min(max(moved.value, -ratio), 1.0 - ratio)
                change["uniformity"] = moved.model_copy(update={"value": within})
            found.append({**change, "share_in_target": jackknife_metric(share - other_share, float)})
        limits = {}
        for number, (own_limit, other_limit) in enumerate(zip(self.limits, before.limits, strict=True)):
            difference = own_limit - other_limit
            error = jackknife_error(difference[1:]) if len(difference) > 1 else None
            limits[str(number)] = Metric(value=float(difference[0]), standard_error=error)
        return [*found, limits]


_PERIODS = 3  # along x and along y, of a lattice without a plate
_MOST_PIXELS = 2**20  # of a patch, of which a study keeps sixteen pictures at a time
COMMON = frozenset({"index", "shrinkage"})  # of the batch
OF_PLATE = ("lens_shift_mm", "lens_height_mm", "lens_tilt_deg")  # of one piece


def common_to_lamps(spec: Spec) -> frozenset[str]:
    """Tolerances that all lamps of a board have alike: those of the batch, and the place of the plate, if any."""
    return COMMON if spec.plate is None else COMMON.union(OF_PLATE)


def periods_of(spec: Spec) -> tuple[int, int]:
    """Columns and rows of the patch of a lattice that is drawn: those of its plate, else three of each; else (1, 1)."""
    lamps = spec.all_lamps
    if lamps.period_mm is None:
        return 1, 1
    if spec.plate is None:
        return _PERIODS, _PERIODS
    return spec.plate.columns or 1, -(-(spec.plate.rows or 1) // len(lamps))


def pictures_of(receiver: PosedReceiver, periods: tuple[int, int]) -> LampPictures:
    """The rasters of a receiver, of an endless lattice those of a patch of so many ``periods``.

    Raises :class:`InputError` for a patch of too many pixels.
    """
    if receiver.lamps.period_mm is None:
        return LampPictures.of(receiver)
    columns, rows = periods
    pixels = columns * rows * receiver.grid.columns * receiver.grid.rows
    if pixels > _MOST_PIXELS:
        raise InputError(
            f"yield: a patch of {columns} x {rows} periods would have {pixels} pixels, at most {_MOST_PIXELS}; take "
            "fewer evaluate.pixels, or a smaller plate"
        )
    return patch_pictures(receiver, columns, rows)


def designed_pictures(
    lens: TracedLens, source: Source, boards: Sequence[LampPictures], rays: int, seed: int
) -> list[list[Images]]:
    """Flux (W) of one lamp as designed on the rasters of each receiver, in replicates."""
    count = min(REPLICATES, rays, source.ray_count or rays)
    found = [[np.zeros((count, *each.grid.shape)) for each in board.receivers] for board in boards]
    for replicate, share, bundle in bundles(source, rays, count, seed):
        exits = lens.trace(bundle)
        for board, pictures in zip(boards, found, strict=True):
            for receiver, picture in zip(board.receivers, pictures, strict=True):
                landings = receiver.land(exits)
                picture[replicate] += bin_flux(landings.hits, landings.flux * share, receiver.grid)
    return found


def on_patch(limit: LightLimit, grid: tuple[int, int], periods: tuple[int, int]) -> LightLimit:
    """The ``limit`` on a period of (rows, columns) of pixels in every period of a patch.

    Pictures hold the mean flux of all lamps of the patch, of which a period has but its part.
    """
    (height, width), (columns, rows) = grid, periods
    own = sparse.coo_array(limit.readings)
    y, x = np.divmod(own.col, width)
    shape = own.shape[0], columns * rows * height * width
    times = 1.0 if limit.quantity == "share" else float(columns * rows)
    each = [
        sparse.csr_array((times * own.data, (own.row, (y + j * height) * columns * width + x + i * width)), shape=shape)
        for j in range(rows)
        for i in range(columns)
    ]
    return replace(limit, readings=sparse.csr_array(sparse.vstack(each)))


@dataclass(frozen=True, eq=False)
class BoardLight(PartLight):
    """Simulation of boards of ``spec``: the ``receivers`` are those of ``boards``, the ``limits`` those of one period.

    ``designed``: pictures by :func:`designed_pictures`, in as many replicates as the rays that are held; ``one``: the
    light of one lamp, or of one period.
    """

    boards: tuple[LampPictures, ...]
    periods: tuple[int, int]
    designed: list[list[Images]]
    one: PartLight

    @staticmethod
    def of(light: PartLight, boards: Sequence[LampPictures], designed: list[list[Images]]) -> "BoardLight":
        """Boards on the receivers, and with the limits, of the spec. Raises :class:`InputError` for too few rays."""
        periods, lamps, rays = periods_of(light.spec), len(boards[0].receiver.lamps), len(light.held)
        if rays < REPLICATES * lamps:
            least = REPLICATES * lamps
            raise InputError(f"yield: {rays} rays for {lamps} lamps: {REPLICATES} each at least; give {least}")
        receivers, limits = tuple(board.receiver for board in boards), light.limits
        if periods != (1, 1):
            limits = tuple(on_patch(each, light.receivers[each.receiver].grid.shape, periods) for each in limits)
        return BoardLight(
            light.spec, light.nominal, receivers, limits, light.held, tuple(boards), periods, designed, light
        )

    @cached_property
    def _shares(self) -> list[HeldLight]:
        return self.held.shared_out(len(self.receivers[0].lamps))

    @cached_property
    def _seen(self) -> list[list[PosedReceiver]]:
        """Each receiver as each lamp sees it."""
        return [[seen_by(receiver, number) for receiver in self.receivers] for number in range(len(self._shares))]

    @cached_property
    def _landed(self) -> list[list[Landings]]:
        """Landings of the rays of each lamp behind the lens as designed."""
        every = zip(self._shares, self._seen, strict=True)
        return [[each.land(self.exit_rays(None, own.rays)) for each in seen] for own, seen in every]

    def received(self, parts: Sequence[MadePart] | None) -> tuple[ReceivedImages, ...]:
        """Light of a board on each receiver, by the lens of each of its lamps; None: of the lens as designed."""
        fluxes = np.ones(len(self._shares)) if parts is None else np.array([part.flux for part in parts])
        pairs = zip(self.boards, self.designed, strict=True)
        raw = [board.added(pictures, fluxes) for board, pictures in pairs]
        taken = [np.zeros_like(image) for image in raw]
        for number, part in enumerate(parts or ()):
            own = self._shares[number]
            exits = self.exit_rays(part, own.rays)
            for k, receiver in enumerate(self._seen[number]):
                for landings, images in ((receiver.land(exits), raw), (self._landed[number][k], taken)):
                    flux = part.flux * landings.flux
                    add_to_bins(landings.hits, flux, receiver.grid.size, own.replicate, images[k])
        raw = [image - less for image, less in zip(raw, taken, strict=True)]
        emitted_w = float(fluxes.mean()) * self.held.emitted_w
        return tuple(self._received(number, image, emitted_w) for number, image in enumerate(raw))

    def _received(self, number: int, raw: Images, emitted_w: float) -> ReceivedImages:
        columns, rows = self.periods
        receiver, target = self.receivers[number], self.one.targets[0][number]
        of_period = raw.reshape(len(raw), rows, -1, columns, raw.shape[2] // columns).sum(axis=(1, 3))
        window = (raw * receiver.window.pixels(receiver.grid)).sum(axis=(1, 2))
        lit = (of_period * target.coverage).sum(axis=(1, 2))
        smooth = gaussian3(raw, self.spec.evaluate.filter_variance)
        return ReceivedImages(smooth, window / emitted_w, lit / emitted_w, emitted_w)

    @cached_property
    def targets(self) -> tuple[list[DrawnTarget], list[Bool[np.ndarray, "_ _"] | None]]:
        """Target and region of one period, again in every period of a patch."""
        times, (targets, masks) = self.periods[::-1], self.one.targets
        return [replace(each, light=np.tile(each.light, times)) for each in targets], [
            None if mask is None else np.tile(mask, times) for mask in masks
        ]


def in_plate(found: Deviations, place: Place, turn_deg: float) -> Deviations:
    """Deviations of one lens of a plate, in its own frame, from those of the plate about its middle.

    A plate that shrinks or tilts moves its lenses, each as far as it stands from the middle.
    """
    none = np.zeros(2)
    (x, y), (about_x, about_y) = place, found.get("lens_tilt_deg", none).tolist()
    moved = found.get("lens_shift_mm", none) + float(found.get("shrinkage", none)[0]) * np.array(place)
    raised = float(found.get("lens_height_mm", none)[0]) + about_x * y - about_y * x
    turn = np.exp(-1j * radians(turn_deg))
    shift, tilt = complex(*moved) * turn, complex(about_x, about_y) * turn
    own: dict[str, Float[np.ndarray, " k"]] = {
        "lens_shift_mm": np.array([shift.real, shift.imag]),
        "lens_height_mm": np.array([raised]),
        "lens_tilt_deg": np.array([tilt.real, tilt.imag]),
    }
    return {**found, **own}
