import numpy as np
from known_shapes import Ellipsoid, order, sampled, sphere

from lensforge.manufacturing.cutter import largest_ball_mm
from lensforge.manufacturing.face import AirSide
from lensforge.manufacturing.residual import residual_height_mm

A, C, RADIUS = 1.0, 1.5, 0.85


def expected_residual(points):
    """In a prolate cavity the ball rests on a ring; its highest centre is on the axis and leaves a cap above."""
    cosine = np.sqrt((1.0 - (RADIUS / A) ** 2) / (1.0 - (A / C) ** 2))
    centre = np.array([0.0, 0.0, C * cosine * (1.0 - (A / C) ** 2)])
    above = points[:, 2] > C * cosine
    return np.where(above, np.linalg.norm(points - centre, axis=1) - RADIUS, 0.0)


def test_what_a_thick_cutter_leaves_in_a_prolate_cavity():
    error = []
    for nodes in (41, 81):
        samples = sampled(Ellipsoid((A, A, C)), AirSide.INSIDE, nodes)
        left = residual_height_mm(samples, largest_ball_mm(samples), RADIUS)
        expected = expected_residual(samples.points)
        assert expected.max() > 0.05
        error.append(np.abs(left - expected).max())
    assert error[1] < 1e-3
    assert order(*error) > 1.5


def test_nothing_is_left_by_a_cutter_that_fits_and_all_by_one_that_does_not():
    samples = sampled(sphere(0.8), AirSide.INSIDE, 41)
    ball = largest_ball_mm(samples)
    assert (residual_height_mm(samples, ball, 0.5) == 0.0).all()
    assert np.isnan(residual_height_mm(samples, ball, 1.0)).all()
