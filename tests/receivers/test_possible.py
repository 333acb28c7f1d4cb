"""Upper bounds of the light in a region: kept by every lens, and closed forms of both laws."""

import numpy as np
import pytest

from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.possible import largest_share
from lensforge.sources.bundle import RayBundle
from lensforge.sources.square import SquareEmitter

RAYS = SquareEmitter(2.0).sample(2**14, 1)


def whole(grid: PixelGrid) -> np.ndarray:
    return np.ones((grid.pixels, grid.pixels), dtype=bool)


def test_a_small_far_target_holds_its_share_of_a_lambertian_source() -> None:
    """pi r^2 (side / distance)^2 of the source's pi A."""
    grid = PixelGrid(10.0, 8)
    found = largest_share(RAYS, whole(grid), grid, 1000.0, 15.0, 1.5)
    assert found.by_etendue == pytest.approx(15.0**2 * 1e-4 / 4.0, rel=0.25)
    assert found.by_refraction == 1.0 and found.value == found.by_etendue
    assert "étendue" in str(found)


def test_only_the_chosen_pixels_count_and_none_hold_nothing() -> None:
    grid = PixelGrid(10.0, 8)
    half = whole(grid)
    half[:, :4] = False
    some = largest_share(RAYS, half, grid, 1000.0, 15.0, 1.5).by_etendue
    assert some == pytest.approx(0.5 * largest_share(RAYS, whole(grid), grid, 1000.0, 15.0, 1.5).by_etendue, rel=0.1)
    assert largest_share(RAYS, ~whole(grid), grid, 1000.0, 15.0, 1.5).value == 0.0


def test_without_a_lens_the_bound_is_kept_by_straight_rays() -> None:
    """Index 1: light flies straight. What lands in the region never exceeds either bound, and comes near the second."""
    for side, distance in ((20.0, 30.0), (100.0, 30.0), (30.0, 300.0)):
        grid = PixelGrid(side, 4)
        found = largest_share(RAYS, whole(grid), grid, distance, 2.0, 1.0)
        hits = RAYS.origins[:, :2] + distance * RAYS.directions[:, :2] / RAYS.directions[:, 2:]
        landed = float((np.abs(hits) <= 0.5 * side).all(axis=1).mean())
        assert landed <= found.by_refraction and landed <= 1.1 * found.by_etendue
        assert found.by_refraction < 3.5 * landed


def test_a_collimated_source_reaches_no_target_far_to_its_side() -> None:
    """Straight up, and a target at 60 to 70 degrees: an index of 1.1 turns rays by 49 degrees, one of 1.5 by 96."""
    up = np.zeros_like(RAYS.directions) + np.array([0.0, 0.0, 1.0])
    rays = RayBundle(RAYS.origins, up, RAYS.flux)
    grid = PixelGrid(600.0, 64)
    side = grid.axis_mm()[None, :] > 200.0
    pixels = np.broadcast_to(side, (64, 64)) & (np.abs(grid.axis_mm())[:, None] < 30.0)
    weak = largest_share(rays, pixels, grid, 100.0, 3.0, 1.05)
    assert weak.by_refraction == 0.0 and "deviation" in str(weak)
    assert largest_share(rays, pixels, grid, 100.0, 3.0, 1.5).by_refraction == 1.0
    colours = RayBundle(rays.origins, up, rays.flux, np.linspace(1.05, 1.5, len(rays)))
    assert largest_share(colours, pixels, grid, 100.0, 3.0, 1.05).by_refraction == 1.0, "the rays' own indices"


def test_light_beside_the_origin_comes_from_where_it_leaves_the_lens() -> None:
    """Straight up from a 2 mm square: a sixteenth of the light lands in a pixel of 0.5 mm off the axis."""
    up = RayBundle(RAYS.origins, np.zeros_like(RAYS.directions) + np.array([0.0, 0.0, 1.0]), RAYS.flux)
    grid = PixelGrid(2.0, 4)
    pixels = np.zeros((4, 4), dtype=bool)
    pixels[2, 3] = True
    assert largest_share(up, pixels, grid, 5.0, 3.0, 1.0).by_refraction >= 1.0 / 16.0
