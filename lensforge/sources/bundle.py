"""Rays as they leave a source, and the interface of every source."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.media import Media


@dataclass(frozen=True)
class RayBundle:
    """Rays: start points ``origins`` (mm), unit directions, and the flux each carries (W). NumPy, float64.

    ``refractive_indices`` and ``absorption_per_mm``: of the lens at the wavelength of each ray, ``wavelengths_nm``;
    None where that of the spec holds for all.
    """

    origins: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    refractive_indices: Float[np.ndarray, " n"] | None = None
    absorption_per_mm: Float[np.ndarray, " n"] | None = None
    wavelengths_nm: Float[np.ndarray, " n"] | None = None

    def __len__(self) -> int:
        return len(self.flux)

    def take(self, rows: Int[np.ndarray, " k"] | Bool[np.ndarray, " n"] | slice) -> "RayBundle":
        """Select some of the rays."""
        own = (None if each is None else each[rows] for each in self._own)
        return RayBundle(self.origins[rows], self.directions[rows], self.flux[rows], *own)

    def divided(self, parts: int) -> list["RayBundle"]:
        """Consecutive parts: those of a low-discrepancy sample are such samples themselves."""
        edges = np.linspace(0, len(self), parts + 1).astype(int)
        return [self.take(slice(start, stop)) for start, stop in pairwise(edges)]

    @property
    def _own(self) -> tuple[Float[np.ndarray, " n"] | None, ...]:
        return self.refractive_indices, self.absorption_per_mm, self.wavelengths_nm

    def indices(self, media: Media) -> Float[np.ndarray, " n"]:
        """Refractive index of the lens for each ray: its own where it has one, else that of ``media``."""
        own = self.refractive_indices
        return np.full(len(self), media.refractive_index) if own is None else own

    def entry_ratios(self, media: Media) -> Float[np.ndarray, " n"]:
        """Index before over index behind the inner face, for each ray."""
        ratios: Float[np.ndarray, " n"] = media.cavity_index / self.indices(media)
        return ratios

    def exit_ratios(self, media: Media) -> Float[np.ndarray, " n"]:
        """Index before over index behind the outer face, for each ray."""
        ratios: Float[np.ndarray, " n"] = self.indices(media) / media.outside_index
        return ratios

    def absorptions(self, media: Media) -> Float[np.ndarray, " n"]:
        """Absorption (1/mm) of the lens for each ray: its own where it has one, else that of ``media``."""
        own = self.absorption_per_mm
        return np.full(len(self), media.absorption_per_mm) if own is None else own

    def wavelengths(self, media: Media) -> Float[np.ndarray, " n"]:
        """Wavelength (nm) of each ray: its own where it has one, else that of ``media``."""
        own = self.wavelengths_nm
        return np.full(len(self), media.wavelength_nm) if own is None else own

    @classmethod
    def joined(cls, parts: Sequence["RayBundle"]) -> "RayBundle":
        """Join the rays of all parts in their order; what is of each ray, all of them have, or none."""
        own = ([each for each in rows if each is not None] for rows in zip(*(part._own for part in parts), strict=True))
        return cls(
            np.concatenate([part.origins for part in parts]),
            np.concatenate([part.directions for part in parts]),
            np.concatenate([part.flux for part in parts]),
            *(np.concatenate(rows) if rows else None for rows in own),
        )


@runtime_checkable
class Rays(Protocol):
    """Rays in their order, in memory as a :class:`RayBundle` or read from a file when they are taken."""

    def __len__(self) -> int: ...

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Some of the rays; a slice has no step."""
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
        """Largest mirror group (a name of ``surfaces.symmetry``) that leaves the emission unchanged."""
        ...

    @property
    def ray_count(self) -> int | None:
        """Number of distinct rays of a measured source; None where a sample may be of any size."""
        ...

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays whose flux adds up to ``flux_w``; the same seed gives the same rays."""
        ...

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Closed polygon (mm) around the emitting area, for drawings to scale."""
        ...


@runtime_checkable
class DrawsLater(Protocol):
    """A source that can name the rays of a large sample before it reads them."""

    def drawn(self, count: int, seed: int) -> Rays:
        """The rays of ``sample(count, seed)``, at most those that the source has."""
        ...


def drawn(source: Source, count: int, seed: int) -> Rays:
    """The rays of ``source.sample(count, seed)``, at most all; those of a large file are read when they are taken."""
    return source.drawn(count, seed) if isinstance(source, DrawsLater) else source.sample(count, seed)


@dataclass(frozen=True, eq=False)
class ChangedSource:
    """A source whose rays are those of ``source``, changed; all else is that of ``source``, unless a subclass says so.

    Subclasses have ``sample``.
    """

    source: Source

    @property
    def flux_w(self) -> float:
        """Flux (W) of the source itself."""
        return self.source.flux_w

    @property
    def symmetry(self) -> str:
        """Symmetry of the source itself."""
        return self.source.symmetry

    @property
    def ray_count(self) -> int | None:
        """Number of distinct rays of the source itself."""
        return self.source.ray_count

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline (mm) of the source itself."""
        return self.source.outline()
