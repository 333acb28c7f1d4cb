"""One rule for the flux of a source: power in W and luminous efficacy in lm/W from what spec and file state."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from lensforge.errors import InputError
from lensforge.optics.colorimetry import LARGEST_LM_PER_W, luminous_efficacy
from lensforge.sources.source_spectrum import spectrum_of
from lensforge.spec.emitter_section import EmitterSection, FluxSection, SpectrumSpec
from lensforge.spec.source_sections import ChipsSource

DEFAULT_FLUX_W = 1.0  # of a source about whose flux nothing is stated
# Less, and lumens say nothing about the light, which is sold in W: below 412 nm and above 715 nm.
_LEAST_LM_PER_W = 1.0
_NO_LIGHT_LM_PER_W = 1e-6  # V ends at 3e-4 lm/W; less is a damaged number, and lumens say nothing about the power
_ROUNDING = 1e-4  # relative excess over 683.002 lm/W that rounded totals of a file may have
_SPECTRUM_TOLERANCE = 0.05  # relative: lm/W of a data sheet and of its spectrum, read from a plot, agree this well
_LEAST_POWER = (
    "source: its flux is known in lm alone: lx, cd and lm are exact, powers in W are the least that such light can "
    "have (683 lm/W); give flux_w, a spectrum, or luminous_efficacy_lm_per_w too"
)


@dataclass(frozen=True)
class SourceFlux:
    """Flux of a source or of a part of it: ``flux_w`` (W), and its luminous ``efficacy`` (lm/W) where that is known.

    ``in_lumens``: spec or file state lumens. ``least_power``: nothing else is known, and ``flux_w`` is the least
    radiant flux that they can have, at 683.002 lm/W; then lx, cd and lm are exact, and W are not. ``fixed_lm``: the
    spec states its lumens, or nothing but lumens is known: an efficacy of the whole light changes W alone.
    """

    flux_w: float
    efficacy: float | None = None
    in_lumens: bool = False
    least_power: bool = False
    warnings: tuple[str, ...] = ()
    fixed_lm: bool = False

    @property
    def flux_lm(self) -> float | None:
        """Luminous flux (lm); None if the efficacy is not known."""
        return None if self.efficacy is None else self.flux_w * self.efficacy

    @property
    def lumens_per_watt(self) -> float | None:
        """Efficacy by which lux and candela are shown.

        None if unknown, and if the spectrum is nearly invisible and no lumens are stated.
        """
        shown = self.efficacy is not None and (self.in_lumens or self.efficacy >= _LEAST_LM_PER_W)
        return self.efficacy if shown else None


@dataclass(frozen=True)
class OwnFlux:
    """Flux of a file, a table or the parts of a source by its own data: W, lm, and lm/W by the spectrum."""

    flux_w: float | None = None
    flux_lm: float | None = None
    spectral_lm_per_w: float | None = None


def settled_flux(
    stated: FluxSection, efficacy: float | None = None, spectral: float | None = None, own_flux: OwnFlux = OwnFlux()
) -> SourceFlux:
    """Settle power and efficacy by what the spec says: the fluxes ``stated``, ``efficacy`` and ``spectral`` (lm/W).

    Efficacy: the ratio of both stated fluxes, or ``efficacy``, or that of the spec's spectrum, or the ratio of the
    file's ``own_flux`` totals, or that of its spectrum. Power: as stated, or by stated lumens and the efficacy, or the
    file's own, or by its own lumens, or 1 W. Lumens without any efficacy give the least power that they can have, and
    a warning. Raises :class:`InputError` for lumens of an invisible spectrum.
    """
    ratio, warnings = _own_ratio(own_flux)
    candidates = (stated.stated_lm_per_w, efficacy, spectral, ratio, own_flux.spectral_lm_per_w)
    known = next((candidate for candidate in candidates if candidate is not None), None)
    is_stated = stated.flux_w is not None or stated.flux_lm is not None
    power, lumens = (stated.flux_w, stated.flux_lm) if is_stated else (own_flux.flux_w, own_flux.flux_lm)
    in_lumens = not (stated.flux_lm is None and efficacy is None and own_flux.flux_lm is None)
    if power is not None or lumens is None:
        fixed = stated.flux_lm is not None
        power = DEFAULT_FLUX_W if power is None else power
        return SourceFlux(power, known, in_lumens, warnings=warnings, fixed_lm=fixed)
    if known is None:
        return SourceFlux(lumens / LARGEST_LM_PER_W, LARGEST_LM_PER_W, True, True, (*warnings, _LEAST_POWER), True)
    if known < _NO_LIGHT_LM_PER_W:
        raise InputError(f"source: flux of {lumens:g} lm, but its spectrum has no visible light; give flux_w instead")
    return SourceFlux(lumens / known, known, True, warnings=warnings, fixed_lm=True)


def _own_ratio(flux: OwnFlux) -> tuple[float | None, tuple[str, ...]]:
    """Luminous efficacy (lm/W) by both totals of a file; a warning if no light can have it."""
    if flux.flux_w is None or flux.flux_lm is None:
        return None, ()
    ratio = flux.flux_lm / flux.flux_w
    if _NO_LIGHT_LM_PER_W <= ratio <= LARGEST_LM_PER_W * (1.0 + _ROUNDING):
        return min(ratio, LARGEST_LM_PER_W), ()
    wrong = "no light has more than 683" if ratio > 1.0 else "that is no visible light"
    return None, (
        f"source: its file states {flux.flux_lm:.4g} lm and {flux.flux_w:.4g} W, {ratio:.4g} lm/W, and {wrong}: lm not "
        "used; give flux_lm",
    )


def joined_flux(
    stated: FluxSection, parts: Sequence[SourceFlux], efficacy: float | None = None, names: Sequence[str] = ()
) -> SourceFlux:
    """Settle the flux of a source of several ``parts``, whose sum or, with ``stated`` fluxes, whose ratio counts.

    ``efficacy`` (lm/W): of the whole light, if the spec states it; it leaves stated lumens as they are. ``names``: of
    the parts. Raises :class:`InputError` where the ratio is not known: some parts have a power and others only lumens.
    """
    dim = [part.least_power for part in parts]
    if any(dim) and not all(dim):
        dim_names = ", ".join(name for name, only_lumens in zip(names, dim, strict=True) if only_lumens)
        raise InputError(
            f"{dim_names}: flux known in lm alone, the flux of other parts in W; give its flux_w or a spectrum"
        )
    seen = _total_lm(parts)
    own_w = None if all(dim) else sum(part.flux_w for part in parts)
    if efficacy and seen and any(part.fixed_lm and part.efficacy != efficacy for part in parts):
        own_w = None
    joined = settled_flux(stated, efficacy, own_flux=OwnFlux(own_w, seen))
    warnings = dict.fromkeys(warning for part in parts for warning in part.warnings if warning != _LEAST_POWER)
    in_lumens = stated.flux_lm is not None or efficacy is not None or any(part.in_lumens for part in parts)
    return replace(joined, in_lumens=in_lumens, warnings=(*warnings, *joined.warnings))


def _total_lm(parts: Sequence[SourceFlux]) -> float | None:
    lumens = [part.flux_lm for part in parts if part.flux_lm is not None]
    return sum(lumens) if len(lumens) == len(parts) else None


def emitter_flux(spec: EmitterSection, own_w: float = DEFAULT_FLUX_W) -> SourceFlux:
    """Settle the flux of an emitter of ``spec``; ``own_w``: of its table, if it has one. Raises :class:`InputError`."""
    spectral = None if spec.spectra else spectral_efficacy(spec.spectrum)
    parts = list[SourceFlux]()
    if isinstance(spec, ChipsSource):
        names = [f"source.chips[{number}]" for number in range(len(spec.chips))]
        parts = chip_fluxes(spec)
        settled = joined_flux(spec, parts, spec.luminous_efficacy_lm_per_w, names)
        if settled.least_power:  # lumens are what data sheets of chips state: nothing to doubt
            settled = replace(
                settled, warnings=tuple(warning for warning in settled.warnings if warning != _LEAST_POWER)
            )
    else:
        settled = settled_flux(spec, spec.luminous_efficacy_lm_per_w, spectral, OwnFlux(own_w))
    return with_spectrum_compared(settled, spec, spectral, parts)


def with_spectrum_compared(
    flux: SourceFlux, spec: EmitterSection, spectral: float | None, parts: Sequence[SourceFlux] = ()
) -> SourceFlux:
    """Add a warning where the efficacy that ``spec`` states differs from the spectrum's, ``spectral`` (lm/W).

    Without that it is compared with that of all ``parts`` together.
    """
    stated = spec.stated_lm_per_w or spec.luminous_efficacy_lm_per_w
    whose = "spectrum has"
    if spectral is None and parts and not any(part.least_power for part in parts):
        lumens = _total_lm(parts)
        whose = "parts have"
        spectral = None if lumens is None else lumens / sum(part.flux_w for part in parts)
    if stated is None or not spectral or abs(stated / spectral - 1.0) <= _SPECTRUM_TOLERANCE:
        return flux
    warning = (
        f"source: {stated:.4g} lm/W stated, its {whose} {spectral:.4g} lm/W; lm per W of light are meant, not per W of "
        "electric power"
    )
    return replace(flux, warnings=(*flux.warnings, warning))


def chip_fluxes(spec: ChipsSource) -> list[SourceFlux]:
    """Settle the flux of each chip, of 1 W if nothing is stated."""
    spectra = spec.spectra or [spec.spectrum] * len(spec.chips)
    spectral = {spectrum: spectral_efficacy(spectrum) for spectrum in dict.fromkeys(spectra)}
    efficacy = None if spec.spectra else spec.luminous_efficacy_lm_per_w
    return [
        settled_flux(chip, efficacy, spectral[spectrum]) for chip, spectrum in zip(spec.chips, spectra, strict=True)
    ]


def spectral_efficacy(spec: SpectrumSpec | None) -> float | None:
    """Luminous efficacy (lm/W) of a spectrum of the spec, 0 where all of it is invisible; None if there is none."""
    if spec is None:
        return None
    spectrum = spectrum_of(spec)
    return luminous_efficacy(spectrum.wavelengths_nm, spectrum.power_density)
