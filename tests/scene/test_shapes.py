"""Targets as means over pixels: areas, moments and places of shapes, soft edges in closed form, the far field."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import small_spec
from scipy.special import ndtr, ndtri

from lensforge.errors import FileWarning, InputError
from lensforge.optics.pose import Pose
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import Plane, build_receiver, receivers_of
from lensforge.scene.target_pattern import coarser_target, drawn_target, target_light, uniform_region
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import write_photometric
from lensforge.sources.photometric.photometric_file import LampSet, PhotometricFile, turned_over
from lensforge.spec import RectangleTarget
from lensforge.spec.receiver_sections import FarFieldReceiver
from lensforge.spec.shape_targets import RingTarget

PIXELS = 128


def wanted(*targets: dict[str, Any], **receiver: Any) -> tuple[np.ndarray, PosedReceiver]:
    """Light wanted on a plane 300 mm wide and 200 mm high, or on another receiver."""
    plane = {"kind": "plane", "centre_mm": [0.0, 0.0, 150.0], "width_mm": 300.0, "height_mm": 200.0}
    spec = small_spec(target=None, receivers=[{**(receiver or plane), "targets": list(targets)}])
    raster = receivers_of(spec, PIXELS)[0]
    return target_light(spec.all_receivers[0].targets, raster), raster


def moments(light: np.ndarray, receiver: PosedReceiver) -> tuple[float, float, float, float]:
    """Centroid and variances along x and y."""
    x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
    total = light.sum()
    mx, my = float((light * x).sum() / total), float((light * y).sum() / total)
    return mx, my, float((light * (x - mx) ** 2).sum() / total), float((light * (y - my) ** 2).sum() / total)


SHAPES = {
    "rectangle": ({"kind": "rectangle", "width_mm": 90.0, "height_mm": 40.0}, 3600.0, 675.0, 1600.0 / 12.0),
    "disc": ({"kind": "disc", "diameter_mm": 80.0}, 1600.0 * np.pi, 400.0, 400.0),
    "ellipse": ({"kind": "ellipse", "width_mm": 100.0, "height_mm": 60.0}, 1500.0 * np.pi, 625.0, 225.0),
    "ring": ({"kind": "ring", "outer_diameter_mm": 80.0, "inner_diameter_mm": 40.0}, 1200.0 * np.pi, 500.0, 500.0),
    "polygon": (
        {"kind": "polygon", "corners_mm": [[-45.0, -20.0], [45.0, -20.0], [45.0, 20.0], [-45.0, 20.0]]},
        3600.0, 675.0, 1600.0 / 12.0,
    ),
    "cross": ({"kind": "cross", "length_mm": 90.0, "stroke_mm": 30.0}, 4500.0, 435.0, 435.0),
    "spots": (
        {"kind": "spots", "columns": 3, "rows": 2, "diameter_mm": 16.0, "pitch_mm": 40.0},
        384.0 * np.pi, 16.0 + 3200.0 / 3.0, 16.0 + 400.0,
    ),
}  # fmt: skip
each_shape = pytest.mark.parametrize(("target", "area", "xx", "yy"), SHAPES.values(), ids=list(SHAPES))


@each_shape
def test_shapes_have_their_areas_and_moments(target: dict[str, Any], area: float, xx: float, yy: float) -> None:
    light, receiver = wanted(target)
    assert light.sum() == pytest.approx(1.0, abs=1e-12)
    width, height = receiver.grid.pixel
    assert width * height / light.max() == pytest.approx(area, rel=3e-3)
    assert moments(light, receiver) == pytest.approx((0.0, 0.0, xx, yy), rel=1e-2, abs=0.2)


@each_shape
def test_shapes_are_moved_and_turned(target: dict[str, Any], area: float, xx: float, yy: float) -> None:
    """A quarter turn swaps the variances; 30 degrees mix them by cos^2 and sin^2."""
    for degrees, share in ((90.0, 0.0), (30.0, 0.75)):
        light, receiver = wanted({**target, "centre_mm": [60.0, -30.0], "rotation_deg": degrees})
        mixed = share * xx + (1.0 - share) * yy, share * yy + (1.0 - share) * xx
        assert moments(light, receiver) == pytest.approx((60.0, -30.0, *mixed), rel=1e-2, abs=0.2)


@each_shape
def test_soft_edges_keep_the_flux_and_add_their_variance(
    target: dict[str, Any], area: float, xx: float, yy: float
) -> None:
    light, receiver = wanted({**target, "edge_mm": 6.0})
    assert moments(light, receiver) == pytest.approx((0.0, 0.0, xx + 36.0, yy + 36.0), rel=1e-2, abs=0.2)


def test_tables_are_read_row_by_row_from_the_top(tmp_path: Path) -> None:
    values = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
    np.savez(tmp_path / "light.npz", values=values)
    (tmp_path / "light.csv").write_text("# light\n0;1;2\n3;4;5\n")
    by_array, _ = wanted({"kind": "array", "values": values, "width_mm": 150.0})
    for name in ("light.npz", "light.csv"):
        light, _ = wanted({"kind": "table", "file": str(tmp_path / name), "width_mm": 150.0})
        assert np.array_equal(light, by_array)
    taller, receiver = wanted({"kind": "array", "values": values, "width_mm": 150.0, "height_mm": 50.0})
    assert np.ptp(receiver.grid.y()[taller.any(axis=1)]) == pytest.approx(50.0, abs=5.0)
    (tmp_path / "light.csv").write_text("1,2\n3\n")
    with pytest.raises(InputError, match="line 2: 1 cells, line 1 has 2"):
        wanted({"kind": "table", "file": str(tmp_path / "light.csv"), "width_mm": 150.0})


FAR = {"kind": "far_field", "half_angle_deg": 80.0}


def along(light: np.ndarray, receiver: PosedReceiver) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Angles and light along x and along y through the middle of a far field, relative to the peak."""
    grid = receiver.grid
    middle = len(light) // 2
    zero = np.zeros(len(light))
    along_x = receiver.target_coordinates(grid.x(), zero)[0], 0.5 * (light[middle - 1] + light[middle])
    along_y = receiver.target_coordinates(zero, grid.y())[1], 0.5 * (light[:, middle - 1] + light[:, middle])
    return along_x[0], along_x[1] / light.max(), along_y[0], along_y[1] / light.max()


