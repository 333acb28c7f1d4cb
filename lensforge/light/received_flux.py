"""Flux that reaches a receiver in independent replicates: by pixel, by fate, and of lamps together their mean."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.kernels.fate import Fate
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Shadow
from lensforge.scene.housing_walk import SceneLeg
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.pixel_grid import bin_flux, rebinned
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.region import Region

MISSED_RECEIVER = len(Fate)  # after the fates: left the lens, but never reaches the receiver
ABSORBED = len(Fate) + 1  # in the body, of rays of any fate
IN_GLASS = len(Fate) + 2  # reflected or absorbed by the cover glass
BLOCKED = len(Fate) + 3  # left the lens, met a body of the scene before the receiver, and was taken by it
SECOND_WALL = len(Fate) + 4  # went on from bodies of the scene by all its events, and met a further one
CAUSES = len(Fate) + 5  # behind them, the flux lost in each of the further bodies


@dataclass(frozen=True)
class ReceivedFlux:
    """Flux (W) on one receiver in each replicate: per pixel (r, h, w), by fate (r, f), in the window and outside it.

    The fates are those of :class:`~lensforge.kernels.fate.Fate`, where ``LEFT_LENS`` holds what landed, and
    ``MISSED_RECEIVER``, ``ABSORBED``, ``IN_GLASS``, ``BLOCKED`` and ``SECOND_WALL``; then each of the further bodies.
    ``in_regions``: in each of the ``regions`` (k). ``colours``: X, Y and Z (lm) per pixel; None without colour.
    ``by_housing``: flux that each body of the scene takes, what of it ends there, that which goes from it into the
    window, that which meets it, and the last times x, y and z (mm) of the place at which it does; None without a scene.
    """

    images: Float[np.ndarray, "r h w"]
    by_fate: Float[np.ndarray, "r f"]
    window: Float[np.ndarray, " r"]
    outside: Float[np.ndarray, " r"]
    in_regions: Float[np.ndarray, "r k"]
    regions: tuple[Region, ...] = ()
    colours: Float[np.ndarray, "3 r h w"] | None = None
    by_housing: Float[np.ndarray, "r b 7"] | None = None

    @staticmethod
    def none_yet(
        receiver: PosedReceiver,
        replicates: int,
        regions: tuple[Region, ...],
        *,
        coloured: bool = False,
        bodies: int = 0,
    ) -> "ReceivedFlux":
        """No flux; ``bodies``: number of further bodies behind the lens."""
        images = np.zeros((replicates, *receiver.grid.shape))
        none = np.zeros(replicates)
        in_regions = np.zeros((replicates, len(regions)))
        colours = np.zeros((3, *images.shape)) if coloured else None
        by_fate = np.zeros((replicates, CAUSES + bodies))
        blocked = None if receiver.housing is None else np.zeros((replicates, len(receiver.housing), 7))
        return ReceivedFlux(images, by_fate, none, none.copy(), in_regions, regions, colours, blocked)

    @staticmethod
    def mean(of_kinds: Sequence["ReceivedFlux"], shares: Sequence[float]) -> "ReceivedFlux":
        """Mean flux over lamps whose lenses are of several kinds, each weighted by its share of the lamps."""

        def mean(name: str) -> Float[np.ndarray, "..."]:
            parts = zip(shares, of_kinds, strict=True)
            return np.asarray(np.sum([share * getattr(flux, name) for share, flux in parts], axis=0))

        first = of_kinds[0]
        amounts = ("images", "by_fate", "window", "outside", "in_regions")
        further = {name: mean(name) for name in ("colours", "by_housing") if getattr(first, name) is not None}
        return ReceivedFlux(**{name: mean(name) for name in amounts}, regions=first.regions, **further)

    def add(
        self,
        replicate: int,
        share: float,
        receiver: PosedReceiver,
        rays: ExitRays,
        landings: Landings,
        tristimulus: Float[np.ndarray, "n 3"] | None = None,
    ) -> None:
        """Count ``share`` of the flux of ``rays`` in ``replicate``; ``tristimulus``: X, Y, Z per W of each."""
        hits = landings.hits
        flux = landings.flux * share
        self.images[replicate] += bin_flux(hits, flux, receiver.grid)
        self.by_fate[replicate] += share * flux_by_fate(rays, landings.missed_receiver, landings.shadow)
        inside = receiver.window.contains(hits)
        if landings.shadow is not None and self.by_housing is not None:
            legs = landings.legs or (SceneLeg.first(rays, landings.shadow),)
            self.by_housing[replicate] += share * _by_body(legs, landings.flux * inside, self.by_housing.shape[1])
        self.window[replicate] += flux[inside].sum()
        self.outside[replicate] += flux[~inside].sum()
        if landings.again is not None:
            self.images[replicate] += share * bin_flux(landings.again.hits, landings.again.flux, receiver.grid)
        self.in_regions[replicate] += [flux[region.contains(hits)].sum() for region in self.regions]
        if self.colours is not None:
            assert tristimulus is not None, "a source that was built with its colours"
            for picture, per_watt in zip(self.colours, tristimulus.T, strict=True):
                picture[replicate] += bin_flux(hits, flux * per_watt, receiver.grid)

    @staticmethod
    def mean_of_lamps(
        lamps: LampPictures, rasters: Sequence["ReceivedFlux"], regions: tuple[Region, ...]
    ) -> "ReceivedFlux":
        """Mean flux per lamp on a receiver that lamps share, from the flux of one lamp on each raster.

        Pixels that lie partly in a region count by that part.
        """
        images = lamps.added([raster.images for raster in rasters])
        landed = lamps.mean([raster.window + raster.outside for raster in rasters])
        window = images.sum(axis=(1, 2)) if lamps.widened else lamps.mean([raster.window for raster in rasters])
        in_regions = np.zeros((len(images), len(regions)))
        for k, region in enumerate(regions):
            in_regions[:, k] = (rebinned(images, region.grid) * region.coverage).sum(axis=(1, 2))
        by_fate = lamps.mean([raster.by_fate for raster in rasters])
        seen = [raster.colours for raster in rasters if raster.colours is not None]
        colours = lamps.added(seen) if seen else None
        by_housing = [raster.by_housing for raster in rasters if raster.by_housing is not None]
        blocked = lamps.mean(by_housing) if by_housing else None
        outside = np.maximum(landed - window, 0.0)
        return ReceivedFlux(images, by_fate, window, outside, in_regions, regions, colours, blocked)


def named_flux(by_fate: Float[np.ndarray, " f"]) -> dict[str, float]:
    """Flux of each fate by its name, the further bodies summed."""
    places = {fate.name.lower(): int(fate) for fate in Fate}
    places |= {"missed_receiver": MISSED_RECEIVER, "absorbed": ABSORBED, "cover_glass": IN_GLASS}
    places |= {"housing": BLOCKED, "second_wall": SECOND_WALL}
    named = {name: float(by_fate[place]) for name, place in places.items()}
    return {**named, "bodies": float(by_fate[CAUSES:].sum())}


def flux_by_fate(
    rays: ExitRays, missed_receiver: Bool[np.ndarray, " n"], shadow: Shadow | None = None
) -> Float[np.ndarray, " f"]:
    """Flux (W) by fate; rays that left the lens but ``missed_receiver``, flux that bodies of the scene take, and
    absorbed flux are counted apart.

    Then the flux lost in each further body.
    """
    fates = np.where(missed_receiver, MISSED_RECEIVER, rays.fates)
    flux = rays.flux
    if shadow is not None:
        fates = np.where(shadow.again, SECOND_WALL, fates)
        flux = flux * shadow.onward
    by_fate = np.bincount(fates, flux, minlength=CAUSES)
    by_fate[BLOCKED] = (rays.flux - flux).sum()
    if rays.absorbed is not None:
        by_fate[ABSORBED] = rays.absorbed.sum()
    if rays.lost_in_glass is not None:
        by_fate[IN_GLASS] = rays.lost_in_glass.sum()
    return by_fate if rays.lost_in_bodies is None else np.concatenate([by_fate, rays.lost_in_bodies.sum(axis=1)])


def _by_body(legs: Sequence[SceneLeg], landed: Float[np.ndarray, " n"], bodies: int) -> Float[np.ndarray, "b 7"]:
    """Sums of flux (W) by body over all ``legs``; ``landed``: of each ray in the window, by way of the last body.

    Taken, taken of rays that end there, returned, incident; incident flux times place: the last three are W mm.
    """
    last = np.full(len(landed), -1)
    for number, leg in enumerate(legs):
        last[leg.rows[leg.shadow.met]] = number
    parts = [_of_leg(leg, landed[leg.rows] * (last[leg.rows] == number), bodies) for number, leg in enumerate(legs)]
    return np.asarray(np.sum(parts, axis=0))


def _of_leg(leg: SceneLeg, returned: Float[np.ndarray, " k"], bodies: int) -> Float[np.ndarray, "b 7"]:
    shadow = leg.shadow
    met = shadow.met & ~shadow.again
    flux = leg.rays.flux[met]
    taken = flux * (1.0 - shadow.onward[met])
    kept = np.where(shadow.onward[met] == 0.0, flux, 0.0)
    amounts = (taken, kept, returned[met], flux, *(flux * coordinate for coordinate in shadow.places[met].T))
    sums = [np.bincount(shadow.bodies[met], amount, bodies) for amount in amounts]
    return np.stack(sums, axis=1).astype(np.float64)  # of nothing the sums are integers
