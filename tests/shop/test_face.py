"""Measurements of one face against closed forms, and its best-fit sphere."""

import numpy as np
import pytest
from known_shapes import Ellipsoid, exported, random_surface, sampled, sphere
from scipy.optimize import minimize
from scipy.special import ellipeinc, ellipkinc

from lensforge.cad.patch import default_nodes, principal_curvatures
from lensforge.shop.face_check import best_fit_sphere, milled_face
from lensforge.shop.face_samples import AirSide, least_draft_rad
from lensforge.surfaces import surface as chart


def off_node_points(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    radius = np.sqrt(rng.random(count))
    azimuth = 2.0 * np.pi * rng.random(count)
    return radius[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


def curvatures(surface, air, nodes, points):
    face = exported(surface, air, nodes)
    jet = face.patch.jet(points)
    return jet.point, principal_curvatures(jet, face.air_normal(jet))


def ellipsoid_curvatures(axes, point):
    """Gaussian and mean curvature in closed form, convex positive."""
    a2, b2, c2 = np.array(axes) ** 2
    support = 1.0 / np.sqrt(np.sum(point**2 / np.array([a2, b2, c2]) ** 2, axis=1))
    gauss = support**4 / (a2 * b2 * c2)
    mean = support**3 * (a2 + b2 + c2 - np.sum(point**2, axis=1)) / (2.0 * a2 * b2 * c2)
    deviator = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    return mean - deviator, mean + deviator


@pytest.mark.parametrize("air", list(AirSide))
def test_an_ellipsoid_has_its_closed_form_curvatures(air):
    axes = (1.0, 1.3, 0.8)
    point, kappa = curvatures(Ellipsoid(axes), air, 128, off_node_points(1000))
    low, high = ellipsoid_curvatures(axes, point)
    if air is AirSide.INSIDE:
        low, high = -high, -low
    assert np.abs(kappa.minimum - low).max() < 1e-6
    # At the four umbilics the closed form itself loses half of its digits.
    assert np.abs(kappa.maximum - high).max() < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_a_random_surface_agrees_with_finite_differences_of_its_exact_normals(seed):
    surface = random_surface(2.45, 0.05, seed)
    points = off_node_points(200, seed)
    _, kappa = curvatures(surface, AirSide.OUTSIDE, default_nodes(surface.detail_rad), points)
    u = chart.to_sphere(points)
    first = np.cross(u, [0.36, 0.48, 0.8])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    step = 1e-4
    turned = []
    moved = []
    for tangent in (first, np.cross(u, first)):
        ahead, behind = (np.cos(step) * u + sign * np.sin(step) * tangent for sign in (1.0, -1.0))
        moved.append(surface.radius(ahead)[:, None] * ahead - surface.radius(behind)[:, None] * behind)
        turned.append(surface.normal(ahead) - surface.normal(behind))
    # dN = S dP (Weingarten) in the plane of the two displacements.
    metric = np.array([[np.sum(p * q, axis=1) for q in moved] for p in moved]).transpose(2, 0, 1)
    form = np.array([[np.sum(n * p, axis=1) for p in moved] for n in turned]).transpose(2, 0, 1)
    expected = np.sort(np.linalg.eigvals(np.linalg.solve(metric, form)).real, axis=1)
    assert np.abs(kappa.minimum - expected[:, 0]).max() < 1e-3
    assert np.abs(kappa.maximum - expected[:, 1]).max() < 1e-3
    assert np.ptp(kappa.minimum) > 0.1  # a sphere in disguise would prove little


def test_the_tightest_hollow_is_found_between_the_samples():
    surface = random_surface(0.8, 0.05, 4)
    coarse = sampled(surface, AirSide.INSIDE, nodes=61)
    fine = sampled(surface, AirSide.INSIDE, nodes=801)
    curvature = coarse.lowest_curvature()
    lowest = fine.curvatures.minimum.min()
    assert abs(curvature - lowest) < 1e-4 * abs(lowest)
    assert coarse.curvatures.minimum.min() > lowest * (1.0 - 1e-3)


def test_the_area_of_an_ellipsoid_with_three_axes():
    """Its half, by the incomplete elliptic integrals of the standard closed form."""
    a = 1.5
    b = 1.2
    c = 0.9
    phi = np.arccos(c / a)
    m = a**2 * (b**2 - c**2) / (b**2 * (a**2 - c**2))
    full = (
        2.0
        * np.pi
        * (c**2 + a * b / np.sin(phi) * (ellipeinc(phi, m) * np.sin(phi) ** 2 + ellipkinc(phi, m) * np.cos(phi) ** 2))
    )
    assert abs(sampled(Ellipsoid((a, b, c)), AirSide.OUTSIDE).area.total_mm2 / (full / 2.0) - 1.0) < 1e-8


def test_the_steepest_and_the_most_curved_place_are_found_between_the_samples():
    surface = random_surface(2.45, 0.05, 3)
    coarse = sampled(surface, AirSide.OUTSIDE, 61)
    fine = sampled(surface, AirSide.OUTSIDE, 801)
    steep = np.arcsin(fine.outward[:, 2].min())
    assert steep - 1e-5 < least_draft_rad(coarse) < steep + 1e-9
    assert np.arcsin(coarse.outward[:, 2].min()) > steep + 1e-6
    highest = fine.curvatures.maximum.max()
    assert highest * (1.0 - 1e-9) < coarse.highest_curvature() < highest * (1.0 + 1e-4)


def test_samples_reach_the_rim_and_the_map_holds_the_inner_ones():
    samples = sampled(sphere(1.0), AirSide.OUTSIDE, 41)
    assert abs(samples.points[:, 2].min()) < 1e-10  # the form error of the rim
    picture = samples.grid.to_map(samples.points)
    assert picture.shape == (41, 41, 3)
    assert np.array_equal(np.isnan(picture[..., 0]), ~samples.grid.inside)
    assert np.allclose(picture[20, 20], [0.0, 0.0, 1.0], atol=1e-12)
    assert picture[25, 20, 0] > 0.0  # the first index is X
    assert abs(picture[25, 20, 1]) < 1e-12


@pytest.mark.parametrize("air", list(AirSide))
def test_a_raised_sphere_is_undercut_below_its_equator(air):
    radius = 2.0
    height = 0.5
    samples = sampled(sphere(radius, (0.0, 0.0, height)), air, 161)
    assert abs(least_draft_rad(samples) - np.arcsin(-height / radius)) < 1e-6
    # Archimedes: the area of a zone is proportional to its height.
    assert abs(samples.area.undercut_fraction - height / (radius + height)) < 1e-4


# the prolate spheroid below: semi-axes across and along z
A = 1.0
C = 1.2


def test_least_squares_is_weighted_by_area():
    """The oracle integrates over the spheroid with Gauss-Legendre nodes in its height instead of the chart."""
    m, weight = np.polynomial.legendre.leggauss(60)
    m = (m + 1.0) / 2.0
    weight = weight / 2.0
    across = A * np.sqrt(1.0 - m**2)
    along = C * m
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
    coarse, fine = (milled_face(face, 1.0, nodes) for nodes in (41, 161))
    assert abs(coarse.sphere.radius_mm - fine.sphere.radius_mm) < 1e-12
    assert abs(coarse.sphere.pv_mm - fine.sphere.pv_mm) < 1e-6
    assert np.ptp(coarse.sag_mm) < fine.sphere.pv_mm - 1e-5, "the best samples alone are not the extremes"
    away = np.linalg.norm(coarse.samples.points - np.array(coarse.sphere.centre_mm), axis=1)
    np.testing.assert_allclose(coarse.sag_mm, away - coarse.sphere.radius_mm, atol=1e-12)
