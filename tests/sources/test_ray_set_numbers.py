"""Rays of a set ray by ray: which a sample has and with which flux, place, figures, turns; and what judges a lens."""

import numpy as np
import pytest

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.optics.pose import Pose
from lensforge.search.problem import ValidationRays
from lensforge.sources.build_source import PlacedSource, SquareEmitter
from lensforge.sources.measured_rays import TurnedRays, divided, held_back, searched, smoothed
from lensforge.sources.ray_bundle import LazyRays, RayBundle, blocks_of, changed, chosen, joined, total_flux, with_flux
from lensforge.sources.ray_file_statistics import RaySums
from lensforge.sources.ray_set import RaySetEmitter, placed
from lensforge.spec.source_sections import Placement

COUNT = 7
FLUX = np.array([1.0, 2.0, 0.5, 4.0, 0.25, 3.0, 1.25])


def bundle(count: int = COUNT) -> RayBundle:
    random = np.random.default_rng(count)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return RayBundle(np.arange(3.0 * count).reshape(count, 3), directions, np.resize(FLUX, count))


RAYS = bundle()


@pytest.mark.parametrize("count", [1, 3, 6, 7, 8, 14, 17])
@pytest.mark.parametrize("in_memory", [True, False])
def test_a_sample_has_each_ray_as_often_as_the_count_goes_round(count: int, in_memory: bool) -> None:
    """The rest is drawn without replacement; the parts of a ray share its flux."""
    rays = RAYS if in_memory else LazyRays([RAYS])
    emitter, times = RaySetEmitter(rays, 5.0), [count // COUNT] * COUNT
    for number in np.random.default_rng(9).choice(COUNT, count % COUNT, replace=False):
        times[number] += 1
    expected = [number for number, often in enumerate(times) for _ in range(often)]
    flux = np.array([FLUX[number] / times[number] for number in expected])
    for drawn in (emitter.sample(count, 9), emitter.drawn(count, 9)):
        taken = drawn.take(slice(0, count))
        assert taken.origins[:, 0].tolist() == [3.0 * number for number in expected]
        np.testing.assert_array_equal(taken.directions, RAYS.directions[expected])
        np.testing.assert_allclose(taken.flux, 5.0 * flux / flux.sum())
    assert len(emitter) == emitter.ray_count == COUNT


@pytest.mark.parametrize(("fraction", "training"), [(0.1, 1), (0.5, 4), (0.9, 6), (0.07, None), (0.93, None)])
def test_the_rays_of_a_split_are_those_of_a_permutation_in_the_order_of_the_file(fraction, training) -> None:
    emitter = RaySetEmitter(RAYS, 5.0)
    if training is None or round(fraction * COUNT) in (0, COUNT):
        with pytest.raises(InputError, match=r"of 7 rays leaves one part empty"):
            emitter.split(fraction, 2)
        return
    order = np.random.default_rng(2).permutation(COUNT)
    assert training == round(fraction * COUNT)
    for part, numbers in zip(emitter.split(fraction, 2), (order[:training], order[training:]), strict=True):
        expected = sorted(numbers.tolist())
        assert part.rays.origins[:, 0].tolist() == [3.0 * number for number in expected]
        np.testing.assert_allclose(part.rays.flux, 5.0 * FLUX[expected] / FLUX[expected].sum())


@pytest.mark.parametrize("axis", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_rays_are_shifted_scaled_turned_to_the_axis_mirrored_and_posed(axis: str) -> None:
    """In that order, ray by ray: a cyclic change of the coordinates, or half a turn of the opposite axis."""
    placement = Placement(
        axis=axis, scale=2.0, mirror="y", rotate_z_deg=20.0, tilt_deg=(5.0, -3.0), position_mm=(1, 2, 3)
    )
    origin = np.array([0.5, -1.0, 2.0])
    moved = placed(RAYS, origin, placement)
    pose = placement.pose
    for number in range(COUNT):
        for vector, turned, shift in (
            (2.0 * (RAYS.origins[number] - origin), moved.origins[number], np.array([1.0, 2.0, 3.0])),
            (RAYS.directions[number], moved.directions[number], np.zeros(3)),
        ):
            x, y, z = vector
            cyclic = {"x": (y, z, x), "y": (z, x, y), "z": (x, y, z)}[axis[1]]
            by_hand = np.array(cyclic) * ([1.0, 1.0, 1.0] if axis[0] == "+" else [1.0, -1.0, -1.0])
            expected = pose.rotation @ (by_hand * [1.0, -1.0, 1.0]) + shift
            np.testing.assert_allclose(turned, expected, atol=1e-13)
    np.testing.assert_array_equal(moved.flux, RAYS.flux)
    plain = placed(RAYS, np.zeros(3), Placement())
    np.testing.assert_array_equal(plain.origins, RAYS.origins)
    mirrored = placed(RAYS, np.zeros(3), Placement(mirror="x"))
    np.testing.assert_array_equal(mirrored.directions, RAYS.directions * [-1.0, 1.0, 1.0])


def test_sums_over_rays() -> None:
    sums = RaySums.of(RAYS)
    assert sums.effective_rays == pytest.approx(FLUX.sum() ** 2 / (FLUX**2).sum())
    directions = np.array(
        [[0, 0, 1.0], [0, 0, -1.0], [0, 0, -1.0], [0, 0, -1.0], [1.0, 0, 0], [0, 0, -1.0], [0, 0, 1.0]]
    )
    heights = [0.0, 2.0, 0.0, -1.0, -1e-9, 1e-9, -2.0]
    some = RaySums.of(RayBundle(np.outer(heights, [0.0, 0.0, 1.0]), directions, FLUX))
    assert (some.flux, some.backward) == (FLUX.sum(), FLUX[[1, 2, 3, 5]].sum())
    assert (some.lost, some.below) == (FLUX[[2, 3]].sum(), FLUX[[3, 4, 6]].sum())


def test_rays_that_are_not_in_memory_are_those_that_are() -> None:
    """Changed, chosen, joined and scaled, taken by a slice or by numbers in any order."""
    unread, double, numbers = LazyRays([RAYS]), bundle(3), np.array([5, 0, 6, 2])

    def twice(rays: RayBundle) -> RayBundle:
        return RayBundle(rays.origins, rays.directions, 2.0 * rays.flux)

    for left, loaded in (
        (changed(unread, twice), changed(RAYS, twice)),
        (chosen(unread, numbers), chosen(RAYS, numbers)),
        (joined([unread, double, unread]), joined([RAYS, double, RAYS])),
        (with_flux(unread, 3.0), with_flux(RAYS, 3.0)),
    ):
        assert isinstance(left, LazyRays) and isinstance(loaded, RayBundle) and len(left) == len(loaded)
        for rows in (slice(0, len(loaded)), slice(1, 4), np.array([3, 0, 2, 2])):
            np.testing.assert_array_equal(left.take(rows).origins, loaded.take(rows).origins)
            np.testing.assert_array_equal(left.take(rows).flux, loaded.take(rows).flux)
        assert total_flux(left) == total_flux(loaded) == pytest.approx(loaded.flux.sum())
        assert sum(len(block) for block in blocks_of(left)) == len(loaded)


def turned_by_hand(rays: RayBundle, turns: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """About the crossing with z = 0; rays too flat before, or after, stay as they are."""
    pairs = []
    for start, way, turn in zip(rays.origins, rays.directions, turns, strict=True):
        other = (way + turn) / np.linalg.norm(way + turn)
        flat = abs(way[2]) <= 0.1 or other[2] * np.sign(way[2]) <= 0.05
        crossing = start - start[2] / way[2] * way
        pairs.append((start, way) if flat else (crossing + start[2] / other[2] * other, other))
    return pairs


@pytest.mark.parametrize("posed", [False, True])
def test_each_ray_is_turned_by_a_normal_number_for_each_coordinate(posed: bool) -> None:
    count, sigma, seed = 400, 0.15, 5
    straight = bundle(count)
    pose = Pose.of_tilts((0.3, -0.2, 1.0), (23.0, 0.0)) if posed else Pose()
    turned = TurnedRays(RaySetEmitter(straight.placed(pose), 1.0, pose=pose), sigma).sample(count, seed)
    expected = turned_by_hand(straight, sigma * np.random.default_rng(seed).standard_normal((count, 3)))
    same = [np.array_equal(way, before) for (_, way), before in zip(expected, straight.directions, strict=True)]
    assert 20 < sum(same) < 200, "flat ones stay"
    starts, ways = (np.array(rows) for rows in zip(*expected, strict=True))
    np.testing.assert_allclose(turned.origins, pose.points(starts), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(turned.directions, pose.directions(ways), atol=1e-12)


@pytest.mark.parametrize(("count", "sigma"), [(13_000, 0.15), (30_000, 0.1), (120_000, 0.05)])
def test_rays_are_turned_by_an_angle_within_which_600_of_them_are(count: int, sigma: float) -> None:
    """600 / n = 2 sigma^2 for n rays over a hemisphere, at most 0.15 rad."""
    few = RaySetEmitter(LazyRays([RAYS], np.zeros(count, dtype=int)), 1.0)
    turned = smoothed(few)
    assert turned.sigma_rad == pytest.approx(sigma) and turned.ray_count is None
    assert turned.flux_w == 1.0 and turned.symmetry == "none"


def test_a_measured_source_of_another_kind_is_divided_and_turned_by_its_rays() -> None:
    source = PlacedSource(RaySetEmitter(RAYS, 5.0, symmetry="mirror_x"), Pose())
    first, second = divided(source, 0.5, 2)
    assert (len(first), len(second), first.symmetry, second.flux_w) == (4, 3, "mirror_x", 5.0)
    assert sorted([*first.rays.origins[:, 0], *second.rays.origins[:, 0]]) == RAYS.origins[:, 0].tolist()
    assert isinstance(smoothed(source), TurnedRays)


def test_a_source_of_any_number_of_rays_stays_as_it_is() -> None:
    square = SquareEmitter(1.0, 1.0)
    assert divided(square, 0.8, 1) == (square, square) and held_back(square) is searched(square) is square
    assert smoothed(square) is square
    held, steps = ValidationRays.of(square, 64, 5)
    assert steps is square
    assert np.array_equal(held.samples[0].origins, square.sample(64, seeds.of_validation(5, 0)).origins)
    assert not np.array_equal(held.samples[0].origins, held.samples[1].origins)


def test_what_judges_a_lens_is_no_ray_of_any_search() -> None:
    """Rays that start in z = 0, about which point they are turned."""
    whole = RaySetEmitter(SquareEmitter(2.0).sample(1_000, 0), 2.0)
    judging, search = held_back(whole), searched(whole)
    assert (judging.ray_count, search.ray_count) == (300, 700) and judging.flux_w == search.flux_w == 2.0
    rows = {tuple(np.round(row, 9)) for row in judging.sample(300, 0).origins}
    for seed in range(3):
        held, steps = ValidationRays.of(search, 80, seed)
        for sample in (steps.sample(700, seed), *held.samples):
            assert not rows & {tuple(np.round(row, 9)) for row in sample.origins}


def test_too_few_rays_to_hold_some_back_are_refused() -> None:
    assert held_back(RaySetEmitter(bundle(54), 1.0)).ray_count == 16
    with pytest.raises(InputError, match=r"source: 53 rays are too few .* at least 54"):
        held_back(RaySetEmitter(bundle(53), 1.0))
