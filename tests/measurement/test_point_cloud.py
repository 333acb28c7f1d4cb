"""Points read from text files, and registered to the design."""

import numpy as np
import pytest
from measured_lenses import lens, probed
from scipy.spatial.transform import Rotation

from lensforge.errors import InputError
from lensforge.geometry.patch import fit_patch
from lensforge.measurement.point_cloud import _gaps_and_slopes, distances, moved, over_surface, read_cloud, register

LENS = lens()
PATCH = fit_patch(LENS.outer)
ROTATION, SHIFT = np.array([0.05, -0.08, 0.12]), np.array([0.7, -0.4, 0.5])
POINTS = np.random.default_rng(0).normal(size=(150, 3))


@pytest.mark.parametrize("mark", [",", ";", "\t", "  ", ", "])
@pytest.mark.parametrize("head", ["", "x,y,z\n", "# probe 7\n\nX [mm];Y [mm];Z [mm]\n"])
def test_common_layouts_hold_the_same_points(tmp_path, mark, head):
    lines = [mark.join(f"{value:.12e}" for value in (*point, 1.0)) for point in POINTS]
    (tmp_path / "cloud.csv").write_text(head + "\r\n".join(lines), encoding="utf-8")
    np.testing.assert_allclose(read_cloud(tmp_path / "cloud.csv"), POINTS, rtol=1e-11)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"\xff\xfe\x00", "not readable as text"),
        (b"1 2 3\n", "1 points, must be at least 100"),
        (b"1 2 3\n" * 120 + b"1 2\n", "line 121: 2 numbers"),
        (b"1 2 3\n" * 120 + b"1 2 x\n", "line 121: '1 2 x'"),
        (b"1 2 3\n" * 120 + b"1 2 nan\n", "not finite"),
    ],
)
def test_what_is_no_cloud_is_input_error(tmp_path, content, message):
    if content is not None:
        (tmp_path / "cloud.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_cloud(tmp_path / "cloud.csv")


def test_a_moved_surface_is_moved_back():
    cloud = probed(LENS.outer, rotation=ROTATION, shift=SHIFT)
    motion = register(PATCH, cloud)
    back = Rotation.from_rotvec(ROTATION).inv()
    np.testing.assert_allclose(motion.rotation_rad, back.as_rotvec(), atol=1e-7)
    np.testing.assert_allclose(motion.translation_mm, -back.apply(SHIFT), atol=1e-6)
    gaps, _ = distances(PATCH, motion.apply(cloud)[over_surface(motion.apply(cloud))])
    assert np.abs(gaps).max() < 2e-5


def test_standard_errors_are_the_scatter_of_repeated_measurements():
    motions = [register(PATCH, probed(LENS.outer, 800, noise_mm=0.01, seed=10 * k)) for k in range(16)]
    found = np.array([np.concatenate([motion.rotation_rad, motion.translation_mm]) for motion in motions])
    errors = np.concatenate([motions[0].rotation_error_rad, motions[0].translation_error_mm])
    ratio = np.sqrt(np.mean(found**2, axis=0)) / errors
    assert ratio.min() > 0.5 and ratio.max() < 1.8


def test_slopes_are_those_of_the_distances():
    cloud = probed(LENS.outer, 200, height_mm=0.01)
    cloud = cloud[cloud[:, 2] > 2.0]
    motion = np.array([0.02, -0.3, 0.2, 0.1, -0.2, 0.1])
    _, slopes = _gaps_and_slopes(PATCH, cloud, motion)
    # The distance is exact to first order in the gap: slopes are compared where the gap is small.
    on = moved(cloud, motion)
    patch_points = on * (PATCH.radius(on / np.linalg.norm(on, axis=1)[:, None]) / np.linalg.norm(on, axis=1))[:, None]
    level = Rotation.from_rotvec(motion[:3]).inv().apply(patch_points - motion[3:])
    _, slopes = _gaps_and_slopes(PATCH, level, motion)
    for k, step in enumerate(1e-6 * np.eye(6)):
        difference = (
            _gaps_and_slopes(PATCH, level, motion + step)[0] - _gaps_and_slopes(PATCH, level, motion - step)[0]
        ) / 2e-6
        np.testing.assert_allclose(slopes[:, k], difference, atol=2e-5)


def test_points_elsewhere_are_input_error():
    with pytest.raises(InputError, match="lens coordinates"):
        register(PATCH, probed(LENS.outer, 500) - np.array([0.0, 0.0, 100.0]))
