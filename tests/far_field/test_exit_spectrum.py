"""Spectrum of the light that leaves the lens: rays counted at wavelengths, and powers of parts that are mixed."""

import numpy as np
import pytest

from lensforge.far_field.exit_light import _reach_deg
from lensforge.far_field.spectrum import _mixed, _of_rays
from lensforge.sources.bundle import RayBundle
from lensforge.sources.spectrum import Spectrum


def test_each_ray_counts_at_the_nearest_multiple_of_five_nanometres():
    waves, flux = np.array([497.6, 500.0, 502.4, 507.6, 531.0]), np.array([1.0, 2.0, 0.5, 7.0, 1.4])
    found = _of_rays(lambda: [(waves[:2], flux[:2]), (waves[2:], flux[2:])])
    power = dict(zip(found.wavelengths_nm.tolist(), found.power_density.tolist(), strict=True))
    lit = {wave: share for wave, share in power.items() if share > 0.0}
    assert lit == pytest.approx({500.0: 3.5 / 7.0, 510.0: 1.0, 530.0: 0.2})
    assert power[495.0] == power[535.0] == 0.0, "dark at both ends"
    np.testing.assert_allclose(np.diff(found.wavelengths_nm), 5.0)


def test_rays_of_one_wavelength_are_a_line():
    found = _of_rays(lambda: [(np.full(3, 621.3), np.ones(3))])
    assert (found.wavelengths_nm.tolist(), found.power_density.tolist()) == ([621.3], [1.0])


def test_parts_have_in_their_mixture_the_powers_that_they_have():
    """A line of 3 W and a triangle of 1 W, of which the areas are the powers."""
    line = Spectrum(np.array([450.0]), np.ones(1))
    table = Spectrum(np.array([550.0, 600.0, 650.0]), np.array([0.0, 4.0, 0.0]))
    found = _mixed([line, table], [3.0, 1.0])
    below = found.wavelengths_nm < 500.0
    areas = [np.trapezoid(found.power_density[part], found.wavelengths_nm[part]) for part in (below, ~below)]
    assert areas[0] / areas[1] == pytest.approx(3.0)
    assert found.power_density.max() == 1.0
    assert found.wavelengths_nm[below].tolist() == [445.0, 450.0, 455.0]


def test_the_reach_is_the_angle_that_holds_nearly_all_the_flux():
    gamma = np.deg2rad([5.0, 60.0, 20.0, 80.0])
    ways = np.stack([np.sin(gamma), np.zeros(4), np.cos(gamma)], axis=1)

    def reach(*flux):
        return _reach_deg(RayBundle(np.zeros((4, 3)), ways, np.array(flux)))

    assert reach(0.5, 0.004, 0.496, 0.0) == pytest.approx(20.0)  # within 99.5 % of the flux
    assert reach(0.5, 0.006, 0.494, 0.0) == pytest.approx(60.0)
    assert reach(0.5, 0.2, 0.2, 0.1) == pytest.approx(80.0)
    nothing = RayBundle(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    assert _reach_deg(nothing) == 90.0
