"""Spectrum of a source: wavelengths drawn from it, and the index of a dispersive lens at each."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, remedy
from lensforge.optics.materials import Material
from lensforge.sources.bundle import RayBundle, Source
from lensforge.sources.inverse_cdf import choose, linear_inverse
from lensforge.sources.source_summary import Range
from lensforge.spec.emission import FileSpectrum, LineSpectrum, SpectrumSpec, TableSpectrum


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Spectral power density (relative, per nm), linear between ``wavelengths_nm``; one wavelength alone is a line.

    Raises :class:`InputError`, ``name`` in front, unless wavelengths rise and densities are 0 or above, not all 0.
    """

    wavelengths_nm: Float[np.ndarray, " k"]
    power_density: Float[np.ndarray, " k"]
    name: str = "spectrum"

    def __post_init__(self) -> None:
        waves, density = self.wavelengths_nm, self.power_density
        if not (np.isfinite(waves).all() and (waves > 0.0).all() and (np.diff(waves) > 0.0).all()):
            raise InputError(f"{self.name}: wavelengths must be above 0 nm, each longer than the one before")
        if not (np.isfinite(density).all() and (density >= 0.0).all() and density.any()):
            raise InputError(f"{self.name}: power densities must be finite, none below 0, and not all zero")

    @cached_property
    def _cumulative(self) -> Float[np.ndarray, " cells"]:
        return np.cumsum(0.5 * (self.power_density[1:] + self.power_density[:-1]) * np.diff(self.wavelengths_nm))

    def at(self, numbers: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map numbers in [0, 1) to wavelengths (nm): the exact inverse of the power up to a wavelength."""
        if len(self.wavelengths_nm) == 1:
            return np.full(len(numbers), self.wavelengths_nm[0])
        cell, rest = choose(self._cumulative, numbers)
        place = linear_inverse(self.power_density[cell], self.power_density[cell + 1], rest)
        low = self.wavelengths_nm[cell]
        wavelengths: Float[np.ndarray, " n"] = low + place * (self.wavelengths_nm[cell + 1] - low)
        return wavelengths

    def draw(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Draw ``count`` wavelengths (nm), one from each of as many equal shares of the power, in random order.

        So they pad the Sobol points of position and direction (Owen, Latin supercube sampling, 1998) and are
        independent of both.
        """
        random = np.random.default_rng([seed, 5])
        return self.at((random.permutation(count) + random.random(count)) / count)


def spectrum_of(spec: SpectrumSpec) -> Spectrum:
    """Make the spectrum that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used."""
    match spec:
        case LineSpectrum():
            return Spectrum(np.array([spec.wavelength_nm]), np.ones(1))
        case TableSpectrum():
            return Spectrum(np.array(spec.wavelength_nm), np.array(spec.weight))
        case FileSpectrum():
            with remedy("correct source.spectrum.file"):
                return _read(spec.file)


def _read(path: Path) -> Spectrum:
    try:
        rows = np.loadtxt(path, ndmin=2, encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        problem = " ".join(str(error).split())[:160]
        raise InputError(f"{path}: not two columns of numbers ({problem})") from None
    if rows.shape[1] != 2 or len(rows) == 0:
        raise InputError(f"{path}: {rows.shape[1]} columns; two, wavelength (nm) and relative power density")
    return Spectrum(rows[:, 0], rows[:, 1], str(path))


@dataclass(frozen=True)
class IndexRange:
    """Least and largest wavelength (nm) of some light, and the refractive index of the lens at each."""

    wavelengths_nm: Range
    refractive_indices: Range

    @classmethod
    def of(cls, wavelengths_nm: Float[np.ndarray, " n"], material: Material) -> "IndexRange":
        """Look up the indices of ``material`` at the ends of ``wavelengths_nm``."""
        ends = np.array([wavelengths_nm.min(), wavelengths_nm.max()])
        low, high = material.index(ends)
        return cls((float(ends[0]), float(ends[1])), (float(low), float(high)))


@dataclass(frozen=True, eq=False)
class DispersedSource:
    """Source that emits ``spectrum`` from every point in every direction, each ray with its index in ``material``."""

    source: Source
    spectrum: Spectrum
    material: Material

    @property
    def flux_w(self) -> float:
        """Flux (W) of the source itself."""
        return self.source.flux_w

    @property
    def symmetry(self) -> str:
        """Symmetry of the source itself: wavelengths are spread evenly over it."""
        return self.source.symmetry

    @property
    def ray_count(self) -> int | None:
        """Number of distinct rays of the source itself."""
        return self.source.ray_count

    @property
    def index_range(self) -> IndexRange:
        """Ends of the spectrum, and the indices there."""
        return IndexRange.of(self.spectrum.wavelengths_nm, self.material)

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw the rays of the source itself, each with the index at a wavelength drawn by ``seed``."""
        rays = self.source.sample(count, seed)
        return replace(rays, refractive_indices=self.material.index(self.spectrum.draw(count, seed)))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline of the source itself."""
        return self.source.outline()
