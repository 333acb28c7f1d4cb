"""Patterns as means over pixels: oblong pixels, soft edges in closed form, the far field, and what is kept."""

from typing import Any

import numpy as np
import pytest
from scenes import small_spec
from scipy.special import ndtr, ndtri

from lensforge.errors import InputError
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver, ReceiverPose
from lensforge.scene.receiver_shapes import Plane, receivers_of
from lensforge.scene.target_pattern import coarser_target, drawn_target, target_light, uniform_region
from lensforge.spec import RectangleTarget
from lensforge.spec.shape_targets import RingTarget

AXIAL = ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0))
OBLONG = Plane(AXIAL, PixelGrid(120.0, 80.0, 24, 8))  # pixels of 5 x 10 mm


def far_field(half_angle_deg: float, *targets: dict[str, Any], pixels: int = 64) -> tuple[np.ndarray, PosedReceiver]:
    section = {"kind": "far_field", "half_angle_deg": half_angle_deg, "targets": list(targets)}
    spec = small_spec(target=None, receivers=[section])
    (receiver,) = receivers_of(spec, pixels)
    return target_light(spec.all_receivers[0].targets, receiver), receiver


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
    one, other = (target_light((each,), OBLONG) for each in (left, right))
    for targets in ((left, right), (left, beside, right)):
        both = target_light(targets, OBLONG)
        np.testing.assert_allclose(both, (8.0 * one + other) / 9.0, atol=1e-15)  # by level and area
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
        found = uniform_region((plain, one, other), OBLONG, wider)
        assert found is not None
        for row, column in np.ndindex(8, 24):
            x, y = -60.0 + 5.0 * (column + 0.5), -40.0 + 10.0 * (row + 0.5)
            turned = np.radians(30.0)
            u = np.cos(turned) * (x + 20.0) + np.sin(turned) * (y - 10.0)
            v = np.cos(turned) * (y - 10.0) - np.sin(turned) * (x + 20.0)
            in_one = abs(u) <= 20.0 + 2.5 * wider and abs(v) <= 10.0 + 5.0 * wider
            in_other = abs(x - 25.0) <= 15.0 + 2.5 * wider and abs(y + 15.0) <= 15.0 + 5.0 * wider
            assert found[row, column] == (in_one or in_other), (x, y)
    assert uniform_region((plain,), OBLONG) is None


@pytest.mark.parametrize("columns", [8, 31, 128])
def test_light_in_the_target_is_told_by_its_own_shape_on_any_raster(columns: int) -> None:
    """A ring beside the middle, cut by the receiver's edge above: pixels on its edges count in part."""
    receiver = Plane(AXIAL, PixelGrid(120.0, 80.0, columns, max(1, columns // 2)))
    ring = RingTarget(outer_diameter_mm=50.0, inner_diameter_mm=21.0, centre_mm=(17.0, 28.0))
    hits = np.random.default_rng(0).uniform((-70.0, -50.0), (70.0, 50.0), (20_000, 2))
    away = np.hypot(*(hits - (17.0, 28.0)).T)
    expected = (away <= 25.0) & (away > 10.5) & (np.abs(hits) <= (60.0, 40.0)).all(axis=1)
    drawn, half = drawn_target((ring,), receiver), coarser_target((ring,), receiver)
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
