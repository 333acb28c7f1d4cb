import numpy as np
from known_shapes import Ellipsoid, exported, random_surface, sampled
from scipy.optimize import minimize

from lensforge.shop.face_check import best_fit_sphere, check_face
from lensforge.shop.face_samples import AirSide

A, C = 1.0, 1.2  # the prolate spheroid below: semi-axes across and along z


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
    face = exported(random_surface(2.45, 0.08, 2), AirSide.OUTSIDE)
    coarse, fine = (check_face(face, 1.0, nodes) for nodes in (41, 161))
    assert abs(coarse.sphere.radius_mm - fine.sphere.radius_mm) < 1e-12
    assert abs(coarse.sphere.pv_mm - fine.sphere.pv_mm) < 1e-6
    assert np.ptp(coarse.sag_mm) < fine.sphere.pv_mm - 1e-5, "the best samples alone are not the extremes"
    away = np.linalg.norm(coarse.samples.points - np.array(coarse.sphere.centre_mm), axis=1)
    np.testing.assert_allclose(coarse.sag_mm, away - coarse.sphere.radius_mm, atol=1e-12)
