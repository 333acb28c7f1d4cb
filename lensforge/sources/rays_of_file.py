"""Rays of a large file as rays of a source: in W, and with what the lens's material has at their wavelengths."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.materials.material import Material
from lensforge.sources.bundle import RayBundle
from lensforge.sources.dispersion import IndexAccount, IndexRange, in_material, known_or
from lensforge.sources.rayfiles.rayfile import as_float64
from lensforge.sources.rayfiles.stored import StoredRays
from lensforge.sources.unread_rays import blocks_of


@dataclass(frozen=True, eq=False)
class Colours:
    """Wavelengths (nm) of rays, ``mean_nm`` for those without a usable one, and the ``material`` of the lens."""

    wavelengths_nm: Float[np.ndarray, " n"]
    mean_nm: float
    material: Material


@dataclass(frozen=True, eq=False)
class RaysOfFile:
    """The ``stored`` rays of a file, ``factor`` times their flux; with ``colours`` each has its index in a lens."""

    stored: StoredRays
    factor: float
    colours: Colours | None = None

    def __len__(self) -> int:
        return len(self.stored)

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Read some of the rays."""
        found, colours = self.stored.take(rows), self.colours
        rays = RayBundle(found.positions_mm, found.directions, found.flux * self.factor)
        if colours is None:
            return rays
        waves = known_or(colours.mean_nm, as_float64(colours.wavelengths_nm[rows]))
        return in_material(rays, waves, colours.material)

    def dispersed(
        self, wavelengths_nm: Float[np.ndarray, " n"], material: Material, name: str
    ) -> tuple["RaysOfFile", IndexRange]:
        """The same rays with their index in ``material``; ``name`` is the source in errors.

        Raises :class:`InputError` where more than 1 % of the flux is beyond the material's trusted range.
        """
        account, start = IndexAccount(material), 0
        for block in blocks_of(self):
            account.add(block.flux, as_float64(wavelengths_nm[start : start + len(block)]))
            start += len(block)
        found = account.index_range(name)
        return RaysOfFile(self.stored, self.factor, Colours(wavelengths_nm, account.mean_nm, material)), found
