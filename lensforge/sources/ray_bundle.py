"""Rays as they leave a source, and the interface of every source.

Rays that exceed the memory are chosen, joined and changed without being read, until some are taken. Sums over blocks of
a long series do not depend on the way it is read.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.errors import InputError
from lensforge.optics.media import Wavelengths
from lensforge.optics.pose import Pose

BLOCK_RAYS = 2**18  # rays handled at a time: bounds the memory whatever their number


def block_slices(count: int, start: int = 0) -> Iterator[slice]:
    """Yield consecutive parts of ``count`` numbers, halved repeatedly where NumPy's pairwise sum halves them."""
    if count <= BLOCK_RAYS:
        yield slice(start, start + count)
        return
    first = _first_half(count)
    yield from block_slices(first, start)
    yield from block_slices(count - first, start + first)


def total_of(count: int, sums: Sequence[float]) -> float:
    """Total of the sums over the :func:`block_slices` of ``count`` numbers, as ``np.sum`` of all at once gives it.

    A single sum is the total.
    """
    return sums[0] if len(sums) == 1 else _pairwise(count, iter(sums))


def _pairwise(count: int, sums: Iterator[float]) -> float:
    if count <= BLOCK_RAYS:
        return next(sums)
    first = _first_half(count)
    total = _pairwise(first, sums)
    return total + _pairwise(count - first, sums)


def _first_half(count: int) -> int:
    return count // 2 - count // 2 % 8


@dataclass(frozen=True)
class RayBundle:
    """Rays: start points ``origins`` (mm), unit directions, and the flux each carries (W). NumPy, float64.

    ``waves``: wavelength of each, at which media have their index; None if irrelevant or unknown. ``of_source``: number
    of each ray's LED, if a lens is for several. ``tristimulus``: X, Y, Z (lm) per W of each; None without colour.
    ``facets``: two random numbers in [0, 1) of each ray for every rough face; None without.
    """

    origins: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    waves: Wavelengths | None = None
    of_source: Int[np.ndarray, " n"] | None = None
    tristimulus: Float[np.ndarray, "n 3"] | None = None
    facets: Float[np.ndarray, "n m"] | None = None

    def __len__(self) -> int:
        return len(self.flux)

    @property
    def wavelengths_nm(self) -> Float[np.ndarray, " n"] | None:
        """Wavelength (nm) of each ray; None if irrelevant."""
        return None if self.waves is None else self.waves.nm

    @property
    def colours(self) -> Float[np.ndarray, "n 3"]:
        """X, Y, Z (lm) per W of each. Raises ``ValueError`` for rays of a source that was built without them."""
        if self.tristimulus is None:
            raise ValueError("rays without colours: build their source with them")
        return self.tristimulus

    def with_wavelengths(self, wavelengths_nm: Float[np.ndarray, " n"] | None) -> "RayBundle":
        """The rays with these wavelengths (nm), or with none."""
        return replace(self, waves=None if wavelengths_nm is None else Wavelengths(wavelengths_nm))

    def take(self, rows: Int[np.ndarray, " k"] | Bool[np.ndarray, " n"] | slice) -> "RayBundle":
        """Select some of the rays."""
        waves = None if self.waves is None else self.waves.take(rows)
        numbers = None if self.of_source is None else self.of_source[rows]
        colours = None if self.tristimulus is None else self.tristimulus[rows]
        facets = None if self.facets is None else self.facets[rows]
        return RayBundle(self.origins[rows], self.directions[rows], self.flux[rows], waves, numbers, colours, facets)

    def placed(self, pose: Pose) -> "RayBundle":
        """Transform rays from local to parent coordinates."""
        if not pose.moves:
            return self
        return replace(self, origins=pose.points(self.origins), directions=pose.directions(self.directions))

    def seen_from(self, pose: Pose) -> "RayBundle":
        """Transform rays from parent to local coordinates."""
        if not pose.moves:
            return self
        return replace(
            self, origins=pose.to_local_points(self.origins), directions=pose.to_local_directions(self.directions)
        )

    def divided(self, parts: int) -> list["RayBundle"]:
        """Consecutive parts: parts of a low-discrepancy sample are such samples themselves."""
        edges = np.linspace(0, len(self), parts + 1).astype(int)
        return [self.take(slice(start, stop)) for start, stop in pairwise(edges)]

    @classmethod
    def joined(cls, parts: Sequence["RayBundle"]) -> "RayBundle":
        """Join the rays of all parts in their order.

        Raises ``ValueError`` if only some parts have wavelengths, numbers or colours.
        """
        rays = cls(**{name: _joined(name, [getattr(part, name) for part in parts]) for name in _ARRAYS})
        return rays.with_wavelengths(_joined("wavelengths_nm", [part.wavelengths_nm for part in parts]))


_ARRAYS = ("origins", "directions", "flux", "of_source", "tristimulus", "facets")


def _joined(name: str, columns: Sequence[np.ndarray | None]) -> Any:
    given = [column for column in columns if column is not None]
    if 0 < len(given) < len(columns):
        raise ValueError(f"{name}: {len(given)} of {len(columns)} bundles of rays have them; all must, or none")
    return np.concatenate(given) if given else None


