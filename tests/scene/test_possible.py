"""Upper bounds of the light in a region: kept by every lens, and closed forms of both laws."""

import numpy as np
import pytest
from scipy.optimize import minimize

from lensforge.optics.fundamental_limits import normal_transmittance
from lensforge.optics.media import Media
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.possible_light import EtendueCurve, LargestShare, PossibleLight, SourceLight
from lensforge.scene.receiver import PosedReceiver, ReceiverPose
from lensforge.scene.receiver_shapes import FarField, Plane
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle

SQUARE = SquareEmitter(2.0)
RAYS = SQUARE.sample(2**14, 0)


def straight_up(index: float, indices: np.ndarray | None = None) -> SourceLight:
    """The rays of the square, all of them along the axis."""
    up = np.zeros_like(RAYS.directions) + np.array([0.0, 0.0, 1.0])
    rays = RayBundle(RAYS.origins, up, RAYS.flux, indices)
    return SourceLight.of_rays(rays, EtendueCurve.of(rays), Media(index))


def possible(receiver: PosedReceiver, radius_mm: float, light: float | SourceLight) -> PossibleLight:
    """Bounds of some light; of the square's for a refractive index."""
    return PossibleLight(
        light if isinstance(light, SourceLight) else SourceLight.of(SQUARE, Media(light)), receiver, radius_mm
    )


def largest_share(
    pixels: np.ndarray, receiver: PosedReceiver, radius_mm: float, light: float | SourceLight
) -> LargestShare:
    return possible(receiver, radius_mm, light).in_region(pixels)


def plane(side_mm: float, pixels: int, distance_mm: float) -> Plane:
    return Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance_mm)), PixelGrid.square(side_mm, pixels))


def whole(receiver: PosedReceiver) -> np.ndarray:
    return np.ones(receiver.grid.shape, dtype=bool)


def test_a_small_far_target_holds_its_share_of_a_lambertian_source() -> None:
    """pi r^2 (side / distance)^2 of the source's pi A, and what two faces transmit of it."""
    receiver = plane(10.0, 8, 1000.0)
    found = largest_share(whole(receiver), receiver, 15.0, 1.5)
    assert found.by_etendue == pytest.approx(normal_transmittance(1.5) ** 2 * 15.0**2 * 1e-4 / 4.0, rel=1e-3)
    assert found.by_etendue < found.by_refraction < normal_transmittance(1.5) ** 2 and found.value == found.by_etendue
    assert "étendue" in str(found)


def test_without_a_lens_the_bound_is_kept_by_straight_rays() -> None:
    """Index 1: light flies straight. What lands in the region never exceeds either bound, and comes near the second."""
    for side, distance in ((20.0, 30.0), (100.0, 30.0), (30.0, 300.0)):
        receiver = plane(side, 4, distance)
        found = largest_share(whole(receiver), receiver, 2.0, 1.0)
        hits = RAYS.origins[:, :2] + distance * RAYS.directions[:, :2] / RAYS.directions[:, 2:]
        landed = float((np.abs(hits) <= 0.5 * side).all(axis=1).mean())
        assert landed <= found.by_refraction and landed <= 1.1 * found.by_etendue
        assert found.by_refraction < 3.5 * landed


def test_a_collimated_source_reaches_no_target_far_to_its_side() -> None:
    """Straight up, and a target at 60 to 70 degrees: an index of 1.1 turns rays by 49 degrees, one of 1.5 by 96."""
    receiver = plane(600.0, 64, 100.0)
    pixels = (receiver.grid.x()[None, :] > 200.0) & (np.abs(receiver.grid.y())[:, None] < 30.0)
    weak = largest_share(pixels, receiver, 3.0, straight_up(1.05))
    assert weak.by_refraction == 0.0 and "refractions" in str(weak)
    some = largest_share(pixels, receiver, 3.0, straight_up(1.5)).by_refraction
    assert 0.5 < some < normal_transmittance(1.5) ** 2, "the turn costs some of it"
    colours = straight_up(1.05, np.linspace(1.05, 1.5, len(RAYS)))
    assert 0.1 < largest_share(pixels, receiver, 3.0, colours).by_refraction < some, "the rays' own indices"