def test_a_photometric_file_is_wanted_as_it_stands(tmp_path: Path) -> None:
    """C = 90 is -y of the lens: more light to C 0 and C 90 is more light to +x and to -y; then turned and tilted."""
    c = np.arange(0.0, 361.0, 15.0)
    gamma = np.arange(0.0, 91.0, 2.5)
    shape = 1.0 + 0.6 * np.cos(np.radians(c - 30.0))[:, None] * np.sin(np.radians(gamma))
    values = 100.0 * shape * np.cos(np.radians(gamma)) ** 2
    write_photometric(
        tmp_path / "lamp.ies", PhotometricFile(TabulatedIntensity(c, gamma, values), lamps=(LampSet(1000.0),))
    )
    target = {"kind": "photometric", "file": str(tmp_path / "lamp.ies")}
    few = PhotometricFile(TabulatedIntensity(c, gamma, values), lamps=(LampSet(100.0),))  # of 2 pi 100/3 lm
    write_photometric(tmp_path / "few.ies", few)
    with pytest.warns(FileWarning, match=r"few\.ies: its light has 209\.\d+ lm, its lamps only 100 lm"):
        wanted({**target, "file": str(tmp_path / "few.ies")}, **FAR)
    x, on_x, y, on_y = along(*wanted(target, **FAR))
    table = turned_over(TabulatedIntensity(c, gamma, values))
    for angles, light, azimuths in ((x, on_x, (0.0, 180.0)), (y, on_y, (90.0, 270.0))):
        for side, azimuth in zip((1.0, -1.0), azimuths, strict=True):
            ahead = side * angles > 0.0
            exact = np.interp(np.abs(angles[ahead]), gamma, table.at(azimuth))
            assert np.allclose(light[ahead] / light[ahead].max(), exact / exact.max(), atol=0.02)
    assert on_x[x > 30.0].sum() > 1.2 * on_x[x < -30.0].sum() and on_y[y < -30.0].sum() > on_y[y > 30.0].sum()
    light, receiver = wanted({**target, "rotation_deg": 180.0}, **FAR)
    assert np.allclose(light, wanted(target, **FAR)[0][::-1, ::-1], atol=1e-12)
    tilted = moments(*wanted({**target, "centre_deg": [20.0, 0.0]}, **FAR))
    assert tilted[0] - moments(light[::-1, ::-1], receiver)[0] > 0.2


