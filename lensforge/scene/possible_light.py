"""Upper bounds of the light that any lens of a given size brings to a receiver: what physics allows.

No optics raises radiance, so that an étendue G holds at most the flux of the brightest light that adds up to G. Where
the radiance of an emitter is known, a ray stands for the étendue ``flux / radiance``. Otherwise it is estimated. Rays
are points of phase space: where their lines cross a plane z = const, and their direction cosines along x and y, in
which an element of étendue is ``dx dy dp dq``. The sample is divided at medians into cells of equally many rays; flux
over volume is the radiance there, to the noise of 32 rays and as the mean over the cell.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from lensforge.optics.coatings import whole_span
from lensforge.optics.exit_space import DrawnBall, ExitBall, ExitSpace
from lensforge.optics.fundamental_limits import BY_SYMMETRY, best_transmittance, cone_around, least_by_way
from lensforge.optics.media import Media
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.receiver import PosedReceiver
from lensforge.sources.ray_bundle import ChangedSource, RayBundle, Source, is_round
from lensforge.sources.waist import at_height, waist_mm
from lensforge.spec.lens_section import LensShape
from lensforge.surfaces.mirror_group import REVOLUTION, images_in_common, shortest_arc
from lensforge.surfaces.placed_bodies import reach_mm

_RAYS_PER_CELL = 32  # fewer: the noise of a cell's radiance; more: cells average over radiance that differs
_LEVEL = 1e-3  # rays closer than this to z = const cross no plane nearby


@runtime_checkable
class KnownRadiance(Protocol):
    """A source that can say the radiance of each of its rays."""

    def radiances(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Radiance (W/(mm^2 sr)) where each ray of ``sample(count, seed)`` starts; infinite for a point."""
        ...


