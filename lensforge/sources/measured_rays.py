"""A limited number of measured rays to design with: divided into two parts, and smoothed.

A search that sees the same rays again and again fits a lens to their noise as well, so all figures of the finished lens
are those of rays that are held back from every search. The others are turned a little, anew in every sample, each about
the point where it leaves the source: radiance varies slowly with the angle there, but fast with the place.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.sources.dispersion import ColouredSource
from lensforge.sources.ray_bundle import ChangedSource, RayBundle, Source, aimed
from lensforge.sources.several_sources import SeveralSources

if TYPE_CHECKING:
    from lensforge.sources.ray_set import RaySetEmitter

# Standard deviation of a turn: as many rays as this within its area, 2 sigma^2 of the hemisphere. With 80,000 rays
# 2 to 4 degrees are alike, with 16,000 6 degrees are better than 3.
_RAYS_IN_TURN = 600.0
_MOST_TURN_RAD = 0.15  # that of 13,000 rays: larger turns have not been tried
# Three tenths are held back, and of a large file all but the most that a step of any accuracy takes. Drafts of
# led_rayfile, by a million other rays: of 30,000 rays with 0.2, 0.3, 0.5 held back an NMSE of 0.0141, 0.0136, 0.0141,
# told to 0.005, 0.004, 0.002; of 100,000 with 0.1, 0.2, 0.3, 0.5 one of 0.0134, 0.0132, 0.0129, 0.0138, told to 0.003,
# 0.0013, 0.001, 0.0007; of a million 0.0128 to 0.0141, without a trend.
_SEARCHED = 0.7
_MOST_SEARCHED = 2**20
_LEAST_RAYS = 54  # of which 16 are held back, one for each replicate of an evaluation
_LEAST_RISE = 0.1  # of a direction relative to the source's plane: flatter rays would cross it far away, and stay


@runtime_checkable
class RefittedSource(Source, Protocol):
    """A source whose rays are drawn by a model of those of a ``file``."""

    @property
    def file(self) -> Source:
        """The rays of the file."""

    @property
    def held_back(self) -> Source:
        """Rays of the file unseen by any fit."""

    def refitted(self, seed: int) -> Source:
        """A model of rays redrawn from the file with replacement."""


def divided(source: Source, fraction: float, seed: int) -> tuple[Source, Source]:
    """Two sources of the same flux with different rays: ``fraction`` of those of a measured one, and the rest.

    A source that draws new rays with every seed is returned twice, unchanged. Raises :class:`InputError` if one part
    would be empty.
    """
    if source.ray_count is None:
        return source, source
    if isinstance(source, ColouredSource):
        first, second = divided(source.source, fraction, seed)
        return replace(source, source=first), replace(source, source=second)
    return _ray_set(source, seed).split(fraction, seed)


def rays_of_file(source: Source) -> Source:
    """The rays of the file behind a modelled source; any other source unchanged."""
    return source.file if isinstance(source, RefittedSource) else source


def searched(source: Source) -> Source:
    """Rays of a measured source for searches; any other source unchanged."""
    return _parts(source)[0]


def held_back(source: Source) -> Source:
    """Rays of a measured source that no search uses, to judge its lens; any other source unchanged."""
    return _parts(source)[1]


def _parts(source: Source) -> tuple[Source, Source]:
    """Rays for searches, and rays for judging: divided alike for every seed, as a search may start from any lens."""
    if isinstance(source, SeveralSources):
        return source.changed(searched), source.changed(held_back)
    count = source.ray_count
    if count is None:
        return source, source
    if count < _LEAST_RAYS:
        raise InputError(f"source: {count} rays are too few to hold three tenths back: at least {_LEAST_RAYS}")
    return divided(source, min(_SEARCHED, _MOST_SEARCHED / count), seeds.OF_FILE)


def smoothed(source: Source) -> Source:
    """``source`` with its rays turned by small random angles; unchanged if it draws new rays with every seed."""
    if source.ray_count is None:
        return source
    if isinstance(source, SeveralSources):
        return source.changed(smoothed)
    if isinstance(source, ColouredSource):
        return replace(source, source=smoothed(source.source))
    sigma_rad = min(float(np.sqrt(0.5 * _RAYS_IN_TURN / source.ray_count)), _MOST_TURN_RAD)
    return TurnedRays(_ray_set(source, 0), sigma_rad)


def _ray_set(source: Source, seed: int) -> "RaySetEmitter":
    from lensforge.sources.ray_set import RaySetEmitter  # other sources do without it

    if isinstance(source, RaySetEmitter):
        return source
    assert source.ray_count is not None
    return RaySetEmitter(source.sample(source.ray_count, seed), source.flux_w, symmetry=source.symmetry)


@dataclass(frozen=True, eq=False)
class TurnedRays(ChangedSource):
    """Rays of ``source``, each turned about its point in the source's plane by ``sigma_rad`` in two directions."""

    source: "RaySetEmitter"
    sigma_rad: float

    @property
    def ray_count(self) -> int | None:
        """None: every sample is new."""
        return None

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw rays of the source and turn them; each starts at its original height above the plane."""
        rays = self.source.sample(count, seed)
        pose = self.source.pose
        turns = self.sigma_rad * np.random.default_rng(seed).standard_normal((count, 3))
        return _turned(rays.seen_from(pose), turns).placed(pose)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of a sample, each turned from its point in the source's plane to its target (mm), in W/sr there.

        A direction to which normal numbers of deviation ``sigma`` are added has, at an angle of cosine c, the density
        ``(1 + c^2/sigma^2) / (2 pi) exp(-(1 - c^2) / (2 sigma^2))`` per sr, but for ``exp(-1 / (2 sigma^2))``.
        """
        rays = self.source.sample(len(targets), seed)
        pose = self.source.pose
        variance = self.sigma_rad**2
        local_rays = rays.seen_from(pose)
        along = local_rays.directions
        rise = local_rays.directions[:, 2:]
        steep = np.abs(rise) > _LEAST_RISE
        crossings = np.where(
            steep,
            local_rays.origins - local_rays.origins[:, 2:] / np.where(steep, rise, 1.0) * along,
            local_rays.origins,
        )

        def density(turned: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
            square = np.maximum((turned * along).sum(axis=1), 0.0) ** 2
            lobe: Float[np.ndarray, " n"] = (1.0 + square / variance) * np.exp((square - 1.0) / (2.0 * variance))
            return lobe / (2.0 * np.pi)

        start = replace(local_rays, origins=crossings)
        return aimed(start, pose.to_local_points(targets), density).placed(pose)


def _turned(rays: RayBundle, turns: Float[np.ndarray, "n 3"]) -> RayBundle:
    """Rays with ``turns`` added to their directions, about their crossings of z = 0 and from the same heights."""
    origins = rays.origins
    directions = rays.directions
    turned = directions + turns
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    rise = directions[:, 2]
    turned_rise = turned[:, 2]
    steep = (np.abs(rise) > _LEAST_RISE) & (turned_rise * np.sign(rise) > 0.5 * _LEAST_RISE)
    crossings = origins - origins[:, 2:] / np.where(steep, rise, 1.0)[:, None] * directions
    moved = crossings + origins[:, 2:] / np.where(steep, turned_rise, 1.0)[:, None] * turned
    keep = ~steep[:, None]
    return replace(rays, origins=np.where(keep, origins, moved), directions=np.where(keep, directions, turned))
