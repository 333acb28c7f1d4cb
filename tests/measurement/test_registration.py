import numpy as np
import pytest
from measured_lenses import lens, probed
from scipy.spatial.transform import Rotation

from lensforge.errors import InputError
from lensforge.geometry.patch import fit_patch
from lensforge.measurement.registration import _gaps_and_slopes, distances, moved, over_surface, register

LENS = lens()
PATCH = fit_patch(LENS.outer)
ROTATION, SHIFT = np.array([0.05, -0.08, 0.12]), np.array([0.7, -0.4, 0.5])


def test_a_moved_surface_is_moved_back():
    cloud = probed(LENS.outer, rotation=ROTATION, shift=SHIFT)
    pose = register(PATCH, cloud)
    back = Rotation.from_rotvec(ROTATION).inv()
    np.testing.assert_allclose(pose.rotation_rad, back.as_rotvec(), atol=1e-7)
    np.testing.assert_allclose(pose.translation_mm, -back.apply(SHIFT), atol=1e-6)
    gaps, _ = distances(PATCH, pose.apply(cloud)[over_surface(pose.apply(cloud))])
    assert np.abs(gaps).max() < 2e-5


def test_standard_errors_are_the_scatter_of_repeated_measurements():
    poses = [register(PATCH, probed(LENS.outer, 800, noise_mm=0.01, seed=10 * k)) for k in range(16)]
    found = np.array([np.concatenate([pose.rotation_rad, pose.translation_mm]) for pose in poses])
    errors = np.concatenate([poses[0].rotation_error_rad, poses[0].translation_error_mm])
    ratio = np.sqrt(np.mean(found**2, axis=0)) / errors
    assert ratio.min() > 0.5 and ratio.max() < 1.8


def test_slopes_are_those_of_the_distances():
    cloud = probed(LENS.outer, 200, height_mm=0.01)
    cloud = cloud[cloud[:, 2] > 2.0]
    pose = np.array([0.02, -0.3, 0.2, 0.1, -0.2, 0.1])
    _, slopes = _gaps_and_slopes(PATCH, cloud, pose)
    # The distance is exact to first order in the gap: slopes are compared where the gap is small.
    on = moved(cloud, pose)
    patch_points = on * (PATCH.radius(on / np.linalg.norm(on, axis=1)[:, None]) / np.linalg.norm(on, axis=1))[:, None]
    level = Rotation.from_rotvec(pose[:3]).inv().apply(patch_points - pose[3:])
    _, slopes = _gaps_and_slopes(PATCH, level, pose)
    for k, step in enumerate(1e-6 * np.eye(6)):
        difference = (
            _gaps_and_slopes(PATCH, level, pose + step)[0] - _gaps_and_slopes(PATCH, level, pose - step)[0]
        ) / 2e-6
        np.testing.assert_allclose(slopes[:, k], difference, atol=2e-5)


def test_points_elsewhere_are_input_error():
    with pytest.raises(InputError, match="lens coordinates"):
        register(PATCH, probed(LENS.outer, 500) - np.array([0.0, 0.0, 100.0]))