def test_shapes_in_the_far_field_are_angles() -> None:
    """Half of a disc of 60 degrees in solid angle is one of 42.1: 1 - cos halves."""
    disc, receiver = wanted({"kind": "disc", "diameter_deg": 60.0}, **FAR)
    solid_angle = receiver.pixel_measure / disc.max()
    assert solid_angle == pytest.approx(2.0 * np.pi * (1.0 - np.cos(np.radians(30.0))), rel=3e-3)


AXIAL = Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0))
OBLONG = Plane(AXIAL, PixelGrid(120.0, 80.0, 24, 8))  # pixels of 5 x 10 mm


def far_field(half_angle_deg: float, *targets: dict[str, Any], pixels: int = 64) -> tuple[np.ndarray, PosedReceiver]:
    section = FarFieldReceiver(half_angle_deg=half_angle_deg, targets=targets)
    receiver = build_receiver(section, pixels)
    return target_light(section.targets, receiver), receiver


def test_soft_edges_fall_as_the_integral_of_a_gaussian_along_both_sides_of_oblong_pixels() -> None:
    target = RectangleTarget(width_mm=60.0, height_mm=40.0, edge_mm=6.0)
    light = target_light((target,), OBLONG)

    def along(length: float, half: float, count: int) -> np.ndarray:
        fine = ((np.arange(64 * count) + 0.5) / (64 * count) - 0.5) * length
        soft = ndtr((fine + half) / 6.0) - ndtr((fine - half) / 6.0)
        means: np.ndarray = soft.reshape(count, 64).mean(axis=1)
        return means

    expected = np.outer(along(80.0, 20.0, 8), along(120.0, 30.0, 24))
    np.testing.assert_allclose(light, expected / expected.sum(), atol=2e-3 * light.max())


@pytest.mark.parametrize("half_angle", [40.0, 80.0])
def test_soft_edges_of_the_far_field_are_even_angles_wide_and_symmetric(half_angle: float) -> None:
    """A rectangle that the far field does not hold stays even up to its rim; one inside falls with the angle."""
    light, receiver = far_field(
        half_angle, {"kind": "rectangle", "width_deg": 60.0, "height_deg": 350.0, "edge_deg": 4.0}
    )
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    inside = np.hypot(x, y) < half_angle - 3.0
    expected = ndtr((x + 30.0) / 4.0) - ndtr((x - 30.0) / 4.0)
    assert np.abs(light / light.max() - expected)[inside].max() < 5e-3
    for image in (light[::-1], light[:, ::-1]):
        np.testing.assert_allclose(image, light, rtol=0.0, atol=1e-9 * light.max())
    assert not light[np.hypot(x, y) > half_angle + 4.0].any()


def test_targets_add_up_by_their_levels_and_one_that_lies_beside_the_receiver_adds_nothing() -> None:
    left, right = (RectangleTarget(width_mm=width, height_mm=20.0, centre_mm=(x, 0.0), level=level)
                   for width, x, level in ((20.0, -40.0, 2.0), (10.0, 40.0, 0.5)))  # fmt: skip
    beside = RectangleTarget(width_mm=10.0, height_mm=10.0, centre_mm=(500.0, 0.0))
    left_light, right_light = (target_light((section,), OBLONG) for section in (left, right))
    for targets in ((left, right), (left, beside, right)):
        both = target_light(targets, OBLONG)
        np.testing.assert_allclose(both, (8.0 * left_light + right_light) / 9.0, atol=1e-15)  # by level and area
    with pytest.raises(InputError, match="dark everywhere on the receiver"):
        target_light((beside,), OBLONG)


