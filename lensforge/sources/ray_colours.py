"""Colours of a source's rays: X, Y and Z per W of each, by the spectrum of its emitter or by its wavelength."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.optics.colorimetry import tristimulus_at, tristimulus_of
from lensforge.sources.ray_bundle import ChangedSource, RayBundle, Rays, blocks_of, changed
from lensforge.sources.source_spectrum import Spectrum, spectrum_of
from lensforge.spec.emitter_section import SpectrumSpec

_LEAST_LM_PER_W = 1e-3  # X + Y + Z of light outside the visible range; of 400 nm it is 338, of 780 nm 0.04


def tristimulus_of_spectrum(spec: SpectrumSpec | None, name: str) -> Float[np.ndarray, " 3"]:
    """X, Y, Z (lm) per W of a spectrum; ``name``: of the source or its part in errors.

    Raises :class:`InputError` for a missing or invisible spectrum.
    """
    if spec is None:
        raise InputError(f"{name}: its colour is not known; give its spectrum, or leave out [colour]")
    spectrum = spectrum_of(spec)
    tristimulus = tristimulus_of(spectrum.wavelengths_nm, spectrum.power_density)
    _require_visible(float(tristimulus.sum()), spectrum.wavelengths_nm, f"{name}.spectrum")
    return tristimulus


def _require_visible(lumens_per_watt: float, waves: Float[np.ndarray, " k"], name: str) -> None:
    if not lumens_per_watt > _LEAST_LM_PER_W:
        raise InputError(
            f"{name}: from {waves.min():g} to {waves.max():g} nm, no light that is seen, from 360 to 830 nm; correct "
            "it, or leave out [colour]"
        )


def coloured_by_wavelength(rays: RayBundle) -> RayBundle:
    """``rays`` with X, Y, Z of the wavelengths that they carry."""
    assert rays.wavelengths_nm is not None
    return replace(rays, tristimulus=tristimulus_at(rays.wavelengths_nm))


def coloured_alike(rays: RayBundle, tristimulus: Float[np.ndarray, " 3"]) -> RayBundle:
    """``rays`` of one colour."""
    return replace(rays, tristimulus=np.broadcast_to(tristimulus, (len(rays), 3)))


def coloured_set(rays: Rays, spectrum: SpectrumSpec | None, name: str) -> Rays:
    """Give the rays of a file or of arrays their colours: by ``spectrum``, or by the wavelength of each.

    Rays with wavelengths follow these, as they disperse. Raises :class:`InputError` if neither is known, or nothing is
    visible.
    """
    if rays.take(slice(0, 1)).wavelengths_nm is None:
        constant = tristimulus_of_spectrum(spectrum, name)
        return changed(rays, lambda some: coloured_alike(some, constant))
    coloured = changed(rays, coloured_by_wavelength)
    seen = 0.0
    flux = 0.0
    ends = list[float]()
    for block in blocks_of(coloured):
        assert block.tristimulus is not None and block.wavelengths_nm is not None
        seen = seen + float(block.flux @ block.tristimulus.sum(axis=1))
        flux = flux + float(block.flux.sum())
        ends += [float(block.wavelengths_nm.min()), float(block.wavelengths_nm.max())]
    _require_visible(seen / flux, np.array(ends), name)
    return coloured


@dataclass(frozen=True, eq=False)
class TristimulusSource(ChangedSource):
    """Source whose rays carry X, Y and Z per W: a common ``tristimulus``, or by the wavelength of each."""

    tristimulus: Float[np.ndarray, " 3"] | None = None

    def changed_rays(self, rays: RayBundle, seed: int) -> RayBundle:
        """The rays with their colours."""
        if rays.wavelengths_nm is not None:
            return coloured_by_wavelength(rays)
        return rays if self.tristimulus is None else coloured_alike(rays, self.tristimulus)


@dataclass(frozen=True, eq=False)
class ChipColours:
    """Spectra of the chips of an array: rays carry wavelengths of their chip's spectrum, or its ``tristimulus``."""

    spectra: tuple[Spectrum, ...]
    tristimulus: Float[np.ndarray, "k 3"] | None
    disperses: bool

    @staticmethod
    def of(specs: Sequence[SpectrumSpec | None], *, disperses: bool, coloured: bool) -> "ChipColours | None":
        """Colours of chips with these spectra; None if nothing asks for them.

        Raises :class:`InputError` for a chip without a spectrum, and where colour is asked for an invisible one.
        """
        if not (specs and (disperses or coloured)):
            return None
        names = [f"source.chips[{number}]" for number in range(len(specs))]
        for name, spec in zip(names, specs, strict=True):
            if spec is None:
                raise InputError(f"{name}: no spectrum, as other chips have; give it one, or source.spectrum")
        known = [spec for spec in specs if spec is not None]
        spectra = {spec: spectrum_of(spec) for spec in dict.fromkeys(known)}
        tristimulus = None
        if coloured:
            tristimulus = np.array([tristimulus_of_spectrum(*spectrum) for spectrum in zip(known, names, strict=True)])
        return ChipColours(tuple(spectra[spec] for spec in known), None if disperses else tristimulus, disperses)

    def given(self, rays: RayBundle, chips: Int[np.ndarray, " n"], seed: int) -> RayBundle:
        """``rays`` with the colours of their ``chips``, by number; wavelengths are drawn by ``seed``."""
        if self.tristimulus is not None:
            return replace(rays, tristimulus=self.tristimulus[chips])
        random = np.random.default_rng([seed, 5])
        numbers = (random.permutation(len(rays)) + random.random(len(rays))) / len(rays)
        waves = np.empty(len(rays))
        for number, spectrum in enumerate(self.spectra):
            waves[chips == number] = spectrum.at(numbers[chips == number])
        return rays.with_wavelengths(waves)
