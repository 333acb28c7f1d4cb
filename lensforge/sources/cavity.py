"""The smallest cavity of usual proportions in which nearly all light of a ray set starts."""

import numpy as np

from lensforge.sources.build import build_source
from lensforge.sources.bundle import Source
from lensforge.spec.derived import CAVITY_HEIGHT, rounded_length
from lensforge.spec.source import SourceSpec

_RAYS, _SEED = 2**16, 0
_INSIDE = 0.99  # share of the flux; the rest is stray light from package and window
_ROOM = 1.05  # over the paraboloid that just holds it


def cavity_around(spec: SourceSpec) -> dict[str, float]:
    """Height and radius (mm) of the paraboloid inside which 99 % of the flux starts, as fields of the constraints.

    Raises :class:`InputError` for a file that cannot be used.
    """
    radius = cavity_radius(build_source(spec))
    return {
        "cavity_height_mm": rounded_length(CAVITY_HEIGHT * radius),
        "cavity_radius_mm": rounded_length(radius),
    }


def cavity_radius(source: Source) -> float:
    """Radius (mm) of that paraboloid at z = 0.

    A point (r, z) lies on the paraboloid z = h (1 - r^2/R^2) with h = c R where R = (z/c + sqrt((z/c)^2 + 4 r^2)) / 2.
    """
    rays = source.sample(min(_RAYS, source.ray_count or _RAYS), _SEED)
    x, y, z = rays.origins.T
    height = np.maximum(z, 0.0) / CAVITY_HEIGHT
    needed = 0.5 * (height + np.sqrt(height**2 + 4.0 * (x**2 + y**2)))
    order = np.argsort(needed)
    inside = np.cumsum(rays.flux[order]) / rays.flux.sum()
    return _ROOM * float(needed[order[min(int(np.searchsorted(inside, _INSIDE)), len(order) - 1)]])
