"""A source whose light the lens disperses: every ray gets the refractive index at a wavelength of its own."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.optics.materials import Material
from lensforge.sources.account import Range
from lensforge.sources.bundle import RayBundle, Source
from lensforge.sources.spectrum import Spectrum


@dataclass(frozen=True, eq=False)
class DispersedSource:
    """``source`` shining with ``spectrum``, the same at each of its points and in each direction, into ``material``."""

    source: Source
    spectrum: Spectrum
    material: Material

    @property
    def flux_w(self) -> float:
        """That of the source itself."""
        return self.source.flux_w

    @property
    def symmetry(self) -> str:
        """That of the source itself: colours are spread evenly over it."""
        return self.source.symmetry

    @property
    def population(self) -> int | None:
        """That of the source itself."""
        return self.source.population

    @property
    def colours(self) -> tuple[Range, Range]:
        """The ends of the spectrum (nm), and the indices there."""
        return colours(self.spectrum.wavelengths_nm, self.material)

    def sample(self, count: int, seed: int) -> RayBundle:
        """The rays of the source itself, each with the index at a wavelength drawn by ``seed``."""
        rays = self.source.sample(count, seed)
        return replace(rays, refractive_indices=self.material.index(self.spectrum.draw(count, seed)))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """That of the source itself."""
        return self.source.outline()


def colours(wavelengths_nm: Float[np.ndarray, " n"], material: Material) -> tuple[Range, Range]:
    """For the account: the least and the largest wavelength (nm), and the indices that the material has there."""
    ends = np.array([wavelengths_nm.min(), wavelengths_nm.max()])
    low, high = material.index(ends)
    return (float(ends[0]), float(ends[1])), (float(low), float(high))
