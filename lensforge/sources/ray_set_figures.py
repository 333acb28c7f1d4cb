"""Figures of all rays of a ray set, gathered block by block: their noise and focus, and where they start and go."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from lensforge.records import Point
from lensforge.sources.blocks import total_of
from lensforge.sources.bundle import RayBundle, Rays
from lensforge.sources.rayfiles.virtual_focus import FocusFit
from lensforge.sources.source_summary import as_point
from lensforge.sources.unread_rays import blocks_of


@dataclass(frozen=True)
class LightFigures:
    """Noise and focus of rays, wherever they are: ``effective_rays`` of equal flux would have the same noise.

    ``focus_mm``: their virtual focus, None where they are parallel.
    """

    effective_rays: float
    focus_mm: Point | None

    @staticmethod
    def of(rays: Rays) -> "LightFigures":
        """Gather them from all rays."""
        focus, sums, squares = FocusFit(), [], 0.0
        for block in blocks_of(rays):
            focus.add(block.origins, block.directions, block.flux)
            sums.append(block.flux.sum())
            squares += np.square(block.flux).sum()
        point = focus.point()
        return LightFigures(float(total_of(len(rays), sums) ** 2 / squares), None if point is None else as_point(point))


@dataclass(frozen=True)
class PlacedFigures:
    """Start points and directions in lens coordinates: the largest side (mm) of the box of the first, and flux.

    ``flux``: of all (W); ``backward``: towards -z; ``lost``: of that, what starts at z = 0 or below; ``below``: starts
    below z = 0.
    """

    side_mm: float
    flux: float
    backward: float
    lost: float
    below: float

    @staticmethod
    def of(rays: Rays) -> "PlacedFigures":
        """Gather them from all rays."""
        low, high, sums = np.full(3, np.inf), np.full(3, -np.inf), []
        for block in blocks_of(rays):
            for axis in range(3):
                low[axis] = min(low[axis], block.origins[:, axis].min())
                high[axis] = max(high[axis], block.origins[:, axis].max())
            sums.append([block.flux.sum(), *(block.flux[those].sum() for those in _groups(block))])
        flux, backward, lost, below = (float(total_of(len(rays), column)) for column in zip(*sums, strict=True))
        return PlacedFigures(float((high - low).max()), flux, backward, lost, below)


def _groups(rays: RayBundle) -> Iterator[Bool[np.ndarray, " n"]]:
    down, height = rays.directions[:, 2] < 0.0, rays.origins[:, 2]
    yield from (down, down & (height <= 0.0), height < 0.0)