def test_light_beside_the_origin_comes_from_where_it_leaves_the_lens() -> None:
    """Straight up from a 2 mm square: a sixteenth of the light lands in a pixel of 0.5 mm off the axis."""
    pixels = np.zeros((4, 4), dtype=bool)
    pixels[2, 3] = True
    assert largest_share(pixels, plane(2.0, 4, 5.0), 3.0, straight_up(1.0)).by_refraction >= 1.0 / 16.0


def test_a_point_source_is_bounded_by_refraction_alone() -> None:
    physics = possible(plane(1.0, 8, 1000.0), 15.0, SourceLight.of(SquareEmitter(0.0), Media(1.5)))
    assert physics.in_region(whole(physics.receiver)).by_etendue == pytest.approx(normal_transmittance(1.5) ** 2)
    assert physics.radius_for(whole(physics.receiver), 0.5) == 0.0 and not physics.light.curve.estimated


def test_the_least_nmse_is_that_of_the_nearest_pattern_within_the_bounds() -> None:
    """Against a general solver of the same problem, on 5 x 5 pixels with bounds that bind."""
    receiver = plane(8.0, 5, 1000.0)
    physics = possible(receiver, 40.0, 1.5)
    target = np.exp(-(np.linspace(-1.5, 1.5, 5)[:, None] ** 2)) * np.exp(-(np.linspace(-1.5, 1.5, 5) ** 2))
    target /= target.sum()
    region = target > 0.1 * target.max()
    for arriving in (0.006, 0.01, 0.02):
        caps = np.maximum(physics.on_pixels.ravel() / arriving, 0.0)
        found = physics.least_nmse(target, region, arriving)
        assert caps.sum() > 1.0 and (caps < target.ravel()).any(), "some bounds bind, all together leave room"
        best = minimize(
            lambda pattern: np.sum((pattern - target.ravel()) ** 2),
            caps / caps.sum(),
            jac=lambda pattern: 2.0 * (pattern - target.ravel()),
            bounds=[(0.0, cap) for cap in caps],
            constraints={"type": "eq", "fun": lambda pattern: pattern.sum() - 1.0},
            options={"ftol": 1e-14, "maxiter": 1000},
        )
        assert best.success and found == pytest.approx(best.fun / np.sum(target**2), rel=1e-4, abs=1e-9)
    assert physics.least_nmse(target, region, 1e-6) == pytest.approx(0.0, abs=1e-12), (
        "little light can have any pattern"
    )


@pytest.mark.parametrize("width_mm", [50.0, 400.0, 2500.0])
def test_the_bound_of_a_window_is_that_of_a_receiver_of_its_size(width_mm: float) -> None:
    """Whether the window is narrower than the receiver, or wider and to both sides of what the light can reach."""
    pose = ReceiverPose.facing((0.2, -0.1, 1.0), (60.0, -40.0, 500.0))
    receiver = Plane(pose, PixelGrid(200.0, 120.0, 40, 24), Window(width_mm, 0.4 * width_mm))
    own = Plane(pose, PixelGrid(width_mm, 0.4 * width_mm, 40, 24))
    found, expected = possible(receiver, 9.0, 1.5).in_window(), largest_share(whole(own), own, 9.0, 1.5)
    assert found.by_etendue == pytest.approx(expected.by_etendue, rel=1e-9)
    assert found.by_refraction == pytest.approx(expected.by_refraction, rel=1e-9)


def test_the_bound_of_a_round_window_is_that_of_its_solid_angle() -> None:
    pose = ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    radius = 2.0 * np.sin(np.radians(4.0))  # 8 degrees
    receiver = FarField(pose, PixelGrid.square(2.0 * radius, 33), Window(radius=radius))
    found = possible(receiver, 3.0, 1.5).in_window()
    expected = normal_transmittance(1.5) ** 2 * 9.0 * np.pi * np.sin(np.radians(4.0)) ** 2
    assert found.by_etendue == pytest.approx(expected, rel=3e-3)
