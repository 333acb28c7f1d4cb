"""Joint light of lamps with individual errors: of a board or a plate, or of a patch of an endless lattice.

The picture of a board is the sum over its lamps of that of the lens as designed, by many rays, times the flux of each
lamp, and of the change that the errors of each lamp make to its picture. For the change every lamp is traced by its
share of the rays, which are added where they land and taken off where the lens as designed would send them. So the flux
of the lamps adds no noise, rays that an error does not move add none, and a board takes as many rays as one lamp.

Of an infinite lattice a patch of some periods is drawn, and repeated without end: its light is measured over all of the
patch, its limits in each of its periods.

Where lenses are of several kinds, each lamp is traced by its own, and each kind has a picture as designed.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse

from lensforge.errors import InputError
from lensforge.kernels.image_sums import add_to_bins
from lensforge.light.replicate_rays import ReplicateRays
from lensforge.light.simulation import REPLICATES, TracedLens, bundles
from lensforge.made.part_light import (
    Channels,
    PartLight,
    ReceivedImages,
    blocked_flux,
    flux_by_cause,
    in_channels,
    judged_colour,
    rays_behind,
)
from lensforge.scene.lamp_pictures import LampPictures, patch_pictures, seen_by
from lensforge.scene.lens import Lens
from lensforge.scene.light_ends import with_beside
from lensforge.scene.limit_readings import LightLimit
from lensforge.scene.made_part import MadePart, PartMaker
from lensforge.scene.perturbations import Deviations
from lensforge.scene.pixel_grid import bin_flux, gaussian3
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.target_pattern import DrawnTarget
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.lamp_places import Lamp
from lensforge.spec.light_limits import ColourSection
from lensforge.spec.quantities import BodyLight

_PERIODS = 3  # along x and along y, of a lattice without a plate
_MOST_PIXELS = 2**20  # of a patch, of which a study keeps sixteen pictures at a time
COMMON = frozenset({"index", "shrinkage", "temperature_k"})  # of the batch, and of the place where it is at work
OF_PLATE = ("lens_shift_mm", "lens_height_mm", "lens_tilt_deg")  # of one piece


def common_to_lamps(spec: Spec) -> frozenset[str]:
    """Tolerances that all lamps of a board share: those of the batch, and the place of the plate, if any."""
    return COMMON if spec.plate is None else COMMON.union(OF_PLATE)


def periods_of(spec: Spec) -> tuple[int, int]:
    """Columns and rows of the patch drawn of a lattice: those of its plate, else three of each; else (1, 1)."""
    lamps = spec.all_lamps
    if lamps.period_mm is None:
        return 1, 1
    if spec.plate is None:
        return _PERIODS, _PERIODS
    return spec.plate.columns or 1, -(-(spec.plate.rows or 1) // len(lamps))


def pictures_of(receiver: PosedReceiver, periods: tuple[int, int]) -> LampPictures:
    """The rasters of a receiver; for an endless lattice those of a patch of ``periods``.

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
    lens: TracedLens,
    source: Source,
    boards: Sequence[LampPictures],
    rays: int,
    seed: int,
    colour: ColourSection | None = None,
) -> list[list[Channels]]:
    """Light of one lamp as designed on the rasters of each receiver, in replicates."""
    count = min(REPLICATES, rays, source.ray_count or rays)
    channels = 1 if colour is None else 4
    pictures_of_boards = [
        [np.zeros((channels, count, *receiver.grid.shape)) for receiver in board.receivers] for board in boards
    ]
    for replicate, share, bundle in bundles(source, rays, count, seed):
        exits = lens.trace(bundle)
        for board, pictures in zip(boards, pictures_of_boards, strict=True):
            for receiver, picture in zip(board.receivers, pictures, strict=True):
                landings = receiver.land(exits)
                for number, carried in enumerate(in_channels(landings.flux * share, bundle, colour)):
                    picture[number, replicate] += bin_flux(landings.hits, carried, receiver.grid)
    return pictures_of_boards


