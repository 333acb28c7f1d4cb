import numpy as np
from known_shapes import Ellipsoid, order, sampled, sphere

from lensforge.manufacturing.face import AirSide


def test_the_areas_add_up_to_a_hemisphere_with_second_order():
    error = [abs(sampled(sphere(2.0), AirSide.OUTSIDE, nodes).areas.sum() / (8.0 * np.pi) - 1.0) for nodes in (41, 81)]
    assert error[1] < 5e-5
    assert order(*error) > 1.7


def test_the_area_of_half_a_prolate_spheroid():
    a, c = 1.0, 1.5
    eccentricity = np.sqrt(1.0 - (a / c) ** 2)
    area = np.pi * a**2 + np.pi * a * c * np.arcsin(eccentricity) / eccentricity
    assert abs(sampled(Ellipsoid((a, a, c)), AirSide.INSIDE).areas.sum() / area - 1.0) < 1e-4


def test_normals_point_into_the_air():
    for air in AirSide:
        samples = sampled(sphere(2.0, (0.1, 0.2, 0.3)), air)
        expected = air * (samples.points - [0.1, 0.2, 0.3]) / 2.0
        assert np.abs(samples.normals - expected).max() < 1e-8


def test_samples_reach_the_rim_and_the_map_holds_the_inner_ones():
    samples = sampled(sphere(1.0), AirSide.OUTSIDE, 41)
    assert abs(samples.points[:, 2].min()) < 1e-12
    picture = samples.grid.to_map(samples.points)
    assert picture.shape == (41, 41, 3)
    assert np.array_equal(np.isnan(picture[..., 0]), ~samples.grid.inside)
    assert np.allclose(picture[20, 20], [0.0, 0.0, 1.0], atol=1e-12)
    assert picture[25, 20, 0] > 0.0  # the first index is X
    assert abs(picture[25, 20, 1]) < 1e-12
