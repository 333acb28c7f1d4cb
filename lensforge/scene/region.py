"""Regions of a receiver in which flux is counted by ray: a target, and the zone of a limit on its share."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver
from lensforge.spec.light_limits import ZoneLimit

_OVERSAMPLING = 8  # sub-pixels per side: a share of a pixel is right to 1/64


@runtime_checkable
class Region(Protocol):
    """A part of a receiver. ``coverage``: share of each pixel of ``grid`` that lies in it."""

    @property
    def grid(self) -> PixelGrid:
        """Pixels of the receiver."""
        ...

    @property
    def coverage(self) -> Float[np.ndarray, "h w"]:
        """Share of each pixel's area that is in it."""
        ...

    def contains(self, hits: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """True for hits in it."""
        ...


@dataclass(frozen=True, eq=False)
class ZoneOfLimit:
    """The zone of a ``limit`` on ``receiver``, within its window; without a shape all of that."""

    limit: ZoneLimit
    receiver: PosedReceiver

    @property
    def grid(self) -> PixelGrid:
        """Pixels of the receiver."""
        return self.receiver.grid

    def contains(self, hits: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """True for hits in the zone, exactly."""
        inside = self.receiver.window.contains(hits)
        zone = self.limit.zone
        if zone is None:
            return inside
        return np.asarray(inside & zone.contains(*zone.about_centre(*self.receiver.target_coordinates(*hits.T))))

    @cached_property
    def coverage(self) -> Float[np.ndarray, "h w"]:
        """Share of each pixel's area that is in the zone."""
        fine = self.grid.finer(_OVERSAMPLING)
        (rows, columns) = self.grid.shape
        places = np.stack(np.meshgrid(fine.x(), fine.y()), axis=-1).reshape(-1, 2)
        inside = self.contains(places).reshape(rows, _OVERSAMPLING, columns, _OVERSAMPLING)
        return np.asarray(inside.mean(axis=(1, 3)))
