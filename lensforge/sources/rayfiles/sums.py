"""Sums over the usable rays of a file, gathered in one pass over any number of parts."""

from dataclasses import dataclass, field

import numpy as np

from lensforge.errors import InputError
from lensforge.optics.photopic import efficacy_at
from lensforge.sources.blocks import total_of
from lensforge.sources.rayfiles.binary import HUGE
from lensforge.sources.rayfiles.rayfile import FluxUnit, RayFile, UsableRays, no_usable_ray, usable_chunks
from lensforge.sources.rayfiles.stored import StoredRays
from lensforge.sources.rayfiles.virtual_focus import FocusFit
from lensforge.sources.spectrum import usable_wavelengths


@dataclass
class RaySums:
    """Sums of usable rays: fluxes as stored, lengths in mm, wavelengths in nm; ``dropped``: the others by cause.

    ``backward``: flux towards -z. ``coloured``: flux of the rays that have a wavelength; ``as_lumens``: that flux times
    the lm/W of each, ``as_watts``: divided by it, infinite where a ray is invisible.
    """

    rays: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    flux: float = 0.0
    flux_squared: float = 0.0
    backward: float = 0.0
    direction: np.ndarray = field(default_factory=lambda: np.zeros(3))
    low: np.ndarray = field(default_factory=lambda: np.full(3, np.inf))
    high: np.ndarray = field(default_factory=lambda: np.full(3, -np.inf))
    focus: FocusFit = field(default_factory=FocusFit)
    wavelength_low: float = np.inf
    wavelength_high: float = -np.inf
    wavelength_flux: float = 0.0
    coloured: float = 0.0
    as_lumens: float = 0.0
    as_watts: float = 0.0

    @classmethod
    def of(cls, rayfile: RayFile) -> "RaySums":
        """Gather the rays of a file block by block. Raises :class:`InputError` if none is usable."""
        sums = cls()
        for part in usable_chunks(rayfile):
            sums.add(part)
        if sums.rays == 0:
            raise no_usable_ray(rayfile, sums.dropped)
        return sums.possible(rayfile)

    def possible(self, rayfile: RayFile) -> "RaySums":
        """Return these sums. Raises :class:`InputError` where the rays add up to more than any light has."""
        if self.flux > HUGE:
            raise InputError(
                f"{rayfile.path}: its rays add up to {self.flux:.3g} {rayfile.flux_unit}, must be at most {HUGE:g}; "
                "export it again"
            )
        return self

    @classmethod
    def of_rays(cls, rays: UsableRays | StoredRays) -> "RaySums":
        """Gather the usable rays of a file; their flux has the bits of the sum over all at once."""
        sums, fluxes = cls(), []
        for block in rays.blocks():
            sums.add(block)
            fluxes.append(float(block.flux.sum()))
        sums.dropped = dict(rays.dropped)
        sums.flux = total_of(len(rays), fluxes)
        return sums

    def add(self, rays: UsableRays) -> None:
        """Add the rays of one part."""
        for cause, count in rays.dropped.items():
            self.dropped[cause] = self.dropped.get(cause, 0) + count
        if len(rays) == 0:
            return
        self.rays += len(rays)
        self.flux += float(rays.flux.sum())
        self.flux_squared += float(np.square(rays.flux).sum())
        self.backward += float(rays.flux[rays.directions[:, 2] < 0.0].sum())
        for axis in range(3):  # sums of columns: three times as fast as along the long axis of both
            self.direction[axis] += float((rays.flux * rays.directions[:, axis]).sum())
            self.low[axis] = min(self.low[axis], rays.positions_mm[:, axis].min())
            self.high[axis] = max(self.high[axis], rays.positions_mm[:, axis].max())
        self.focus.add(rays.positions_mm, rays.directions, rays.flux)
        if rays.wavelengths_nm is not None:
            self._add_wavelengths(rays.wavelengths_nm, rays.flux)

    def _add_wavelengths(self, wavelengths: np.ndarray, flux: np.ndarray) -> None:
        usable = usable_wavelengths(wavelengths)
        if not usable.any():
            return
        waves, power = wavelengths[usable], flux[usable]
        self.wavelength_low = min(self.wavelength_low, float(waves.min()))
        self.wavelength_high = max(self.wavelength_high, float(waves.max()))
        self.wavelength_flux += float((power * waves).sum())
        self.coloured += float(power.sum())
        efficacy = efficacy_at(waves)
        self.as_lumens += float((power * efficacy).sum())
        with np.errstate(divide="ignore"):
            self.as_watts += float((power / efficacy).sum())

    @property
    def effective_rays(self) -> float:
        """Number of rays of equal flux that would have the same noise."""
        return self.flux**2 / self.flux_squared

    @property
    def mean_wavelength_nm(self) -> float | None:
        """Mean by flux of the rays that have a wavelength; None where none has."""
        return self.wavelength_flux / self.coloured if self.coloured > 0.0 else None

    def luminous_efficacy(self, unit: FluxUnit) -> float | None:
        """Compute the lm/W of the rays by their wavelengths, their flux being in ``unit``; None without wavelengths."""
        if not self.coloured > 0.0:
            return None
        return self.as_lumens / self.coloured if unit == "W" else self.coloured / self.as_watts
