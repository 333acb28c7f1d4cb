"""Colorimetry against Planck's law, the CIE's own chromaticities, and the photopic table of the package itself."""

import numpy as np
import pytest

from lensforge.optics.colorimetry import (
    away_from,
    colour_temperature,
    denominator,
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
    found = colour_temperature(uv_of(tristimulus_of(WAVES, planck(kelvin))))
    assert found is not None
    assert found.cct_k == pytest.approx(kelvin, rel=2e-4)
    assert found.duv == pytest.approx(0.0, abs=2e-5)


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
    found = tristimulus_at(np.array([float(wavelength_nm)]))[0]
    assert found[:2] / found.sum() == pytest.approx(xy, abs=1e-4)


def test_y_is_the_luminous_flux_by_the_photopic_table() -> None:
    power = np.exp(-0.5 * ((WAVES - 590.0) / 40.0) ** 2)
    assert tristimulus_of(WAVES, power)[1] == pytest.approx(luminous_efficacy(WAVES, power), rel=2e-3)


def test_light_that_nobody_sees_has_no_colour() -> None:
    assert (tristimulus_at(np.array([300.0, 900.0])) == 0.0).all()
    assert np.isnan(uv_of(np.zeros(3))).all()
    assert colour_temperature(np.array([0.55, 0.52])) is None


def test_distance_from_a_colour_is_linear_and_nothing_for_that_colour() -> None:
    one, other = np.array([3.0, 2.0, 5.0]), np.array([1.0, 4.0, 2.0])
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
