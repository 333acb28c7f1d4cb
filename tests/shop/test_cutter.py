from dataclasses import replace

import numpy as np
import pytest
from known_shapes import Ellipsoid, order, sampled, sphere

from lensforge.cad.patch import PrincipalCurvatures
from lensforge.shop.ball_cutter import largest_ball_mm, reachable, residual_height_mm
from lensforge.shop.face_check import milled_face
from lensforge.shop.face_samples import AirSide
from lensforge.surfaces import surface as chart

A = 1.0  # a prolate cavity: its medial axis is a stretch of the axis
C = 1.5  # so every largest ball is known
THICK = 0.85  # a ball that rests on a ring of it


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.1, 0.05, -0.2)])
def test_a_spherical_cavity_takes_a_cutter_of_exactly_its_radius(centre):
    samples = sampled(sphere(0.8, centre), AirSide.INSIDE, 41)
    ball = largest_ball_mm(samples)
    assert np.abs(ball - 0.8).max() < 1e-6
    assert samples.fraction(reachable(ball, 0.8 * (1.0 - 1e-5))) == 1.0
    assert samples.fraction(reachable(ball, 0.8 * (1.0 + 1e-5))) == 0.0


def test_every_largest_ball_in_a_prolate_cavity():
    samples = sampled(Ellipsoid((A, A, C)), AirSide.INSIDE, spline_nodes=160)
    cosine = samples.points[:, 2] / C
    expected = A * np.sqrt(1.0 - cosine**2 * (1.0 - (A / C) ** 2))
    assert np.abs(largest_ball_mm(samples) - expected).max() < 1e-6


def test_reach_and_largest_cutter_of_a_prolate_cavity():
    radius = THICK
    face = sampled(Ellipsoid((A, A, C)), AirSide.INSIDE).face
    check = milled_face(face, radius)
    edge = C * np.sqrt((1.0 - (radius / A) ** 2) / (1.0 - (A / C) ** 2))  # height up to which the ball reaches

    def area_below(z):
        k = np.sqrt(C**2 - A**2) / C**2
        return np.pi * A * (z * np.sqrt(1.0 - (k * z) ** 2) + np.arcsin(k * z) / k)

    assert abs(check.samples.fraction(check.reached) - area_below(edge) / area_below(C)) < 2e-3
    assert abs(check.largest_cutter_mm - A**2 / C) < 1e-5


def two_balls(distance: float, radius: float, turn: float, nodes: int):
    """A dome of two overlapping balls: convex everywhere, yet no ball enters the valley between them.

    A ball on one of them rests against the plane of symmetry, so its radius is ``-d/n_x - r``.
    """
    samples = sampled(sphere(1.0), AirSide.OUTSIDE, nodes)
    axis = np.array([np.cos(turn), np.sin(turn), 0.0])
    u = chart.to_sphere(samples.chart)
    side = np.where(u @ axis >= 0.0, 1.0, -1.0)[:, None] * axis
    along = distance * np.sum(u * side, axis=1)
    points = (along + np.sqrt(along**2 - distance**2 + radius**2))[:, None] * u
    normals = (points - distance * side) / radius
    kappa = np.full(len(u), 1.0 / radius)
    towards = np.sum(normals * side, axis=1)
    expected = np.where(towards < 0.0, distance / np.maximum(-towards, 1e-12) - radius, np.inf)
    flat = replace(samples, points=points, normals=normals, curvatures=PrincipalCurvatures(kappa, kappa))
    return flat, expected


def test_the_global_gouge_test_sees_what_curvature_cannot():
    samples, expected = two_balls(0.5, 1.0, 0.0, 81)
    ball = largest_ball_mm(samples)
    tight = (expected > 1e-3) & (expected < 10.0)  # in the crease itself no ball fits
    assert tight.any()
    assert np.abs(ball[tight] / expected[tight] - 1.0).max() < 1e-6  # the mirror images are samples too
    assert (ball[expected >= 10.0] >= 10.0 * (1.0 - 1e-6)).all()


def test_a_sampled_obstacle_costs_second_order():
    error = []
    for nodes in (61, 121):
        samples, expected = two_balls(0.5, 1.0, 0.3, nodes)
        tight = (expected > 0.3) & (expected < 2.0)
        excess = largest_ball_mm(samples)[tight] - expected[tight]
        assert excess.min() > -1e-5  # never too small
        error.append(excess.mean())
    assert error[1] < 1e-3
    assert order(*error) > 1.6


def expected_residual(points):
    """In a prolate cavity the ball rests on a ring; its highest centre is on the axis and leaves a cap above."""
    cosine = np.sqrt((1.0 - (THICK / A) ** 2) / (1.0 - (A / C) ** 2))
    centre = np.array([0.0, 0.0, C * cosine * (1.0 - (A / C) ** 2)])
    above = points[:, 2] > C * cosine
    return np.where(above, np.linalg.norm(points - centre, axis=1) - THICK, 0.0)


def test_what_a_thick_cutter_leaves_in_a_prolate_cavity():
    error = []
    for nodes in (41, 81):
        samples = sampled(Ellipsoid((A, A, C)), AirSide.INSIDE, nodes)
        left = residual_height_mm(samples, largest_ball_mm(samples), THICK)
        expected = expected_residual(samples.points)
        assert expected.max() > 0.05
        error.append(np.abs(left - expected).max())
    assert error[1] < 1e-3
    assert order(*error) > 1.5
