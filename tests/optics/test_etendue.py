"""Étendue of a ball and a plane: closed forms against integrals."""

from math import pi

import numpy as np
import pytest

from lensforge.optics.fundamental_limits import cell_solid_angles, cone_around, etendue_from_ball


def corners_of(x_mm: np.ndarray, y_mm: np.ndarray, distance_mm: float) -> np.ndarray:
    """Corners of cells in the plane at ``distance_mm``, [row y, column x]."""
    x, y = np.meshgrid(x_mm, y_mm)
    return np.stack([x, y, np.full_like(x, distance_mm)], axis=-1)


def of_plane(x_mm: np.ndarray, y_mm: np.ndarray, distance_mm: float) -> np.ndarray:
    return cell_solid_angles(corners_of(x_mm, y_mm, distance_mm))


def test_solid_angles_of_cells_add_up_and_have_closed_forms() -> None:
    edges = np.linspace(-3.0, 5.0, 9)
    cells = of_plane(edges, np.linspace(-2.0, 4.0, 4), 7.0)
    assert cells.shape == (3, 8)
    assert cells.sum() == pytest.approx(of_plane(np.array([-3.0, 5.0]), np.array([-2.0, 4.0]), 7.0)[0, 0])
    # one face of a cube about the origin is a sixth of the sphere, an endless plane half of it
    assert of_plane(np.array([-1.0, 1.0]), np.array([-1.0, 1.0]), 1.0)[0, 0] == pytest.approx(4.0 * pi / 6.0)
    assert of_plane(np.array([-1e9, 1e9]), np.array([-1e9, 1e9]), 1e-3)[0, 0] == pytest.approx(2.0 * pi, rel=1e-3)
    # far away it is area over distance squared
    assert of_plane(np.array([0.0, 2.0]), np.array([0.0, 3.0]), 1e6)[0, 0] == pytest.approx(6e-12, rel=1e-5)


def test_etendue_of_a_ball_against_an_integral_over_its_rays() -> None:
    """Rays from points of the plane in all directions below it: those that meet the ball, by their projected angle."""
    radius, distance, rng = 3.0, 8.0, np.random.default_rng(5)
    count = 400_000
    x, y = rng.uniform(2.0, 6.0, count), rng.uniform(-4.0, 4.0, count)
    sine, azimuth = np.sqrt(rng.random(count)), 2.0 * pi * rng.random(count)  # Lambertian: pi sr of projected angle
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), -np.sqrt(1.0 - sine**2)], axis=1)
    points = np.stack([x, y, np.full(count, distance)], axis=1)
    nearest = np.linalg.norm(np.cross(points, directions), axis=1)
    found = 32.0 * pi * (nearest < radius).mean()
    solid_angle = of_plane(np.array([2.0, 6.0]), np.array([-4.0, 4.0]), distance)[0, 0]
    assert etendue_from_ball(radius, solid_angle) == pytest.approx(found, rel=0.01)


def test_a_cone_holds_its_cells() -> None:
    edges = np.linspace(-10.0, 10.0, 5)
    cells = np.zeros((4, 4), dtype=bool)
    cells[3, 3] = True  # x and y from 5 to 10
    axis, half = cone_around(corners_of(edges, edges, 20.0), cells)
    middle = np.array([7.5, 7.5, 20.0])
    assert axis @ middle / np.linalg.norm(middle) > 0.999
    corners = np.array([[x, y, 20.0] for x in (5.0, 10.0) for y in (5.0, 10.0)])
    angles = np.arccos(corners @ axis / np.linalg.norm(corners, axis=1))
    assert angles.max() == pytest.approx(half, rel=1e-6)