def on_patch(limit: LightLimit, grid: tuple[int, int], periods: tuple[int, int]) -> LightLimit:
    """The ``limit`` on a period of (rows, columns) of pixels in every period of a patch.

    Pictures hold the mean flux of all lamps of the patch, of which a period has but its part; losses are the mean, and
    flux in a zone is counted in all periods.
    """
    if limit.quantity.of_losses or limit.region is not None:
        return limit
    height, width = grid
    columns, rows = periods
    readings = sparse.coo_array(limit.readings)
    values = columns * rows * readings.data
    y, x = np.divmod(readings.col, width)
    shape = readings.shape[0], columns * rows * height * width
    by_period = [
        sparse.csr_array((values, (readings.row, (y + j * height) * columns * width + x + i * width)), shape=shape)
        for j in range(rows)
        for i in range(columns)
    ]
    return replace(limit, readings=sparse.csr_array(sparse.vstack(by_period)))


@dataclass(frozen=True, eq=False)
class LensOnBoard:
    """A ``lens``, tabulated as in a search, of the lamps ``numbers``; ``boards``: each receiver lit only by them.

    The error of such tables is in the part and in the lens as designed alike.
    """

    lens: Lens
    nominal: TracedLens
    maker: PartMaker
    numbers: tuple[int, ...]
    boards: tuple[LampPictures, ...]


