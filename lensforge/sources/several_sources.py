"""Several LEDs of one lens: a sample has rays of each in turn, so that they share the rays of a trace.

Every ray says of which LED it is. The rays of each are a whole sample of that LED by themselves, with all of its flux.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.surfaces.mirror_group import shared_symmetry


@dataclass(frozen=True, eq=False)
class SeveralSources:
    """The LEDs of a lens, as one source; ``flux_w``: of all together.

    ``wavelength_nm``: for rays of an LED without wavelengths if others have some: that of the media's single index.
    """

    sources: tuple[Source, ...]
    wavelength_nm: float

    @property
    def flux_w(self) -> float:
        """Sum of the fluxes (W)."""
        return sum(source.flux_w for source in self.sources)

    @property
    def symmetry(self) -> str:
        """Largest mirror group that all of them share."""
        return shared_symmetry([source.symmetry for source in self.sources])

    @property
    def ray_count(self) -> int | None:
        """Number of rays without duplicates: for each LED as many as the smallest file has; None without a file."""
        counts = [source.ray_count for source in self.sources if source.ray_count is not None]
        return len(self.sources) * min(counts) if counts else None

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw at least ``count`` rays, equally many of each LED, one of each in turn; ``of_source`` has the number.

        Any part of consecutive rays is shared out alike.
        """
        several = len(self.sources)
        of_each = -(-count // several)
        parts = [source.sample(of_each, seed) for source in self.sources]
        if any(part.waves is not None for part in parts):
            waves_nm = np.full(of_each, self.wavelength_nm)
            parts = [part.with_wavelengths(waves_nm) if part.waves is None else part for part in parts]
        rays = RayBundle.joined(parts)
        numbers = np.repeat(np.arange(several, dtype=np.int16), of_each)
        in_turn = np.arange(several * of_each).reshape(several, of_each).T.ravel()
        return replace(rays, of_source=numbers).take(in_turn)

    @property
    def without_wavelengths(self) -> tuple[int, ...]:
        """Numbers of the LEDs without wavelengths if another has some."""
        without = [source.sample(1, 0).waves is None for source in self.sources]
        return () if all(without) else tuple(np.flatnonzero(without).tolist())

    def shared_out(self, rays: RayBundle) -> list[RayBundle]:
        """The rays of each LED, from a sample or a part of it."""
        assert rays.of_source is not None, "a sample of several sources"
        return [rays.take(rays.of_source == number) for number in range(len(self.sources))]

    def changed(self, change: Callable[[Source], Source]) -> "SeveralSources":
        """The same LEDs, each changed."""
        return replace(self, sources=tuple(map(change, self.sources)))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline (mm) of the smallest: it shows the finest shapes of a lens."""
        outlines = [source.outline() for source in self.sources]
        return min(outlines, key=lambda outline: float(np.ptp(outline, axis=0).max()) if len(outline) else 0.0)


def each_of(source: Source) -> tuple[Source, ...]:
    """The LEDs of a source: itself, unless it has several."""
    return source.sources if isinstance(source, SeveralSources) else (source,)
