"""Points read from text files, and registered to the design."""

import numpy as np
import pytest
from measured_lenses import directions, lens, probed, waves
from nightly import first_by_day
from scenes import sphere
from scipy.spatial.transform import Rotation

from lensforge.addons.measure.registration import _gaps_and_slopes, distances, moved, over_surface, register
from lensforge.cad.patch import fit_patch
from lensforge.errors import InputError
from lensforge.surfaces.point_files import read_cloud
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.surface import HALF_WIDTH, to_sphere

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
        (b"\xff\xfe\x00", "has no row of numbers"),
        (b"1 2 3\n", "1 points, must be at least 100"),
        (b"1 2 3\n" * 120 + b"1 2\n", "line 121: 2 cells"),
        (b"1 2 3\n" * 120 + b"1 2 x\n", "line 121, column 3: 'x' is no number"),
        (b"1 2 3\n" * 120 + b"1 2 nan\n", "line 121, column 3: 'nan' is not a finite"),
        (b"121\n" + b"1 2 3\n" * 120, "line 1: 121 rows announced, 120 found"),
        (b"1;2;3\n" * 120 + b"1;2,500;3.5\n", "line 121, column 2: '2,500' beside numbers with decimal points"),
        (b"1,234,5,678,9,012\n" * 120, "line 1: '9,012': commas between numbers and in them"),
        (b"x,y,z\n" + b"1,234,5,678,9,112\n" * 120, "line 2: commas between numbers and in them cannot be told"),
        (b"1.5,2,3\n" * 120 + b"1,5,2,3\n", "line 121: 4 cells, line 1 has 3"),
        (b"x,y,x\n" + b"1.5,2,3\n" * 120, "line 1, column 3: 'x' is there twice"),
        (b"x [yd],y,z\n" + b"1.5,2,3\n" * 120, "line 1, column 1: 'x .yd.': its unit must be one of mm, cm"),
        (b"1 2 3\n" * 120 + b"1 2 2e6\n", r"line 121, column 3: a coordinate of 2e\+06 mm"),
        (b"P1,1.0,2.0,3.0\n" * 120, "line 1, column 1: 'P1' is no number"),
    ],
)
def test_what_is_no_cloud_is_input_error(tmp_path, content, message):
    if content is not None:
        (tmp_path / "cloud.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_cloud(tmp_path / "cloud.csv")


@pytest.mark.parametrize(
    ("content", "factor"),
    [
        ("{0};{1};{2}\n", 1.0),
        ("{0}\t{1}\t{2}\tP1\n", 1.0),
        ("{0} {1} {2}\n", 1.0),
        ("name;z [in];x [in];y [in]\nP1;{2};{0};{1}\n", 25.4),
    ],
)
def test_decimal_commas_names_and_units_are_read(tmp_path, content, factor):
    head, _, line = content[:-1].rpartition("\n")
    rows = [line.format(*(f"{value:.9f}".replace(".", ",") for value in point)) for point in POINTS]
    (tmp_path / "cloud.txt").write_text("\r\n".join([head, *rows]), encoding="utf-16")
    np.testing.assert_allclose(read_cloud(tmp_path / "cloud.txt"), factor * POINTS, atol=1e-7)


def test_polar_points_have_names_and_units_of_their_own(tmp_path):
    rows = "".join(f"{0.01 * k:.2f};{k};{0.5 + 0.001 * k:.4f}\n".replace(".", ",") for k in range(120))
    (tmp_path / "p.csv").write_text("phi [rad];theta;R [in]\n" + rows, encoding="utf-8")
    k = np.arange(120)
    wanted = np.stack([k, np.rad2deg(0.01 * k), 25.4 * (0.5 + 0.001 * k)], axis=1)
    np.testing.assert_allclose(read_cloud(tmp_path / "p.csv", coordinates="polar"), wanted, rtol=1e-12)


def test_a_moved_surface_is_moved_back():
    cloud = probed(LENS.outer, rotation=ROTATION, shift=SHIFT)
    motion = register(PATCH, cloud)
    back = Rotation.from_rotvec(ROTATION).inv()
    np.testing.assert_allclose(motion.rotation_rad, back.as_rotvec(), atol=1e-7)
    np.testing.assert_allclose(motion.translation_mm, -back.apply(SHIFT), atol=1e-6)
    gaps, _ = distances(PATCH, motion.pose.points(cloud)[over_surface(motion.pose.points(cloud))])
    assert np.abs(gaps).max() < 2e-5


FORMS = {
    "noise": lambda u, k: 0.01 * np.random.default_rng(k).normal(size=len(u)),
    "waves of 8 mm": lambda u, k: waves(u, 13.0 / 8.0, 0.01, k),
    "waves of 4 mm": lambda u, k: waves(u, 13.0 / 4.0, 0.01, k),
    "81 Gaussians": lambda u, k: 0.003 * SrbfBasis((81,), 1.75).evaluate(u) @ np.random.default_rng(k).normal(size=81),
}


@pytest.mark.parametrize("form", first_by_day(1, list(FORMS)[1::-1] + list(FORMS)[2:], "six seconds each"))
def test_standard_errors_are_the_scatter_over_parts(form):
    """Parts with form error of known correlation, 2 um of noise: by noise alone, errors are up to 5 times too small."""
    u, repeats = directions(400, 5), 20
    radius, normals = LENS.outer.radius(u), LENS.outer.normal(u)
    estimates, stated = [], []
    for k in range(repeats):
        deviation = FORMS[form](u, k) + 0.002 * np.random.default_rng(1000 + k).normal(size=len(u))
        motion = register(PATCH, u * radius[:, None] + deviation[:, None] * normals)
        estimates.append(np.concatenate([motion.rotation_rad, motion.translation_mm]))
        stated.append(np.concatenate([motion.rotation_error_rad, motion.translation_error_mm]))
    ratio = np.sqrt(np.mean((np.array(estimates) / np.array(stated)) ** 2, axis=0))
    # Scatter of a root mean square over 20 parts: 16 %; of its mean over the six, about 9 %.
    assert 0.7 < ratio.mean() < 1.4, ratio
    assert ratio.min() > 0.5 and ratio.max() < 1.7, ratio


def test_what_is_not_fitted_has_no_error_and_what_is_not_determined_an_infinite_one():
    cloud = probed(LENS.outer, 300, noise_mm=0.01)
    fixed, shifted = (register(PATCH, cloud, registration) for registration in ("none", "shift"))
    np.testing.assert_array_equal([fixed.rotation_error_rad, fixed.translation_error_mm], 0.0)
    np.testing.assert_array_equal(shifted.rotation_error_rad, 0.0)
    assert 0.0 < shifted.translation_error_mm.min() < 0.01
    ball = sphere(13.0)
    turned = register(fit_patch(ball), probed(ball, 300, noise_mm=0.01))
    assert (turned.rotation_error_rad > 10.0).all()


def test_slopes_are_those_of_the_distances():
    cloud = probed(LENS.outer, 200, height_mm=0.01)
    cloud = cloud[cloud[:, 2] > 2.0]
    motion = np.array([0.02, -0.3, 0.2, 0.1, -0.2, 0.1])
    _, slopes = _gaps_and_slopes(PATCH, cloud, motion)
    # The distance is exact to first order in the gap: slopes are compared where the gap is small.
    on = moved(cloud, motion)
    patch_points = on * (PATCH.radius(on / np.linalg.norm(on, axis=1)[:, None]) / np.linalg.norm(on, axis=1))[:, None]
    patch_points = patch_points[patch_points[:, 2] > 0.0]  # beyond the rim the turn of the normal is left out
    level = Rotation.from_rotvec(motion[:3]).inv().apply(patch_points - motion[3:])
    _, slopes = _gaps_and_slopes(PATCH, level, motion)
    for k, step in enumerate(1e-6 * np.eye(6)):
        difference = (
            _gaps_and_slopes(PATCH, level, motion + step)[0] - _gaps_and_slopes(PATCH, level, motion - step)[0]
        ) / 2e-6
        np.testing.assert_allclose(slopes[:, k], difference, atol=2e-5)


@pytest.mark.parametrize(("unit", "per_mm"), [("inches", 1 / 25.4), ("metres", 1e-3), ("µm", 1e3), ("cm", 0.1)])
@pytest.mark.parametrize("registration", ["rigid", "none"])
def test_points_in_another_unit_are_named(unit, per_mm, registration):
    with pytest.raises(InputError, match=rf"half of them lie within .* mm of the origin, .* are they in {unit}\?"):
        register(PATCH, per_mm * probed(LENS.outer, 300), registration)


def test_points_elsewhere_are_input_error():
    with pytest.raises(InputError, match="lens coordinates"):
        register(PATCH, probed(LENS.outer, 500) - np.array([0.0, 0.0, 100.0]))


def test_a_point_keeps_its_gap_when_it_leaves_the_face():
    """Points 0.5 mm off the face, by 0.02 mm above and below its rim: a fit gains nothing by pushing them off."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 150)
    rim = to_sphere(HALF_WIDTH * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1))
    points = rim * (PATCH.radius(rim) + 0.5)[:, None]
    above, below = (_gaps_and_slopes(PATCH, points, np.array([*np.zeros(5), z])) for z in (0.02, -0.02))
    assert over_surface(points + np.array([0.0, 0.0, 0.02])).all()
    assert not over_surface(points - np.array([0.0, 0.0, 0.02])).any()
    np.testing.assert_allclose(below[0], above[0], atol=0.02)
    assert below[0].min() > 0.4


@pytest.mark.parametrize("registration", ["none", "shift"])
def test_few_points_over_the_face_are_input_error(registration):
    cloud = probed(LENS.outer, 400)
    cloud = np.concatenate([cloud[:60], 0.1 * cloud[60:70] - [0.0, 0.0, 50.0]])
    with pytest.raises(InputError, match="60 of them lie over the surface once registered, must be at least 100"):
        register(PATCH, cloud, registration)


@pytest.mark.parametrize(
    ("unit", "mm"), [("mm", 1), ("in", 25.4), ("inch", 25.4), ("cm", 10), ("m", 1000), ("um", 1e-3)]
)
def test_each_unit_of_a_table_of_points(tmp_path, unit, mm):
    rows = "".join(";".join(f"{value:.12e}" for value in point) + "\n" for point in POINTS)
    (tmp_path / "cloud.csv").write_text(f"x [{unit}];y [{unit}];z [{unit}]\n{rows}", encoding="utf-8")
    np.testing.assert_allclose(read_cloud(tmp_path / "cloud.csv"), mm * POINTS, rtol=1e-11)
