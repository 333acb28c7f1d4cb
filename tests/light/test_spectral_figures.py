"""Figures of a spectrum against luxpy 1.12.5, whose numbers stand here, standard lights, and closed forms of lines."""

import numpy as np
import pytest

from lensforge.light.source_photometry import figures_of_spectrum
from lensforge.light.spectral_figures import SpectralFigures
from lensforge.sources.source_spectrum import Spectrum

NM = np.arange(380.0, 781.0)


def gaussian(peak_nm: float, fwhm_nm: float) -> np.ndarray:
    return np.exp(-0.5 * ((NM - peak_nm) / (fwhm_nm / 2.3548)) ** 2)


WHITE = 0.8 * gaussian(452.0, 20.0) + gaussian(560.0, 110.0) + 0.35 * gaussian(620.0, 80.0)
COARSE = np.array([430.0, 455.0, 560.0, 690.0]), np.array([0.1, 0.9, 0.7, 0.2])
NAMES = ("ra", "rf", "rg", "melanopic_der", "scotopic_ratio", "ppf_umol_per_j")
LUXPY = {  # Ra in steps of an eighth
    "white": ((NM, WHITE), (69.875, 76.312, 86.879, 0.525019, 1.5376, 4.6629)),
    "coarse": (COARSE, (81.875, 80.693, 85.757, 1.029579, 2.5586, 4.5241)),
}


def figures(nm: np.ndarray, density: np.ndarray) -> SpectralFigures:
    return figures_of_spectrum(Spectrum(np.asarray(nm, dtype=float), np.asarray(density, dtype=float)))


@pytest.mark.parametrize("name", LUXPY)
def test_another_program_finds_the_same(name: str) -> None:
    table, expected = LUXPY[name]
    result = figures(*table)
    assert [getattr(result, figure) for figure in NAMES] == pytest.approx(expected, rel=1e-3)


def standard(name: str) -> tuple[np.ndarray, np.ndarray]:
    from colour import SDS_ILLUMINANTS

    return np.asarray(SDS_ILLUMINANTS[name].wavelengths), np.asarray(SDS_ILLUMINANTS[name].values)


def test_daylight_is_what_melanopic_efficacy_is_measured_by() -> None:
    daylight = figures(*standard("D65"))
    assert daylight.melanopic_der == pytest.approx(1.0, abs=2e-4)
    assert (daylight.ra, daylight.rf, daylight.rg) == pytest.approx((100.0, 100.0, 100.0), abs=0.1)


@pytest.mark.parametrize(("name", "ra"), [("FL2", 64.2), ("FL11", 82.8)])
def test_published_rendering_of_fluorescent_lamps(name: str, ra: float) -> None:
    """CIE 15:2004, table T.7."""
    assert figures(*standard(name)).ra == pytest.approx(ra, abs=0.5)


def test_incandescent_light() -> None:
    """S/P of illuminant A: 1.41 (CIE 191:2010); its melanopic DER: 0.496 (CIE S 026)."""
    result = figures(*standard("A"))
    assert (result.scotopic_ratio, result.melanopic_der) == pytest.approx((1.41, 0.496), abs=5e-3)


def test_a_line_has_the_photons_of_its_wavelength() -> None:
    """h c N_A is 0.11962656 J m/mol."""
    line = figures([555.0], [1.0])
    assert line.ppf_umol_per_j == pytest.approx(555e-9 / 0.11962656 * 1e6, rel=1e-6)
    assert line.ppfd_umol_per_m2_s_klx == pytest.approx(1000.0 * line.ppf_umol_per_j / 683.0, rel=1e-4)
    assert line.scotopic_ratio == pytest.approx(1700.06 * 0.402 / 683.0, rel=1e-3) and line.ra is None


def test_photons_end_at_400_and_700_nm() -> None:
    """Of equal power from 390 to 720 nm: the integral of the wavelength from 400 to 700."""
    result = figures([390.0, 720.0], [1.0, 1.0])
    assert result.ppf_umol_per_j == pytest.approx((700.0**2 - 400.0**2) / 2.0 / 330.0 / 119.62656, rel=1e-6)
    for beyond in ([380.0], [710.0]):
        assert figures(beyond, [1.0]).ppf_umol_per_j == 0.0


def test_light_without_a_colour_temperature_has_no_rendering() -> None:
    red = figures(NM, gaussian(622.0, 18.0))
    assert (red.ra, red.rf, red.rg) == (None, None, None)
    assert (red.scotopic_ratio, red.melanopic_der) == pytest.approx((0.05176, 0.0030215), rel=1e-3)


def test_invisible_light_has_photons_alone() -> None:
    result = figures([840.0, 850.0, 860.0], [0.0, 1.0, 0.0])
    assert result.ppf_umol_per_j == 0.0
    assert {result.ra, result.scotopic_ratio, result.melanopic_der, result.ppfd_umol_per_m2_s_klx} == {None}
