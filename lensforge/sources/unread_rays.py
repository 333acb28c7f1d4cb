"""Rays that are too many for the memory: chosen, joined and changed without being read, until some are taken."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from jaxtyping import Int

from lensforge.sources.blocks import block_slices, total_of
from lensforge.sources.bundle import RayBundle, Rays


@dataclass(frozen=True, eq=False)
class ChangedRays:
    """``rays``, each changed by ``change``, which treats every ray by itself."""

    rays: Rays
    change: Callable[[RayBundle], RayBundle]

    def __len__(self) -> int:
        return len(self.rays)

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Read some of the rays, and change them."""
        return self.change(self.rays.take(rows))


@dataclass(frozen=True, eq=False)
class ChosenRays:
    """Rays with the ``numbers`` among ``rays``, in that order."""

    rays: Rays
    numbers: Int[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.numbers)

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Read some of the chosen rays."""
        return self.rays.take(self.numbers[rows].astype(np.int64))


@dataclass(frozen=True, eq=False)
class JoinedRays:
    """The rays of all ``parts``, one part after the other; what is of each ray, all parts have, or none."""

    parts: Sequence[Rays]

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Read some of the rays, each from its part."""
        if isinstance(rows, slice):
            rows = np.arange(*rows.indices(len(self)))
        starts = accumulate(map(len, self.parts), initial=0)
        found, places = [], []
        for part, start in zip(self.parts, starts, strict=False):  # the last start is the end
            own = np.flatnonzero((rows >= start) & (rows < start + len(part)))
            if len(own):
                found.append(part.take(rows[own] - start))
                places.append(own)
        return RayBundle.joined(found).take(np.argsort(np.concatenate(places)))


def number_type(count: int) -> type[np.int32] | type[np.int64]:
    """Type of the numbers of ``count`` rays: half the memory where that is enough."""
    return np.int32 if count < 2**31 else np.int64


def changed(rays: Rays, change: Callable[[RayBundle], RayBundle]) -> Rays:
    """Change rays, each by itself: at once where they are in memory."""
    return change(rays) if isinstance(rays, RayBundle) else ChangedRays(rays, change)


def chosen(rays: Rays, numbers: Int[np.ndarray, " n"]) -> Rays:
    """Choose rays by their numbers: at once where they are in memory."""
    if isinstance(rays, RayBundle):
        return rays.take(numbers)
    return ChosenRays(rays, numbers.astype(number_type(len(rays))))


def joined(parts: Sequence[Rays]) -> Rays:
    """Join rays: at once where all are in memory."""
    loaded = [part for part in parts if isinstance(part, RayBundle)]
    return RayBundle.joined(loaded) if len(loaded) == len(parts) else JoinedRays(parts)


def blocks_of(rays: Rays) -> Iterator[RayBundle]:
    """Yield all rays in their order: at once where they are in memory, else block by block."""
    if isinstance(rays, RayBundle):
        yield rays
    else:
        yield from (rays.take(some) for some in block_slices(len(rays)))


def total_flux(rays: Rays) -> float:
    """Sum of the fluxes (W), with the bits of the sum over all at once."""
    return total_of(len(rays), [float(block.flux.sum()) for block in blocks_of(rays)])


def with_flux(rays: Rays, flux_w: float) -> Rays:
    """Scale the flux of all rays alike, so that it adds up to ``flux_w`` (W)."""
    factor = flux_w / total_flux(rays)
    return changed(rays, lambda some: replace(some, flux=some.flux * factor))
