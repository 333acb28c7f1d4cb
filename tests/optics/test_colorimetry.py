"""Colorimetry against Planck's law, the CIE's own chromaticities, and efficacies by another program."""

import numpy as np
import pytest

from lensforge.optics.colorimetry import (
    away_from,
    colour_temperature,
    denominator,
    efficacy_at,
    luminous_efficacy,
    srgb_of,
    tristimulus_at,
    tristimulus_of,
    uv_of,
)

WAVES = np.arange(300.0, 901.0, 5.0)
HC_OVER_K = 1.438776877e7  # nm K


def planck(kelvin: float) -> np.ndarray:
    power = WAVES**-5.0 / np.expm1(HC_OVER_K / (WAVES * kelvin))
    return power / power.max()


@pytest.mark.parametrize("kelvin", [1800.0, 2856.0, 4000.0, 6504.0, 12_000.0])
def test_black_bodies_lie_on_plancks_locus_at_their_temperature(kelvin: float) -> None:
    colour = colour_temperature(uv_of(tristimulus_of(WAVES, planck(kelvin))))
    assert colour is not None
    assert colour.cct_k == pytest.approx(kelvin, rel=2e-4)
    assert colour.duv == pytest.approx(0.0, abs=2e-5)


def test_equal_energy_is_the_point_of_equal_shares() -> None:
    """X = Y = Z: u' = 4/19, v' = 9/19; the observer's own tables have sums that differ by 5e-4."""
    x, y, z = tristimulus_of(np.array([300.0, 900.0]), np.ones(2))
    assert [x / y, z / y] == pytest.approx([1.0, 1.0], rel=6e-4)
    assert uv_of(np.array([x, y, z])) == pytest.approx([4.0 / 19.0, 9.0 / 19.0], abs=1e-4)


@pytest.mark.parametrize(
    ("wavelength_nm", "xy"), [(460, (0.1440, 0.0297)), (520, (0.0743, 0.8338)), (600, (0.6270, 0.3725))]
)
def test_lines_lie_on_the_locus_of_the_cie(wavelength_nm: float, xy: tuple[float, float]) -> None:
    """Chromaticities x, y of CIE 15, table of the 1931 observer."""
    tristimulus = tristimulus_at(np.array([float(wavelength_nm)]))[0]
    assert tristimulus[:2] / tristimulus.sum() == pytest.approx(xy, abs=1e-4)


@pytest.mark.parametrize(
    ("peak_nm", "fwhm_nm", "lm_per_w"), [(625.0, 18.0, 222.45), (525.0, 33.0, 510.25), (455.0, 20.0, 34.76)]
)
def test_narrow_light_has_the_efficacy_of_each_nm_as_its_colour_has(
    peak_nm: float, fwhm_nm: float, lm_per_w: float
) -> None:
    """Chips of RGBW by the CIE's table at each nm, in a program of its own; V each 5 nm has 0.1 to 0.2 % less."""
    waves = np.linspace(peak_nm - 60.0, peak_nm + 60.0, 2401)
    power = np.exp(-4.0 * np.log(2.0) * ((waves - peak_nm) / fwhm_nm) ** 2)
    assert luminous_efficacy(waves, power) == pytest.approx(lm_per_w, rel=2e-5 + 0.005 / lm_per_w)
    assert luminous_efficacy(waves, power) == pytest.approx(tristimulus_of(waves, power)[1], rel=1e-12)


def test_a_line_between_whole_nm_and_at_both_ends_of_sight() -> None:
    """CIE 018: V is 0.107 at 650 nm, 0.1014762 at 651, 3.917e-6 at 360 and 4.518e-7 at 830 nm."""
    efficacy = efficacy_at(np.array([359.9, 360.0, 650.5, 830.0, 830.1])) / 683.002
    assert efficacy == pytest.approx([0.0, 3.917e-6, 0.1042381, 4.518e-7, 0.0], rel=1e-3)
    assert luminous_efficacy(np.array([650.5]), np.ones(1)) == pytest.approx(683.002 * 0.1042381, rel=2e-4)


def test_light_that_nobody_sees_has_no_colour() -> None:
    assert (tristimulus_at(np.array([300.0, 900.0])) == 0.0).all()
    assert np.isnan(uv_of(np.zeros(3))).all()


@pytest.mark.parametrize("uv", [(0.55, 0.52), (0.1, 0.5), (0.25, 0.4)], ids=["red", "green", "purple"])
def test_colours_far_from_plancks_locus_have_no_temperature(uv: tuple[float, float]) -> None:
    """The green and the purple one are 0.07 and more on either side of a place of 9,000 K or more."""
    assert colour_temperature(np.array(uv)) is None


def test_distance_from_a_colour_is_linear_and_nothing_for_that_colour() -> None:
    one = np.array([3.0, 2.0, 5.0])
    other = np.array([1.0, 4.0, 2.0])
    uv = uv_of(one)
    assert away_from(uv, one) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert away_from(uv, 2.0 * one + 3.0 * other) == pytest.approx(3.0 * away_from(uv, other))
    assert away_from(uv, other) / denominator(other) == pytest.approx(uv_of(other) - uv)


def test_white_and_primaries_of_srgb_are_as_bright_as_a_screen_shows_them() -> None:
    """IEC 61966-2-1: chromaticities (0.3127, 0.3290) of white and (0.64, 0.33) of red, half as bright at 0.735."""
    white, red = (np.array([x, y, 1.0 - x - y]) for x, y in ((0.3127, 0.329), (0.64, 0.33)))
    assert srgb_of(3.0 * np.array([white, 0.5 * white])) == pytest.approx(
        np.repeat([[1.0], [0.735]], 3, axis=1), abs=0.01
    )
    assert srgb_of(red) == pytest.approx([1.0, 0.0, 0.0], abs=0.01)
    assert (srgb_of(np.zeros(3)) == 0.0).all()
