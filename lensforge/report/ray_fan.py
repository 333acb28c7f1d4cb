"""A few rays through the exact surfaces, only for drawing a section.

The lens has no symmetry, so rays that start in a section leave it; their projection is drawn.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.light.exact_trace import DenseScan, exact_surfaces
from lensforge.light.sequential_trace import TracedSurface
from lensforge.optics.dielectric import refract, transmitted_cosine_squared
from lensforge.scene.lens import Lens

_STEPS = 192  # of the search for a first crossing: far finer than a lens's features
_CAVITY_MM = 1e-9  # a point is in the cavity from this depth on

Points = Float[np.ndarray, "n 3"]


def trace_fan(lens: Lens, start_mm: Points, directions: Points, reach_mm: float) -> Float[np.ndarray, "n 4 3"]:
    """Start, both surfaces' hits, and a point at ``reach_mm`` from the origin; NaN after the end of a ray.

    A ray ends where it meets z = 0, re-enters the cavity, or is totally reflected. One that starts below z = 0 must
    pass that plane inside the cavity; directions are upwards.
    """
    scan, media = DenseScan(_STEPS, reach_mm=2.0 * reach_mm), lens.media
    inner, outer = exact_surfaces(lens, (scan, scan))
    start, along = torch.from_numpy(start_mm), torch.from_numpy(directions)
    entry = start + torch.clamp(-start[:, 2:] / along[:, 2:], min=0.0) * along
    entry[inner.gap(entry) <= 0.0] = torch.nan
    at_inner, inside = _crossed(inner, entry, along, media.cavity_index / media.refractive_index)
    at_outer, behind = _crossed(outer, at_inner, inside, media.refractive_index / media.outside_index)
    at_outer[_returns(inner, at_inner, at_outer)] = torch.nan
    path = torch.stack([start, at_inner, at_outer, _at_distance(at_outer, behind, reach_mm)], dim=1)
    return path.numpy()


def _crossed(surface: TracedSurface, origins: Tensor, directions: Tensor, ratio: float) -> tuple[Tensor, Tensor]:
    """First crossings at z >= 0, and the directions behind them; NaN where there is none.

    ``ratio``: index before over index behind.
    """
    points, behind = torch.full_like(origins, torch.nan), torch.full_like(origins, torch.nan)
    alive = torch.nonzero(~(origins + directions).isnan().any(dim=1))[:, 0]
    crossing = surface.first_crossing(origins[alive], directions[alive])
    hits = origins[alive] + crossing.lengths[:, None] * directions[alive]
    met = crossing.found & (hits[:, 2] >= 0.0)
    alive, hits = alive[met], hits[met]
    points[alive] = hits
    normals = torch.nn.functional.normalize(surface.normal(hits), dim=1)
    passes = transmitted_cosine_squared(torch.sum(directions[alive] * normals, dim=1), ratio) > 0.0
    behind[alive[passes]] = refract(directions[alive[passes]], normals[passes], ratio)
    return points, behind


def _returns(cavity: TracedSurface, start: Tensor, end: Tensor) -> Bool[Tensor, " n"]:
    """True where the segment from ``start`` on the cavity to ``end`` enters the cavity again."""
    share = torch.linspace(0.0, 1.0, _STEPS, dtype=start.dtype)[1:, None]
    points = (start[:, None] + share * (end - start)[:, None]).reshape(-1, 3)
    return (cavity.gap(points) > _CAVITY_MM).reshape(len(start), -1).any(dim=1)


def _at_distance(points: Tensor, directions: Tensor, reach_mm: float) -> Tensor:
    """Points where rays leave the sphere of ``reach_mm`` around the origin."""
    along = torch.sum(points * directions, dim=1)
    length = torch.sqrt(along**2 + reach_mm**2 - torch.sum(points**2, dim=1)) - along
    return points + length[:, None] * directions
