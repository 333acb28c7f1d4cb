"""Upper bounds of the light in a region: kept by every lens, and closed forms of both laws."""

import numpy as np
import pytest

from lensforge.receivers.cylinder import Cylinder
from lensforge.receivers.far_field import FarField, chart_radius
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.plane import Plane
from lensforge.receivers.pose import ReceiverPose
from lensforge.receivers.posed import PosedReceiver
from lensforge.receivers.possible import largest_share
from lensforge.sources.bundle import RayBundle
from lensforge.sources.square import SquareEmitter

RAYS = SquareEmitter(2.0).sample(2**14, 1)


def plane(side_mm: float, pixels: int, distance_mm: float) -> Plane:
    return Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance_mm)), PixelGrid.square(side_mm, pixels))


def whole(receiver: PosedReceiver) -> np.ndarray:
    return np.ones(receiver.grid.shape, dtype=bool)


def test_a_small_far_target_holds_its_share_of_a_lambertian_source() -> None:
    """pi r^2 (side / distance)^2 of the source's pi A."""
    receiver = plane(10.0, 8, 1000.0)
    found = largest_share(RAYS, whole(receiver), receiver, 15.0, 1.5)
    assert found.by_etendue == pytest.approx(15.0**2 * 1e-4 / 4.0, rel=0.25)
    assert found.by_refraction == 1.0 and found.value == found.by_etendue
    assert "étendue" in str(found)


def test_only_the_chosen_pixels_count_and_none_hold_nothing() -> None:
    receiver = plane(10.0, 8, 1000.0)
    half = whole(receiver)
    half[:, :4] = False
    some = largest_share(RAYS, half, receiver, 15.0, 1.5).by_etendue
    assert some == pytest.approx(0.5 * largest_share(RAYS, whole(receiver), receiver, 15.0, 1.5).by_etendue, rel=0.1)
    assert largest_share(RAYS, ~whole(receiver), receiver, 15.0, 1.5).value == 0.0


def test_without_a_lens_the_bound_is_kept_by_straight_rays() -> None:
    """Index 1: light flies straight. What lands in the region never exceeds either bound, and comes near the second."""
    for side, distance in ((20.0, 30.0), (100.0, 30.0), (30.0, 300.0)):
        receiver = plane(side, 4, distance)
        found = largest_share(RAYS, whole(receiver), receiver, 2.0, 1.0)
        hits = RAYS.origins[:, :2] + distance * RAYS.directions[:, :2] / RAYS.directions[:, 2:]
        landed = float((np.abs(hits) <= 0.5 * side).all(axis=1).mean())
        assert landed <= found.by_refraction and landed <= 1.1 * found.by_etendue
        assert found.by_refraction < 3.5 * landed


def test_a_collimated_source_reaches_no_target_far_to_its_side() -> None:
    """Straight up, and a target at 60 to 70 degrees: an index of 1.1 turns rays by 49 degrees, one of 1.5 by 96."""
    up = np.zeros_like(RAYS.directions) + np.array([0.0, 0.0, 1.0])
    rays = RayBundle(RAYS.origins, up, RAYS.flux)
    receiver = plane(600.0, 64, 100.0)
    pixels = (receiver.grid.x()[None, :] > 200.0) & (np.abs(receiver.grid.y())[:, None] < 30.0)
    weak = largest_share(rays, pixels, receiver, 3.0, 1.05)
    assert weak.by_refraction == 0.0 and "deviation" in str(weak)
    assert largest_share(rays, pixels, receiver, 3.0, 1.5).by_refraction == 1.0
    colours = RayBundle(rays.origins, up, rays.flux, np.linspace(1.05, 1.5, len(rays)))
    assert largest_share(colours, pixels, receiver, 3.0, 1.05).by_refraction == 1.0, "the rays' own indices"


def test_light_beside_the_origin_comes_from_where_it_leaves_the_lens() -> None:
    """Straight up from a 2 mm square: a sixteenth of the light lands in a pixel of 0.5 mm off the axis."""
    up = RayBundle(RAYS.origins, np.zeros_like(RAYS.directions) + np.array([0.0, 0.0, 1.0]), RAYS.flux)
    pixels = np.zeros((4, 4), dtype=bool)
    pixels[2, 3] = True
    assert largest_share(up, pixels, plane(2.0, 4, 5.0), 3.0, 1.0).by_refraction >= 1.0 / 16.0


def test_étendue_into_the_far_field_and_onto_screens_around_the_lens() -> None:
    """A Lambertian 2 mm square has 4 pi mm^2 sr; a ball of 3 mm sends 9 pi times the solid angle of a cone."""
    upright = ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    gamma = 20.0
    far = FarField(upright, PixelGrid.square(2.0 * chart_radius(gamma), 64))
    x, y = np.meshgrid(far.grid.x(), far.grid.y())
    cone = np.hypot(x, y) <= chart_radius(gamma)
    share = 9.0 * np.pi * 2.0 * np.pi * (1.0 - np.cos(np.radians(gamma))) / (4.0 * np.pi)
    assert largest_share(RAYS, cone, far, 3.0, 1.5).by_etendue == pytest.approx(share, rel=0.1)
    assert largest_share(RAYS, cone, far, 1.0, 1.5).by_etendue == pytest.approx(share / 9.0, rel=0.15)
    screen = Cylinder(upright, PixelGrid(30.0, 30.0, 32, 32), radius_mm=300.0)
    assert largest_share(RAYS, whole(screen), screen, 3.0, 1.5).by_etendue == pytest.approx(9.0 * 0.01 / 4.0, rel=0.25)
