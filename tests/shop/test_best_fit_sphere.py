import numpy as np
import pytest
from known_shapes import Ellipsoid, random_surface, sampled, sphere
from scipy.optimize import minimize

from lensforge.shop.best_fit_sphere import VARIANTS, best_fit_sphere
from lensforge.shop.face_samples import AirSide

A, C = 1.0, 1.2  # the prolate spheroid below: semi-axes across and along z


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("air", list(AirSide))
def test_a_sphere_on_the_axis_is_its_own_best_fit(variant, air):
    # An enclosing sphere of less than a hemisphere is smaller than the sphere itself, so the centre is above z = 0.
    fit = best_fit_sphere(sampled(sphere(2.0, (0.0, 0.0, 0.3)), air), variant)
    assert abs(fit.radius_mm - 2.0) < 1e-6
    assert np.abs(fit.centre_mm - [0.0, 0.0, 0.3]).max() < 1e-6
    assert fit.pv_mm < 2e-6
    assert fit.slope_departure.max() < 2e-6


def test_only_the_free_centre_follows_a_sphere_off_the_axis():
    samples = sampled(sphere(2.0, (0.1, -0.2, 0.3)), AirSide.OUTSIDE)
    free = best_fit_sphere(samples, "free_centre")
    assert np.abs(free.centre_mm - [0.1, -0.2, 0.3]).max() < 1e-7
    assert free.pv_mm < 1e-6
    assert best_fit_sphere(samples).rms_mm > 0.05


def test_a_spheroid_has_the_closed_form_minimum_zone_and_enclosing_sphere():
    """Distances from (0, 0, z) are a quadratic in cos(t): equal at both ends and lowest half-way, an alternation."""
    samples = sampled(Ellipsoid((A, A, C)), AirSide.OUTSIDE, nodes=161)
    z = (C**2 - A**2) / (2.0 * C)
    large, small = C - z, np.sqrt(A**2 + z**2 - (C**2 - A**2) / 4.0)
    zone, enclosing, inscribed = (best_fit_sphere(samples, v) for v in ("minimum_pv", "enclosing", "inscribed"))
    assert abs(zone.pv_mm - (large - small)) < 1e-5
    assert abs(zone.radius_mm - (large + small) / 2.0) < 1e-5
    assert abs(enclosing.radius_mm - large) < 1e-6
    assert abs(enclosing.centre_mm[2] - z) < 1e-6
    assert enclosing.deviation_mm.max() <= 1e-12
    assert abs(inscribed.radius_mm - small) < 1e-5
    assert inscribed.deviation_mm.min() >= -1e-12


def test_least_squares_is_weighted_by_area():
    """The oracle integrates over the spheroid with Gauss-Legendre nodes in its height instead of the chart."""
    m, weight = np.polynomial.legendre.leggauss(60)
    m, weight = (m + 1.0) / 2.0, weight / 2.0
    across, along = A * np.sqrt(1.0 - m**2), C * m
    weight = weight * A * np.sqrt(C**2 * (1.0 - m**2) + A**2 * m**2)

    def cost(parameters):
        return weight @ (np.hypot(across, along - parameters[0]) - parameters[1]) ** 2

    expected = minimize(cost, [0.1, 1.1], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-16})
    fit = best_fit_sphere(sampled(Ellipsoid((A, A, C)), AirSide.OUTSIDE, nodes=161))
    # With the cells of the samples as weights the centre is 6e-6 mm off.
    assert abs(fit.centre_mm[2] - expected.x[0]) < 2e-8
    assert abs(fit.radius_mm - expected.x[1]) < 2e-8
    assert abs(fit.rms_mm - np.sqrt(expected.fun / weight.sum())) < 2e-8


def test_the_sphere_does_not_depend_on_the_number_of_samples():
    surface = random_surface(2.45, 0.08, 2)
    coarse, fine = (best_fit_sphere(sampled(surface, AirSide.OUTSIDE, nodes)) for nodes in (41, 321))
    assert abs(coarse.radius_mm - fine.radius_mm) < 1e-12
    assert abs(coarse.pv_mm - fine.pv_mm) < 1e-6
    assert abs(coarse.largest_slope - fine.largest_slope) < 1e-6
    assert np.ptp(coarse.deviation_mm) < fine.pv_mm - 1e-5, "the best samples alone are not the extremes"


def test_slope_departure_is_the_angle_between_the_normals():
    samples = sampled(Ellipsoid((A, A, C)), AirSide.INSIDE)
    fit = best_fit_sphere(samples)
    normal = samples.points / np.array([A, A, C]) ** 2
    radial = samples.points - fit.centre_mm
    cosine = np.sum(normal * radial, axis=1) / np.linalg.norm(normal, axis=1) / np.linalg.norm(radial, axis=1)
    assert np.abs(fit.slope_departure - np.arccos(np.minimum(cosine, 1.0))).max() < 1e-6
    assert fit.slope_departure.max() > 0.05


@pytest.mark.parametrize("seed", range(3))
def test_each_variant_is_best_at_what_it_is_named_for(seed):
    samples = sampled(random_surface(2.45, 0.05, seed), AirSide.OUTSIDE)
    fits = {variant: best_fit_sphere(samples, variant) for variant in VARIANTS}
    on_axis = [fits[variant] for variant in VARIANTS if variant != "free_centre"]
    assert fits["free_centre"].rms_mm == min(fit.rms_mm for fit in fits.values())
    assert fits["least_squares"].rms_mm == min(fit.rms_mm for fit in on_axis)
    assert fits["minimum_pv"].pv_mm <= min(fit.pv_mm for fit in on_axis) + 1e-9
    assert fits["minimum_pv"].pv_mm < fits["least_squares"].pv_mm - 1e-4