@dataclass(frozen=True)
class EtendueCurve:
    """Largest share of a source's flux within an étendue: corners of a concave curve, from brightest to darkest light.

    ``share[0]`` at étendue 0 is light without extent, such as that of a point source: it has no bound. ``estimated``:
    from cells of rays, not from known radiances; cells average over light that is brighter, so that it bounds nothing.
    """

    etendue_mm2_sr: Float[np.ndarray, " k"]
    share: Float[np.ndarray, " k"]
    estimated: bool

    @staticmethod
    def of_source(source: Source, rays: RayBundle, seed: int) -> "EtendueCurve":
        """The curve of ``source`` from ``rays``, its sample of that ``seed``: of its radiances where it knows them."""
        emitter = source
        while isinstance(emitter, ChangedSource):
            emitter = emitter.source  # changes move rays and disperse them; none changes a radiance
        if not isinstance(emitter, KnownRadiance):
            return EtendueCurve.of(rays)
        return _curve(rays.flux / emitter.radiances(len(rays), seed), rays.flux, estimated=False)

    @staticmethod
    def of(rays: RayBundle) -> "EtendueCurve":
        """The curve of ``rays``; too few for a cell count as light without extent, as do those level with the plane."""
        rise = rays.directions[:, 2]
        volume = np.zeros(1)
        flux = np.array([rays.flux[np.abs(rise) <= _LEVEL].sum()])
        for side in (rise > _LEVEL, rise < -_LEVEL):
            own_volume, own_flux = _cells(rays, side)
            volume = np.concatenate([volume, own_volume])
            flux = np.concatenate([flux, own_flux])
        return _curve(volume, flux, estimated=True)

    @property
    def brightest(self) -> float:
        """Share of the flux per étendue (1/(mm^2 sr)) of the brightest light; infinite for light without extent."""
        return float(np.diff(self.share)[0] / np.diff(self.etendue_mm2_sr)[0]) if self.share[0] == 0.0 else np.inf

    def shares_within(self, etendue_mm2_sr: float | Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Largest share of the flux that fits into an étendue (mm^2 sr), or into each of many."""
        return np.asarray(np.interp(etendue_mm2_sr, self.etendue_mm2_sr, self.share))


WITHOUT_EXTENT = EtendueCurve(np.zeros(1), np.ones(1), estimated=False)  # of which no radiance is known


def _curve(volume: Float[np.ndarray, " c"], flux: Float[np.ndarray, " c"], *, estimated: bool) -> EtendueCurve:
    without_extent = volume <= 0.0
    extended = volume[~without_extent]
    curve_flux = flux[~without_extent]
    order = np.argsort(extended / np.where(curve_flux > 0.0, curve_flux, np.finfo(float).tiny))
    first = flux[without_extent].sum()
    total = flux.sum()
    share = np.concatenate([[first], first + np.cumsum(curve_flux[order])]) / total
    return EtendueCurve(np.concatenate([[0.0], np.cumsum(extended[order])]), share, estimated)


def _cells(rays: RayBundle, chosen: Bool[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Étendue and flux of cells of the ``chosen`` rays, all on one side of the horizon; 0 where they are too few."""
    count = int(chosen.sum())
    flux = rays.flux[chosen]
    levels = int(np.log2(max(count / _RAYS_PER_CELL, 1.0)))
    if count < 2 * _RAYS_PER_CELL:
        return np.zeros(1), np.array([flux.sum()])
    points = _phase_space(rays.take(chosen))
    cells = count >> levels
    left_over = flux[cells << levels :].sum()  # fewer than there are cells: spread over them
    members = np.arange(cells << levels)[None, :]
    extent = np.ptp(points, axis=0)
    scale = np.where(extent > 0.0, extent, 1.0)
    for _ in range(levels):
        widest = (np.ptp(points[members], axis=1) / scale).argmax(axis=1)
        order = np.argsort(points[members, widest[:, None]], axis=1)
        members = np.take_along_axis(members, order, axis=1).reshape(2 * len(members), -1)
    # the box of m uniform points is smaller than their cell by (m - 1)/(m + 1) along each side
    volume = np.prod(np.ptp(points[members], axis=1) * (cells + 1) / (cells - 1), axis=1)
    shares = flux[members].sum(axis=1)
    return volume, shares * (1.0 + left_over / max(float(shares.sum()), np.finfo(float).tiny))


def _phase_space(rays: RayBundle) -> Float[np.ndarray, "n 4"]:
    """Crossings (mm) of the rays' lines with the plane in which they lie closest together, and direction cosines."""
    return np.concatenate([at_height(rays, waist_mm(rays))[:, :2], rays.directions[:, :2]], axis=1)


_RAYS = 2**14  # 16 times as many move no bound of a shipped scene by 0.2 %
_SEED = 0
_WINDOW_SUBPIXELS = 8  # along a side of a pixel: the share of it that is in a round window
_LAYERS = 32  # steps of weight
_JOINT = 8  # steps with one joint bound
_DIGITS = 12  # of a share; the same bound by two sums differs behind these
_BISECTIONS = 60  # of the level that fills a target: to the last digits

BY_PROFILES = "faces drawn along y"  # what turns light in a linear lens, by refraction or at its walls, too

Image = Float[np.ndarray, "h w"]
Region = Bool[np.ndarray, "h w"] | Float[np.ndarray, "h w"]  # pixels, or the share of each that counts


@dataclass(frozen=True)
class LargestShare:
    """Upper bounds of a share of the source's flux: by étendue, and by what two refractions turn and transmit.

    ``turned_by``: what does it in their place. ``by_symmetry``: by that of a lens of faces of revolution.
    ``estimated``: étendue is counted by an estimate of the source's luminance, and bounds nothing.
    """

    by_etendue: float
    by_refraction: float
    turned_by: str = "two refractions"
    by_symmetry: float = 1.0
    estimated: bool = False

    @property
    def value(self) -> float:
        """The lowest one, an estimate among them."""
        return min(self.by_etendue, self.certain)

    @property
    def certain(self) -> float:
        """The lowest one that no light exceeds."""
        certain = min(self.by_refraction, self.by_symmetry)
        return certain if self.estimated else min(self.by_etendue, certain)

    @property
    def is_estimate(self) -> bool:
        """True where an estimate is the lowest one."""
        return self.value < self.certain

    @property
    def law(self) -> str:
        """The law that sets it, in words."""
        laws = {
            f"deflection and loss of {self.turned_by}": self.by_refraction,
            "étendue": self.by_etendue,
            BY_SYMMETRY: self.by_symmetry,
        }
        return min(laws, key=lambda law: round(laws[law], _DIGITS))  # of equal ones the first

    def __str__(self) -> str:
        return f"{100.0 * self.value:.3g} % of the light ({self.law})"


@dataclass(frozen=True)
class SourceLight:
    """A sample of a source's rays, the étendue that they take outside the lens, and the media that they pass.

    Beside walls that reflect light, it comes from elsewhere than the lens: étendue and symmetry then bound nothing.
    ``reflects``: the lens has a wall for total reflection, which turns light by any angle and loses none.
    ``round_by``: of a lens of faces of revolution the mirror group that the light of the source has, and keeps, or
    ``REVOLUTION``; None for any other lens.
    """

    rays: RayBundle
    curve: EtendueCurve
    media: Media
    reflects: bool = False
    round_by: str | None = None

    @staticmethod
    def of(source: Source, media: Media, count: int = _RAYS, *, lens: LensShape | None = None) -> "SourceLight":
        """Sample ``source``, whose light goes through any ``lens`` of that kind, by default one of two faces."""
        count = min(count, source.ray_count or count)
        rays = source.sample(count, _SEED)
        curve = WITHOUT_EXTENT if media.walls else EtendueCurve.of_source(source, rays, _SEED)
        light = SourceLight.of_rays(rays, curve, media)
        round_by = REVOLUTION if is_round(source) else source.symmetry
        kept = lens is not None and lens.is_round and not media.bodies and not media.walls
        return replace(light, reflects=lens is not None and lens.reflects, round_by=round_by if kept else None)

    @staticmethod
    def of_rays(rays: RayBundle, curve: EtendueCurve, media: Media) -> "SourceLight":
        """Light of given ``rays``; ``curve``: of the étendue that they have in the cavity."""
        outside = replace(curve, etendue_mm2_sr=media.etendue_factor * curve.etendue_mm2_sr)
        return SourceLight(rays, outside, media)

    @property
    def certain(self) -> "SourceLight":
        """The light of which only what is known bounds anything: without étendue, where that is an estimate."""
        return replace(self, curve=WITHOUT_EXTENT) if self.curve.estimated else self

    def best_transmittances(self, turns_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Largest transmittance of two faces that turn each of the rays by at least so much, or with a reflection."""
        if self.media.bodies or self.media.spreads or self.media.walls:  # they may turn it, too
            turns_rad = np.zeros_like(turns_rad)
        mirror = self.media.exit_mirror
        if mirror is not None:  # what need not turn leaves directly, all else by one reflection at least
            return np.where(turns_rad > 0.0, mirror.reflectance, 1.0)
        turns_rad = np.zeros_like(turns_rad) if self.reflects else turns_rad
        media = self.media
        least = least_by_way(media, whole_span(self.rays.wavelengths_nm, media))
        indices = media.body.indices(self.rays.waves, len(self.rays))
        return best_transmittance(turns_rad, indices, media.cavity_index, media.outside_index, least)

    @cached_property
    def transmittance(self) -> float:
        """Transmittance of two faces that need not turn light, for the light that they transmit best."""
        return float(self.best_transmittances(np.zeros(len(self.rays))).max())

    @property
    def brightest(self) -> float:
        """Radiance (1/(m^2 sr)) behind any lens over the flux of the source, at most: no optics raises it."""
        return 1e6 * self.transmittance * self.curve.brightest


@dataclass(frozen=True)
class PossibleLight:
    """Light that any lens whose light leaves ``space`` can bring to ``receiver`` from a source, at most.

    Étendue: what reaches a pixel has at most the étendue from that space to it, and at most the flux of the brightest
    light of the source of that étendue (Winston, Minano and Benitez, Nonimaging Optics, 2005, chapter 2), times what
    two faces transmit at normal incidence. Refraction: to reach a region a ray must turn by the angle from its
    direction to the cone around the region, and two faces that turn it so far transmit
    :func:`~lensforge.optics.fundamental_limits.best_transmittance` of it. Symmetry: faces of revolution keep that of
    the source, so that images of a region get as much light as the region itself. Of lamps together the mean of a lamp
    is bounded: by the mean étendue, as the flux in an étendue is concave, and the mean of the other two.
    """

    light: SourceLight
    receiver: PosedReceiver
    space: ExitSpace

    @property
    def certain(self) -> "PossibleLight":
        """The bounds that no estimate enters."""
        return replace(self, light=self.light.certain)

    @cached_property
    def _exit(self) -> ExitSpace:
        """The space from which light seems to come: nearer by the thickness of a cover glass at most.

        Of bodies behind the lens the light comes out of the last.
        """
        glass = self.light.media.cover_glass
        bodies = self.light.media.bodies
        out_of = ExitBall(reach_mm(bodies)) if bodies else self.space
        return out_of.grown(0.0 if glass is None else glass.thickness_mm)

    @cached_property
    def _lamps(self) -> LampPictures:
        return LampPictures.of(self.receiver)

    @cached_property
    def _corners(self) -> list[Float[np.ndarray, "_ _ 3"]]:
        return [receiver.corners() for receiver in self._lamps.receivers]

    @cached_property
    def _etendues(self) -> Float[np.ndarray, "k h w"]:
        """Étendue (mm^2 sr) of each pixel, the mean of all lamps, for each of the spaces that a lens may have."""
        return self._lamps.summed(self._etendues_on, self._exit.flux_upwards_mm2_sr)

    def _etendues_on(self, receiver: PosedReceiver) -> Float[np.ndarray, "k h w"]:
        rows, columns = receiver.grid.shape
        times = self._exit.finer(max(rows, columns))
        fine = replace(receiver, grid=receiver.grid.finer(times)).corners()
        etendues = self._exit.etendues(fine, far=receiver.is_far)
        return np.asarray(etendues.reshape(-1, rows, times, columns, times).sum(axis=(2, 4)))

    @cached_property
    def on_pixels(self) -> Image:
        """Largest share of the source's flux on each pixel, by étendue: the brightness theorem."""
        return self.light.transmittance * self.light.curve.shares_within(self._etendues.max(axis=0))

    def by_etendue(self, pixels: Region) -> float:
        """Largest share in ``pixels`` [row y, column x], or in a part of each, by étendue alone."""
        etendue = float((self._etendues * pixels).sum(axis=(1, 2)).max())
        return self.light.transmittance * float(self.light.curve.shares_within(etendue))

    def in_region(self, pixels: Region) -> LargestShare:
        """Largest share in ``pixels``, or in a part of each; without extent by refraction alone."""
        if not pixels.any():
            return LargestShare(0.0, 0.0)
        held = self.by_etendue(pixels)
        most = self.light.transmittance
        estimated = self.light.curve.estimated
        by = "two refractions" if self.light.media.exit_mirror is None else "a mirror"
        by = by if self._drawn is None else BY_PROFILES
        if self.receiver.lamps.period_mm is not None:  # some of it lies in every direction
            return LargestShare(held, most, by, estimated=estimated)
        regions = list(zip(self._lamps.receivers, self._corners, self._lamps.regions(pixels > 0.0), strict=True))
        refracted = float(self._lamps.mean([self._refracted(*region) for region in regions]))
        if self.light.round_by is None:
            return LargestShare(held, refracted, by, estimated=estimated)
        images = [images_in_common(self.light.round_by, *self._arc(*region)) for region in regions]
        return LargestShare(held, refracted, by, most * float(self._lamps.mean(images)), estimated)

    def _refracted(
        self, receiver: PosedReceiver, corners: Float[np.ndarray, "m n 3"], pixels: Bool[np.ndarray, "h w"]
    ) -> float:
        """Largest share of one lamp in a region of a receiver as it is seen from that lamp."""
        rays = self.light.rays
        axis, half_rad = cone_around(corners, pixels)
        turns = np.arccos(np.clip(rays.directions @ axis, -1.0, 1.0)) - half_rad - self._parallax_rad(receiver, corners)
        held = self._may_come_along_y(receiver, *_around(corners, pixels))
        passed = (rays.flux * held) @ self.light.best_transmittances(turns)
        return float(passed / rays.flux.sum())

    @cached_property
    def _drawn(self) -> DrawnBall | None:
        """The space of a lens that keeps directions along y; None for others, and where something behind turns them."""
        free = not (self.light.media.bodies or self.light.media.scattering)
        return self.space if isinstance(self.space, DrawnBall) and free else None

    def _may_come_along_y(
        self, receiver: PosedReceiver, places: Float[np.ndarray, "k 3"], cell: float
    ) -> Bool[np.ndarray, " n"]:
        """Mask of the rays that a lens drawn along y may send among ``places``, which cells of the size ``cell`` join.

        It keeps n d_y of each ray. On its way
        through the air from the section to the places a ray moves on along y by at least their distance times the
        tangent of its angle with the plane y = const.
        """
        rays = self.light.rays
        if self._drawn is None:
            return np.ones(len(rays), dtype=bool)
        media = self.light.media
        along = rays.directions[:, 1] * media.cavity_index / media.outside_index
        low = places[:, 1].min() - cell
        high = places[:, 1].max() + cell
        if receiver.is_far:
            return np.asarray((low <= along) & (along <= high))
        near_mm = max(np.hypot(places[:, 0], places[:, 2]).min() - cell - self._drawn.section_mm, 0.0)
        moves_mm = near_mm * along / np.sqrt(np.maximum(1.0 - along**2, np.finfo(float).tiny))
        least = rays.origins[:, 1] + moves_mm
        return np.asarray(np.where(along > 0.0, least <= high, least >= low))

    def beside_axis(self, pixels: Region) -> bool:
        """True for a region to one side of the axis of a lens whose faces are of revolution, as each lamp sees it."""
        if self.light.round_by is None or self.receiver.lamps.period_mm is not None or not pixels.any():
            return False
        arcs = zip(self._lamps.receivers, self._corners, self._lamps.regions(pixels > 0.0), strict=True)
        return all(self._arc(*arc)[1] < 0.5 * np.pi for arc in arcs)

    def _arc(
        self, receiver: PosedReceiver, corners: Float[np.ndarray, "m n 3"], pixels: Bool[np.ndarray, "h w"]
    ) -> tuple[float, float]:
        """Middle and half width (rad) of the azimuths of rays that reach a region.

        A ray from ``r`` beside the axis that lands ``d`` beside it comes from an azimuth up to asin(r/d) aside.
        """
        places, diagonal = _around(corners, pixels)
        x, y, _ = places.T
        near = float(np.hypot(x, y).min() - diagonal)
        from_mm = 0.0 if receiver.is_far else self._exit.radius_mm
        if near <= from_mm:
            return 0.0, np.pi
        middle, half = shortest_arc(np.arctan2(y, x))
        return middle, half + float(np.arcsin(from_mm / near))

    def weighted(self, of: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]) -> float:
        """Largest sum of shares by the weight ``of`` the middles of pixels: the integral of the share above each."""
        middles = replace(self.receiver, grid=self.receiver.grid.finer(2)).corners()[1::2, 1::2]
        weights = of(middles.reshape(-1, 3)).reshape(middles.shape[:2])
        step = float(weights.max()) / _LAYERS
        bound = 0.0
        joint = 1.0
        for layer in range(_LAYERS):
            region = weights > layer * step
            joint = self.in_region(region).value if layer % _JOINT == 0 else joint
            bound += step * min(joint, self.by_etendue(region))
        return bound

    def in_window(self) -> LargestShare:
        """Largest share in the receiver's window, which may be wider than its pixels."""
        window = self.receiver.window
        grid = self.receiver.grid
        width = min(window.width, 2.0 * window.radius)
        height = min(window.height, 2.0 * window.radius)
        whole = replace(self.receiver, grid=replace(grid, width=width, height=height))
        cells = window.pixels(whole.grid.finer(_WINDOW_SUBPIXELS))
        cells = cells.reshape(grid.rows, _WINDOW_SUBPIXELS, grid.columns, _WINDOW_SUBPIXELS)
        physics = self if whole == self.receiver else replace(self, receiver=whole)
        return physics.in_region(cells.mean(axis=(1, 3)))

    def least_nmse(self, target: Image, in_target: Region, arriving: float) -> float:
        """Lower bound of the NMSE of a pattern that holds the share ``arriving`` of the source's flux.

        ``target``: with sum 1. Of all patterns that keep the bound of each pixel and that of the region ``in_target``
        the nearest one: the target raised by one level inside the region, by another one outside, cut at the bounds.
        """
        if not arriving > 0.0:
            return 0.0
        caps = self.on_pixels / arriving
        most = self.in_region(in_target).value / arriving
        if (target <= caps).all() and target[in_target].sum() <= most:
            return 0.0  # the target itself is possible
        nearest = _filled(target, caps, 1.0)
        if nearest[in_target].sum() > most:
            nearest = target.copy()
            nearest[in_target] = _filled(target[in_target], caps[in_target], most)
            nearest[~in_target] = _filled(target[~in_target], caps[~in_target], 1.0 - most)
        return float(np.sum((nearest - target) ** 2) / np.sum(target**2))

    def _parallax_rad(self, receiver: PosedReceiver, corners: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, " n"]:
        """Most by which a point of a receiver lies off its direction from the origin, seen from where light leaves.

        Of a mirror, by which light that need not turn goes straight on, seen along each ray.
        """
        if receiver.is_far:
            return np.zeros(1)
        nearest_mm = float(np.linalg.norm(corners, axis=-1).min())
        if receiver.is_flat:  # between the corners it may be nearer
            nearest_mm = abs(float(np.dot(receiver.pose.axis, receiver.pose.origin_mm)))
        off_mm = np.array([self._exit.radius_mm])
        if self.light.media.exit_mirror is not None:
            glass = self.light.media.cover_glass
            off_mm = np.linalg.norm(np.cross(self.light.rays.origins, self.light.rays.directions), axis=1)
            off_mm += 0.0 if glass is None else glass.thickness_mm
        return np.asarray(np.arcsin(np.minimum(1.0, off_mm / nearest_mm)))


def _around(
    corners: Float[np.ndarray, "m n 3"], pixels: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "k 3"], float]:
    """The corners of ``pixels``, and the largest diagonal of one."""
    used = np.zeros(corners.shape[:2], dtype=bool)
    for rows, columns in ((slice(-1), slice(-1)), (slice(-1), slice(1, None)), (slice(1, None), slice(-1))):
        used[rows, columns] |= pixels
    used[1:, 1:] |= pixels
    diagonal = np.linalg.norm(corners[1:, 1:] - corners[:-1, :-1], axis=-1)[pixels].max()
    return corners[used], float(diagonal)


def _filled(target: Float[np.ndarray, "*n"], caps: Float[np.ndarray, "*n"], total: float) -> Float[np.ndarray, "*n"]:
    """``target`` plus one level, cut at 0 and at ``caps``, with the sum ``total``; ``caps`` where theirs is less."""
    if not target.size:
        return target
    low = -float(target.max())
    high = float(np.max(caps - target))
    if not np.isfinite(high):
        high = total
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.clip(target + middle, 0.0, caps).sum() < total else (low, middle)
    return np.clip(target + high, 0.0, caps)
