"""Places of sources: rotations, the symmetry that is left, where the light goes; bundles and blocks of rays."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from landed import by_kernels
from scenes import small_spec, sphere, table_of

import lensforge as lf
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.optics.pose import Pose
from lensforge.sources.build_source import PlacedSource, SquareEmitter, build_source, summarise
from lensforge.sources.ray_bundle import BLOCK_RAYS, ChangedSource, RayBundle, block_slices, drawn, is_round, total_of
from lensforge.spec.source_sections import SquareSource
from lensforge.surfaces.bicubic_table import TableGrid

SLANTED = SquareSource(side_mm=1.0, rotate_z_deg=25.0, tilt_deg=(15.0, -40.0), position_mm=(0.5, -1.0, 2.0))


def test_rays_are_moved_to_the_place_of_their_source_and_back() -> None:
    pose, points = SLANTED.pose, np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]])
    rays = RayBundle(points, points, np.ones(len(points)))
    placed, back = rays.placed(pose), rays.placed(pose).seen_from(pose)
    there = [pose.points(points), pose.directions(points)]
    np.testing.assert_allclose([placed.origins, placed.directions], there, atol=1e-14)
    np.testing.assert_allclose([back.origins, back.directions], [points, points], atol=1e-14)
    assert rays.placed(Pose()) is rays is rays.seen_from(Pose())


PLAIN = RayBundle(np.arange(15.0).reshape(5, 3), np.eye(3)[[0, 1, 2, 0, 1]], np.arange(1.0, 6.0))
BUNDLE = PLAIN.with_wavelengths(np.linspace(400.0, 500.0, 5))
FIELDS = ("origins", "directions", "flux", "wavelengths_nm")


def test_parts_of_a_bundle_have_all_its_fields_and_join_to_it_again() -> None:
    parts = BUNDLE.divided(3)
    assert [len(part) for part in parts] == [1, 2, 2]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(RayBundle.joined(parts), name), getattr(BUNDLE, name))
        np.testing.assert_array_equal(getattr(BUNDLE.take(slice(1, 3)), name), getattr(BUNDLE, name)[1:3])
    again = RayBundle.joined(PLAIN.divided(2))
    assert again.wavelengths_nm is None
    np.testing.assert_array_equal(again.origins, BUNDLE.origins)


def test_a_changed_source_passes_on_all_but_its_rays() -> None:
    square = SquareEmitter(2.0, 4.0)
    changed = ChangedSource(square)
    assert (changed.flux_w, changed.symmetry, changed.ray_count) == (4.0, "square", None)
    np.testing.assert_array_equal(changed.outline(), square.outline())
    np.testing.assert_array_equal(drawn(square, 8, 1).take(slice(0, 8)).origins, square.sample(8, 1).origins)


@pytest.mark.parametrize("count", [0, 1, BLOCK_RAYS, BLOCK_RAYS + 1, 3 * BLOCK_RAYS + 5, 2**20 + 24])
def test_blocks_follow_each_other_and_end_at_the_count(count: int) -> None:
    slices = list(block_slices(count))
    assert slices[0].start == 0 and slices[-1].stop == count
    assert all(block.stop == following.start for block, following in pairwise(slices))
    assert max(block.stop - block.start for block in slices) <= BLOCK_RAYS == 262_144
    assert (len(slices) == 1) == (count <= BLOCK_RAYS)
    values = np.random.default_rng(1).random(count)
    assert total_of(count, [float(values[block].sum()) for block in slices]) == values.sum()
    assert total_of(count, [7.5]) == 7.5


GRID = TableGrid(65)
SPHERES = tuple(table_of(sphere(radius), GRID) for radius in (3.0, 6.0))
SCENE = Scene(Media(Medium(1.5)), GRID)
BEAM = lf.CosineIntensity(power=1e4)


def _traced(spec: lf.SquareSource | lf.DiscSource, count: int = 2**14):
    """Through a lens of two spheres about the origin, onto a plane at 100 mm."""
    return by_kernels([*SPHERES], SCENE, build_source(spec).sample(count, 3), 100.0)


SQUARE, OBLONG = {"kind": "square", "side_mm": 1.0}, {"kind": "rectangle", "width_mm": 2.0, "height_mm": 1.0}


@pytest.mark.parametrize(
    ("source", "symmetry"),
    [
        (SQUARE | {"position_mm": [0, 0, -0.5]}, "square"),
        (SQUARE | {"position_mm": [0.5, 0, 0]}, "mirror_y"),
        (SQUARE | {"position_mm": [0, 0.5, 1]}, "mirror_x"),
        (SQUARE | {"position_mm": [0.5, 0.5, 0]}, "diagonal"),
        (SQUARE | {"tilt_deg": [0, 10]}, "mirror_y"),
        (SQUARE | {"tilt_deg": [10, 0]}, "mirror_x"),
        (SQUARE | {"tilt_deg": [10, 10]}, "none"),
        (SQUARE | {"tilt_deg": [0, 10], "position_mm": [0.5, 0, 0]}, "mirror_y"),
        (SQUARE | {"tilt_deg": [10, 0], "position_mm": [0.5, 0, 0]}, "none"),
        (SQUARE | {"rotate_z_deg": 45}, "square"),
        (SQUARE | {"rotate_z_deg": 45 + 1e-9}, "none"),  # more than rounding
        (SQUARE | {"rotate_z_deg": 180}, "square"),
        (SQUARE | {"rotate_z_deg": 30}, "none"),
        (SQUARE | {"rotate_z_deg": 45, "tilt_deg": [0, 10]}, "mirror_y"),
        (OBLONG | {"rotate_z_deg": 90}, "rectangle"),
        (OBLONG | {"rotate_z_deg": 45}, "diagonal"),
        (OBLONG | {"rotate_z_deg": 90, "tilt_deg": [10, 0]}, "mirror_x"),
    ],
)
def test_the_symmetry_that_its_place_leaves(source, symmetry):
    spec = small_spec(source=source).source
    placed = build_source(spec)
    assert isinstance(placed, PlacedSource) and placed.symmetry == symmetry
    assert summarise(placed, spec).symmetry == symmetry


@pytest.mark.parametrize(
    ("place", "stays_round"),
    [
        ({"position_mm": [0, 0, -0.5], "rotate_z_deg": 25}, True),
        ({"position_mm": [0.5, 0, 0]}, False),
        ({"position_mm": [0, 0.5, 0]}, False),
        ({"tilt_deg": [0, 10]}, False),
        ({"tilt_deg": [10, 0]}, False),
    ],
)
def test_a_disc_is_of_revolution_only_where_it_stands_on_the_axis_along_it(place, stays_round):
    """By its rays turned by 50 degrees about the axis: alike in mean and spread, or not."""
    placed = build_source(small_spec(source={"kind": "disc", "diameter_mm": 1.0, **place}).source)
    assert is_round(placed) == stays_round
    rays = placed.sample(2**12, 3)
    turn = Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 50.0)
    means = [np.mean(np.concatenate([r.origins, r.directions], axis=1), axis=0) for r in (rays, rays.placed(turn))]
    assert np.allclose(*means, atol=0.02) == stays_round


def test_through_concentric_spheres_a_tilted_beam_lands_where_it_points():
    """Rays from the common centre are not refracted: a beam tilted about y lands at x = 100 mm tan 15 deg."""
    landed = _traced(lf.DiscSource(diameter_mm=1e-6, intensity=BEAM, tilt_deg=(0.0, 15.0)))
    assert bool(landed.landed.all())
    np.testing.assert_allclose(landed.hits.median(dim=0).values, [100.0 * np.tan(np.deg2rad(15.0)), 0.0], atol=0.05)


def test_light_of_a_die_in_its_cup_enters_where_it_passes_the_plane_of_the_base():
    """Lambertian point 1 mm below z = 0, an opening of 3 mm: sin^2 = 9 / (9 + 1) of the light enters."""
    landed = _traced(lf.SquareSource(side_mm=0.0, position_mm=(0.0, 0.0, -1.0)), 2**16)
    outside = float((landed.fates == Fate.OUTSIDE_CAVITY).double().mean())
    assert outside == pytest.approx(0.1, abs=1e-4)
    assert float((landed.fates == Fate.BACKWARD).double().mean()) == 0.0


def test_of_a_tilted_die_the_rays_below_the_horizon_are_counted():
    """Lambertian point, tilted by 30 deg: (1 - cos 30) / 2 of its light goes below the horizon, all of it lost."""
    below = 0.5 * (1.0 - np.cos(np.deg2rad(30.0)))
    landed = _traced(lf.SquareSource(side_mm=0.0, tilt_deg=(30.0, 0.0)), 2**16)
    assert float((landed.fates == Fate.BACKWARD).double().mean()) == pytest.approx(below, abs=1e-4)
    assert float(torch.as_tensor(landed.carried).sum()) > 0.9