@dataclass(frozen=True, eq=False)
class BoardLight(PartLight):
    """Simulation of boards of ``spec``: the ``receivers`` are those of a patch, the ``limits`` those of one period.

    ``designed``: pictures of each kind of lens by :func:`designed_pictures`, in as many replicates as the rays that are
    held; ``one``: the light of one lamp, or of one period.
    """

    kinds: tuple[LensOnBoard, ...]
    periods: tuple[int, int]
    designed: list[list[list[Channels]]]
    one: PartLight

    @staticmethod
    def of(
        light: PartLight,
        receivers: tuple[PosedReceiver, ...],
        kinds: tuple[LensOnBoard, ...],
        designed: list[list[list[Channels]]],
    ) -> "BoardLight":
        """Boards on ``receivers``, with the limits of the spec.

        Raises :class:`InputError` for too few rays, and for a limit on a body.
        """
        periods = periods_of(light.spec)
        lamps = len(receivers[0].lamps)
        rays = len(light.held)
        if rays < REPLICATES * lamps:
            least = REPLICATES * lamps
            raise InputError(f"yield: {rays} rays for {lamps} lamps: {REPLICATES} each at least; give {least}")
        limits = light.limits
        on_body = next((limit.name for limit in limits if isinstance(limit.quantity, BodyLight)), None)
        if on_body is not None:
            raise InputError(
                f"yield: {on_body}: light on a body is of all lamps, whose parts are drawn apart; it is not judged, "
                "leave out the limit, or lamps"
            )
        if periods != (1, 1):
            limits = tuple(
                limit
                if limit.quantity.of_view
                else on_patch(limit, light.receivers[limit.receiver].grid.shape, periods)
                for limit in limits
            )
        return BoardLight(light.spec, light.nominal, receivers, limits, light.held, kinds, periods, designed, light)

    @cached_property
    def _lens_of_lamp(self) -> list[TracedLens]:
        lenses = {number: kind.nominal for kind in self.kinds for number in kind.numbers}
        return [lenses[number] for number in range(len(lenses))]

    @cached_property
    def _shares(self) -> list[ReplicateRays]:
        return self.held.shared_out(len(self.receivers[0].lamps))

    @cached_property
    def _seen(self) -> list[list[PosedReceiver]]:
        return [[seen_by(receiver, number) for receiver in self.receivers] for number in range(len(self._shares))]

    @cached_property
    def _landed(self) -> list[list[Landings]]:
        """Landings of the rays of each lamp behind the lens as designed."""
        every = zip(self._lens_of_lamp, self._shares, self._seen, strict=True)
        return [
            [receiver.land(rays_behind(lens, None, shared_rays.rays)) for receiver in seen]
            for lens, shared_rays, seen in every
        ]

    def received(self, parts: Sequence[MadePart] | None) -> tuple[ReceivedImages, ...]:
        """Light of a board on each receiver, by each lamp's part; None: by the lens as designed."""
        fluxes = np.ones(len(self._shares)) if parts is None else np.array([part.flux for part in parts])
        raw = [self._designed(number, fluxes) for number in range(len(self.receivers))]
        colour = judged_colour(self.spec)
        taken = [np.zeros_like(image) for image in raw]
        for number, part in enumerate(parts or ()):
            held = self._shares[number]
            exits = rays_behind(self._lens_of_lamp[number], part, held.rays)
            for k, receiver in enumerate(self._seen[number]):
                for landings, images in ((receiver.land(exits), raw), (self._landed[number][k], taken)):
                    carried = in_channels(part.flux * landings.flux, held.rays, colour)
                    for flux, image in zip(carried, images[k], strict=True):
                        add_to_bins(landings.hits, flux, receiver.grid.size, held.replicate, image)
        raw = [image - less for image, less in zip(raw, taken, strict=True)]
        emitted_w = float(fluxes.mean()) * self.held.emitted_w
        lit = (self._received(number, image, emitted_w) for number, image in enumerate(raw))
        first = None if parts is None else parts[0]
        held = self._shares[0]
        behind = rays_behind(self._lens_of_lamp[0], first, held.rays) if self.views else None
        eyes = () if behind is None else self.seen(behind, held, len(fluxes) * float(fluxes[0]))
        return (*(self._with_losses(parts, lit) if self.counts_losses else lit), *eyes)

    def _with_losses(self, parts: Sequence[MadePart] | None, lit: Iterable[ReceivedImages]) -> Iterator[ReceivedImages]:
        """The light on each receiver, and the mean flux of a lamp by the cause of its loss."""
        by_cause: list[Float[np.ndarray, "r k"]] = []
        blocked: list[list[Float[np.ndarray, " r"]]] = []
        lamps = zip(self._lens_of_lamp, self._shares, self._seen, parts or repeat(None), strict=False)
        for lens, share, seen, part in lamps:
            exits = rays_behind(lens, part, share.rays)
            flux = 1.0 if part is None else part.flux
            by_cause.append(flux_by_cause(lens, exits, share, flux))
            blocked.append([blocked_flux(receiver.land(exits), exits, share, flux) for receiver in seen])
        for received, of_lamps in zip(lit, zip(*blocked, strict=True), strict=True):
            in_window = received.window * received.emitted_w
            losses = with_beside(np.sum(by_cause, axis=0), in_window, np.sum(of_lamps, axis=0))
            yield replace(received, losses=losses)

    def _designed(self, receiver: int, fluxes: Float[np.ndarray, " n"]) -> Channels:
        by_kind = []
        for kind, designed in zip(self.kinds, self.designed, strict=True):
            added = kind.boards[receiver].added(designed[receiver], fluxes[list(kind.numbers)])
            by_kind.append(len(kind.numbers) / len(fluxes) * added)
        return np.asarray(np.sum(by_kind, axis=0))

    def _received(self, number: int, raw: Channels, emitted_w: float) -> ReceivedImages:
        columns, rows = self.periods
        flux = raw[0]
        receiver = self.receivers[number]
        target = self.one.targets[0][number]
        of_period = flux.reshape(len(flux), rows, -1, columns, flux.shape[2] // columns).sum(axis=(1, 3))
        window = (flux * receiver.window.pixels(receiver.grid)).sum(axis=(1, 2))
        regions = (target, *self.one.zones[number])
        lit, *in_zones = ((of_period * region.coverage).sum(axis=(1, 2)) / emitted_w for region in regions)
        smooth = gaussian3(raw, self.spec.evaluate.filter_variance)
        return ReceivedImages(smooth, window / emitted_w, lit, in_zones, emitted_w)

    @cached_property
    def targets(self) -> tuple[list[DrawnTarget], list[Bool[np.ndarray, "_ _"] | None]]:
        """Target and region of one period, again in every period of a patch."""
        times = self.periods[::-1]
        targets, masks = self.one.targets
        return [replace(target, light=np.tile(target.light, times)) for target in targets], [
            None if mask is None else np.tile(mask, times) for mask in masks
        ]


def in_plate(deviations: Deviations, lamp: Lamp) -> Deviations:
    """Deviations of one lens of a plate, in its local frame, from those of the plate about its middle.

    A plate that shrinks or tilts moves each lens in proportion to its distance from the middle.
    """
    none = np.zeros(2)
    (x, y, _) = lamp.place_mm
    about_x, about_y = deviations.get("lens_tilt_deg", none).tolist()
    moved = deviations.get("lens_shift_mm", none) + float(deviations.get("shrinkage", none)[0]) * np.array([x, y])
    raised = float(deviations.get("lens_height_mm", none)[0]) + about_x * y - about_y * x
    shift, tilt = lamp.pose.to_local_directions(np.array([[*moved, raised], [about_x, about_y, 0.0]]))
    return {**deviations, "lens_shift_mm": shift[:2], "lens_height_mm": shift[2:], "lens_tilt_deg": tilt[:2]}
