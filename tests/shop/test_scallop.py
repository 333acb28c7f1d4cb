import numpy as np
import pytest

from lensforge.shop.ball_cutter import scallop_height_mm, scallop_slope_rad, stepover_for_slope_mm

CURVATURES = [-0.8, -0.2, 1e-9, 0.4, 2.0]


def test_the_measured_example_fifty_nanometres_are_ten_milliradians():
    assert abs(scallop_height_mm(1.0, 0.02) - 50e-6) < 1e-8
    assert abs(scallop_slope_rad(1.0, 0.02) - 0.01) < 1e-6


@pytest.mark.parametrize("kappa", CURVATURES)
def test_cusps_against_circles_drawn_in_the_plane(kappa):
    """Two ball positions on a circular arc of signed radius 1/kappa; the cusp is where their circles cross."""
    radius, step = 1.0, 0.3
    if abs(kappa) < 1e-6:
        height, slope = radius - np.sqrt(radius**2 - step**2 / 4.0), np.arcsin(step / (2.0 * radius))
    else:
        arc, half = 1.0 / kappa, kappa * step / 2.0
        centre = (arc + radius) * np.array([np.sin(half), np.cos(half)])  # the other is its mirror image
        # On the mirror line the near crossing is on the face's side of the centres.
        height = centre[1] - np.sqrt(radius**2 - centre[0] ** 2) - arc
        slope = np.arcsin(abs(centre[0]) / radius)
    assert abs(scallop_height_mm(radius, step, kappa) - height) < 1e-8
    assert abs(scallop_slope_rad(radius, step, kappa) - slope) < 1e-8


@pytest.mark.parametrize("kappa", CURVATURES)
def test_small_steps_follow_the_parabola(kappa):
    radius, step = 0.5, 1e-3
    assert scallop_height_mm(radius, step, kappa) == pytest.approx(step**2 / 8.0 * (1.0 / radius + kappa), rel=1e-5)
    assert scallop_slope_rad(radius, step, kappa) == pytest.approx(step / 2.0 * (1.0 / radius + kappa), rel=1e-5)


@pytest.mark.parametrize("kappa", [*CURVATURES, 0.0])
def test_the_stepover_for_a_slope_has_that_slope(kappa):
    step = stepover_for_slope_mm(1.0, 1e-2, kappa)
    assert scallop_slope_rad(1.0, step, kappa) == pytest.approx(1e-2, rel=1e-9)


def test_a_ball_that_fits_leaves_nothing_and_one_that_does_not_has_no_answer():
    assert scallop_height_mm(1.0, 0.1, -1.0) == 0.0
    assert stepover_for_slope_mm(1.0, 1e-3, -1.0) == np.inf
    assert np.isnan(scallop_height_mm(1.0, 0.1, -1.2))
    assert np.isnan(scallop_height_mm(1.0, 2.1))
    assert np.isnan(scallop_slope_rad(1.0, 2.1))