def test_the_region_of_uniform_light_is_that_of_any_target_by_the_centres_of_pixels() -> None:
    """On oblong pixels, moved and turned, and with a strip of so many pixels around it: by loops over pixels."""
    one = RectangleTarget(
        width_mm=9.0, height_mm=9.0, uniform_mm=(40.0, 20.0), centre_mm=(-20.0, 10.0), rotation_deg=30.0
    )
    other = RectangleTarget(width_mm=9.0, height_mm=9.0, uniform_mm=30.0, centre_mm=(25.0, -15.0))
    plain = RectangleTarget(width_mm=9.0, height_mm=9.0)
    for wider in (0.0, 1.5):
        mask = uniform_region((plain, one, other), OBLONG, wider)
        assert mask is not None
        for row, column in np.ndindex(8, 24):
            x, y = -60.0 + 5.0 * (column + 0.5), -40.0 + 10.0 * (row + 0.5)
            turned = np.radians(30.0)
            u = np.cos(turned) * (x + 20.0) + np.sin(turned) * (y - 10.0)
            v = np.cos(turned) * (y - 10.0) - np.sin(turned) * (x + 20.0)
            in_one = abs(u) <= 20.0 + 2.5 * wider and abs(v) <= 10.0 + 5.0 * wider
            in_other = abs(x - 25.0) <= 15.0 + 2.5 * wider and abs(y + 15.0) <= 15.0 + 5.0 * wider
            assert mask[row, column] == (in_one or in_other), (x, y)
    assert uniform_region((plain,), OBLONG) is None


@pytest.mark.parametrize("columns", [8, 31, 128])
def test_light_in_the_target_is_told_by_its_own_shape_on_any_raster(columns: int) -> None:
    """A ring beside the middle, cut by the receiver's edge above: pixels on its edges count in part."""
    receiver = Plane(AXIAL, PixelGrid(120.0, 80.0, columns, max(1, columns // 2)))
    ring = RingTarget(outer_diameter_mm=50.0, inner_diameter_mm=21.0, centre_mm=(17.0, 28.0))
    hits = np.random.default_rng(0).uniform((-70.0, -50.0), (70.0, 50.0), (20_000, 2))
    away = np.hypot(*(hits - (17.0, 28.0)).T)
    expected = (away <= 25.0) & (away > 10.5) & (np.abs(hits) <= (60.0, 40.0)).all(axis=1)
    drawn = drawn_target((ring,), receiver)
    half = coarser_target((ring,), receiver)
    assert (drawn.contains(hits) != expected).mean() < 2e-3
    assert (half.contains(hits) != expected).mean() < 4e-3
    assert half.light.shape == tuple(max(1, side // 2) for side in drawn.light.shape)
    upper = np.pi * (25.0**2 - 10.5**2) - cap_area(25.0, 12.0) + cap_area(10.5, 10.5)
    assert drawn.coverage.sum() * np.prod(receiver.grid.pixel) == pytest.approx(upper, rel=2e-3)


def cap_area(radius: float, height: float) -> float:
    """Area of a disc beyond a chord at ``height`` from its centre."""
    return float(radius**2 * np.arccos(height / radius) - height * np.sqrt(radius**2 - height**2))


def test_a_target_with_soft_edges_ends_at_a_tenth_of_its_light() -> None:
    """As deep in its fading edge, wide or narrow, by sub-pixels or between pixels."""
    for edge in (1.0, 4.0):
        target = RectangleTarget(width_mm=60.0, height_mm=300.0, edge_mm=edge, centre_mm=(5.0, 0.0))
        reach = 30.0 - edge * float(ndtri(0.1))  # Gaussian integral
        places = 5.0 + reach + np.array([-0.3, 0.3])
        hits = np.column_stack([np.append(places, 10.0 - places), np.zeros(4)])
        for side in (24, 240):
            receiver = Plane(AXIAL, PixelGrid(120.0, 80.0, side, side // 3))
            np.testing.assert_array_equal(drawn_target((target,), receiver).contains(hits), [True, False, True, False])
