"""Étendue of a source: how much of its flux a given étendue can hold.

No optics raises radiance, so that an étendue G holds at most the flux of the brightest light that adds up to G. Where
the radiance of an emitter is known, a ray stands for the étendue ``flux / radiance``. Otherwise it is estimated. Rays
are points of phase space: where their lines cross a plane z = const, and their direction cosines along x and y, in
which an element of étendue is ``dx dy dp dq``. The sample is divided at medians into cells of equally many rays; flux
over volume is the radiance there, to the noise of 32 rays and as the mean over the cell.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from lensforge.sources.bundle import ChangedSource, RayBundle, Source

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
    from cells of rays, not from known radiances.
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
        volume, flux = np.zeros(1), np.array([rays.flux[np.abs(rise) <= _LEVEL].sum()])
        for side in (rise > _LEVEL, rise < -_LEVEL):
            own_volume, own_flux = _cells(rays, side)
            volume, flux = np.concatenate([volume, own_volume]), np.concatenate([flux, own_flux])
        return _curve(volume, flux, estimated=True)

    def share_within(self, etendue_mm2_sr: float) -> float:
        """Largest share of the flux that fits into ``etendue_mm2_sr``."""
        return float(np.interp(etendue_mm2_sr, self.etendue_mm2_sr, self.share))

    def shares_within(self, etendue_mm2_sr: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The same for each of many."""
        shares: Float[np.ndarray, "*n"] = np.interp(etendue_mm2_sr, self.etendue_mm2_sr, self.share)
        return shares


def _curve(volume: Float[np.ndarray, " c"], flux: Float[np.ndarray, " c"], *, estimated: bool) -> EtendueCurve:
    """The curve of cells of étendue ``volume``, each with its flux."""
    without_extent = volume <= 0.0
    extended, found = volume[~without_extent], flux[~without_extent]
    order = np.argsort(extended / np.where(found > 0.0, found, np.finfo(float).tiny))
    first, total = flux[without_extent].sum(), flux.sum()
    share = np.concatenate([[first], first + np.cumsum(found[order])]) / total
    return EtendueCurve(np.concatenate([[0.0], np.cumsum(extended[order])]), share, estimated)


def _cells(rays: RayBundle, chosen: Bool[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Étendue and flux of cells of the ``chosen`` rays, all on one side of the horizon; 0 where they are too few."""
    count, flux = int(chosen.sum()), rays.flux[chosen]
    levels = int(np.log2(max(count / _RAYS_PER_CELL, 1.0)))
    if count < 2 * _RAYS_PER_CELL:
        return np.zeros(1), np.array([flux.sum()])
    points = _phase_space(rays.origins[chosen], rays.directions[chosen], flux)
    each = count >> levels
    left_over = flux[each << levels :].sum()  # fewer than there are cells: spread over them
    members, extent = np.arange(each << levels)[None, :], np.ptp(points, axis=0)
    scale = np.where(extent > 0.0, extent, 1.0)
    for _ in range(levels):
        widest = (np.ptp(points[members], axis=1) / scale).argmax(axis=1)
        order = np.argsort(points[members, widest[:, None]], axis=1)
        members = np.take_along_axis(members, order, axis=1).reshape(2 * len(members), -1)
    # the box of m uniform points is smaller than their cell by (m - 1)/(m + 1) along each side
    volume = np.prod(np.ptp(points[members], axis=1) * (each + 1) / (each - 1), axis=1)
    shares = flux[members].sum(axis=1)
    return volume, shares * (1.0 + left_over / max(float(shares.sum()), np.finfo(float).tiny))


def _phase_space(
    origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], flux: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 4"]:
    """Crossings (mm) of the rays' lines with the plane in which they lie closest together, and direction cosines."""
    slopes = directions[:, :2] / directions[:, 2:]
    crossings = origins[:, :2] - origins[:, 2:] * slopes
    weights = (flux * directions[:, 2] ** 4)[:, None]  # rays near the horizon cross every plane far out
    total = max(float(weights.sum()), np.finfo(float).tiny)
    apart, turned = (each - (weights * each).sum(axis=0) / total for each in (crossings, slopes))
    spread = float((weights * turned**2).sum())
    z_mm = 0.0 if spread == 0.0 else -float((weights * apart * turned).sum()) / spread
    return np.concatenate([crossings + z_mm * slopes, directions[:, :2]], axis=1)