@runtime_checkable
class Rays(Protocol):
    """Rays in their order, in memory as a :class:`RayBundle` or read from a file when they are taken."""

    def __len__(self) -> int: ...

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Select rays by row; a slice has no step."""
        ...


@runtime_checkable
class Source(Protocol):
    """An emitter in lens coordinates: the lens axis is +z, the cavity opens at z = 0."""

    @property
    def flux_w(self) -> float:
        """Total flux (W) of every sample, so that efficiencies have one denominator."""
        ...

    @property
    def symmetry(self) -> str:
        """Largest mirror group (a name of ``surfaces.mirror_group``) that leaves the emission unchanged."""
        ...

    @property
    def ray_count(self) -> int | None:
        """Number of distinct rays of a measured source; None if a sample may be of any size."""
        ...

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays whose flux adds up to ``flux_w``; the same seed gives the same rays."""
        ...

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Closed polygon (mm) around the emitting area, for drawings to scale."""
        ...


@runtime_checkable
class DirectionalSource(Protocol):
    """A source whose light into any direction is known."""

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of ``sample(len(targets), seed)``, each turned to its target (mm); their flux is W/sr there."""
        ...


def towards(source: Source, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
    """Rays of ``source.towards(targets, seed)``. Raises :class:`InputError` for a source that does not have them."""
    if not isinstance(source, DirectionalSource):
        raise InputError(f"{type(source).__name__}: the light into a direction is not known; turn its rays a little")
    return source.towards(targets, seed)


def aims(source: Source) -> bool:
    """True for a source whose light into any direction is known."""
    try:
        towards(source, np.array([[0.0, 0.0, 1.0]]), 0)
    except InputError:
        return False
    return True


def aimed(
    rays: RayBundle,
    targets: Float[np.ndarray, "n 3"],
    intensity: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]],
) -> RayBundle:
    """Turn each ray to its target; ``intensity``: share (1/sr) of the flux from its point into unit directions."""
    away = targets - rays.origins
    along = away / np.linalg.norm(away, axis=1, keepdims=True)
    return replace(rays, directions=along, flux=rays.flux * intensity(along))


@runtime_checkable
class LazySource(Protocol):
    """A source that can name the rays of a large sample before it reads them."""

    def drawn(self, count: int, seed: int) -> Rays:
        """The rays of ``sample(count, seed)``, at most those that the source has."""
        ...


def drawn(source: Source, count: int, seed: int) -> Rays:
    """The rays of ``source.sample(count, seed)``, at most all; those of a large file are read when they are taken."""
    return source.drawn(count, seed) if isinstance(source, LazySource) else source.sample(count, seed)


@dataclass(frozen=True, eq=False)
class ChangedSource:
    """``source`` with changed rays; everything else is delegated unless a subclass overrides it.

    Subclasses define the change.
    """

    source: Source

    def changed_rays(self, rays: RayBundle, seed: int) -> RayBundle:
        """Change the rays that ``source`` has drawn by ``seed``."""
        raise NotImplementedError

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw the rays of the source, and change them."""
        return self.changed_rays(self.source.sample(count, seed), seed)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of a sample, each turned to its target (mm); their flux is W/sr there."""
        return self.changed_rays(towards(self.source, targets, seed), seed)

    @property
    def flux_w(self) -> float:
        """Flux (W) of the source itself."""
        return self.source.flux_w

    @property
    def symmetry(self) -> str:
        """Symmetry of the source itself."""
        return self.source.symmetry

    @property
    def is_round(self) -> bool:
        """True if the source is known to be of revolution."""
        return is_round(self.source)

    @property
    def ray_count(self) -> int | None:
        """Number of distinct rays of the source itself."""
        return self.source.ray_count

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline (mm) of the source itself."""
        return self.source.outline()


def is_round(source: Source) -> bool:
    """True for a source known to be of revolution about the axis."""
    known = getattr(source, "is_round", False)
    return bool(known)


@dataclass(frozen=True, eq=False)
class LazyRays:
    """The rays of all ``parts`` in turn, read and changed when taken.

    ``numbers``: the chosen rays, in that order; None for all. ``change`` treats every ray independently. Either all
    parts have wavelengths, or none.
    """

    parts: Sequence[Rays]
    numbers: Int[np.ndarray, " n"] | None = None
    change: Callable[[RayBundle], RayBundle] | None = None

    def __len__(self) -> int:
        return sum(map(len, self.parts)) if self.numbers is None else len(self.numbers)

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Read some of the rays, each from its part, and change them."""
        if self.numbers is not None:
            rows = self.numbers[rows].astype(np.int64)
        rays = self.parts[0].take(rows) if len(self.parts) == 1 else self._from_parts(rows)
        return rays if self.change is None else self.change(rays)

    def _from_parts(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        if isinstance(rows, slice):
            rows = np.arange(*rows.indices(sum(map(len, self.parts))))
        starts = accumulate(map(len, self.parts), initial=0)
        taken = []
        places = []
        for part, start in zip(self.parts, starts, strict=False):  # the last start is the end
            in_part = np.flatnonzero((rows >= start) & (rows < start + len(part)))
            if len(in_part):
                taken.append(part.take(rows[in_part] - start))
                places.append(in_part)
        return RayBundle.joined(taken).take(np.argsort(np.concatenate(places)))


def number_type(count: int) -> type[np.int32] | type[np.int64]:
    """Integer type for the numbers of ``count`` rays: half the memory if that is enough."""
    return np.int32 if count < 2**31 else np.int64


def changed(rays: Rays, change: Callable[[RayBundle], RayBundle]) -> Rays:
    """Change rays, each by itself: at once where they are in memory."""
    return change(rays) if isinstance(rays, RayBundle) else LazyRays([rays], change=change)


def chosen(rays: Rays, numbers: Int[np.ndarray, " n"]) -> Rays:
    """Choose rays by their numbers: at once where they are in memory."""
    if isinstance(rays, RayBundle):
        return rays.take(numbers)
    return LazyRays([rays], numbers.astype(number_type(len(rays))))


def joined(parts: Sequence[Rays]) -> Rays:
    """Join rays: at once where all are in memory."""
    loaded = [part for part in parts if isinstance(part, RayBundle)]
    return RayBundle.joined(loaded) if len(loaded) == len(parts) else LazyRays(parts)


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
