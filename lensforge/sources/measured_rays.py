"""A limited number of measured rays, to design a lens with: in two parts, and without the noise of their number.

A search that sees the same rays again and again fits a lens to their noise as well. Some are kept to judge it by. The
others are turned a little, anew in every sample, each about the point where it leaves the source: radiance varies
slowly with the angle there, but fast with the place.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.sources.bundle import ChangedSource, RayBundle, Source
from lensforge.sources.dispersion import DispersedSource
from lensforge.sources.ray_set import RaySetEmitter

# Standard deviation of a turn: as many rays as this within its area, 2 sigma^2 of the hemisphere. With 80,000 rays
# 2 to 4 degrees are alike, with 16,000 6 degrees are better than 3.
_RAYS_IN_TURN = 600.0
_MOST_TURN_RAD = 0.15  # that of 13,000 rays: larger turns have not been tried
_LEAST_RISE = 0.1  # of a direction relative to the source's plane: flatter rays would cross it far away, and stay


def divided(source: Source, fraction: float, seed: int) -> tuple[Source, Source]:
    """Two sources of the same flux with different rays: ``fraction`` of those of a measured one, and the rest.

    A source that draws new rays with every seed is returned as it is, twice. Raises :class:`InputError` for so few rays
    that one part would be empty.
    """
    if source.ray_count is None:
        return source, source
    if isinstance(source, DispersedSource):
        first, second = divided(source.source, fraction, seed)
        return replace(source, source=first), replace(source, source=second)
    return _ray_set(source, seed).split(fraction, seed)


def smoothed(source: Source) -> Source:
    """``source`` with its rays turned by small random angles; as it is where it draws new rays with every seed."""
    if source.ray_count is None:
        return source
    if isinstance(source, DispersedSource):
        return replace(source, source=smoothed(source.source))
    sigma_rad = min(float(np.sqrt(0.5 * _RAYS_IN_TURN / source.ray_count)), _MOST_TURN_RAD)
    return TurnedRays(_ray_set(source, 0), sigma_rad)


def _ray_set(source: Source, seed: int) -> RaySetEmitter:
    if isinstance(source, RaySetEmitter):
        return source
    assert source.ray_count is not None
    return RaySetEmitter(source.sample(source.ray_count, seed), source.flux_w, symmetry=source.symmetry)


@dataclass(frozen=True, eq=False)
class TurnedRays(ChangedSource):
    """Rays of ``source``, each turned about its point in the source's plane by ``sigma_rad`` in two directions."""

    source: RaySetEmitter
    sigma_rad: float

    @property
    def ray_count(self) -> int | None:
        """None: every sample is another one."""
        return None

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw rays of the source itself, and turn them; each starts as far from the plane as it did."""
        rays, pose = self.source.sample(count, seed), self.source.pose
        turns = self.sigma_rad * np.random.default_rng(seed).standard_normal((count, 3))
        if pose is None:
            origins, directions = _turned(rays.origins, rays.directions, turns)
        else:
            own = pose.own_points(rays.origins), pose.own_directions(rays.directions)
            origins, directions = _turned(*own, turns)
            origins, directions = pose.points(origins), pose.directions(directions)
        return replace(rays, origins=origins, directions=directions)


def _turned(
    origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], turns: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Rays with ``turns`` added to their directions, about their crossings of z = 0 and from the same heights."""
    turned = directions + turns
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    rise, turned_rise = directions[:, 2], turned[:, 2]
    steep = (np.abs(rise) > _LEAST_RISE) & (turned_rise * np.sign(rise) > 0.5 * _LEAST_RISE)
    crossings = origins - origins[:, 2:] / np.where(steep, rise, 1.0)[:, None] * directions
    moved = crossings + origins[:, 2:] / np.where(steep, turned_rise, 1.0)[:, None] * turned
    keep = ~steep[:, None]
    return np.where(keep, origins, moved), np.where(keep, directions, turned)
