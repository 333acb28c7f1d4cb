"""The outline of a ray set by loops over its rays: crossings, the middle, and the farthest of 95 %."""

import numpy as np
import pytest

from lensforge.optics.pose import Pose
from lensforge.sources import ray_bundle
from lensforge.sources.ray_bundle import LazyRays, RayBundle
from lensforge.sources.ray_set import _around, _crossings, _value_at, outline_of


def rays(count: int, seed: int = 0, down: float = 0.1) -> RayBundle:
    random = np.random.default_rng(seed)
    ways = random.normal(size=(count, 3)) * [0.4, 0.4, 0.2] + [0.0, 0.0, 1.0]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways[random.random(count) < down, 2] *= -1.0
    starts = np.column_stack([random.normal((3.0, -1.0), size=(count, 2)), random.uniform(-1.0, 2.0, count)])
    return RayBundle(starts, ways, random.uniform(0.2, 3.0, count))


def reached(values: list[float], flux: list[float], wanted: float) -> float:
    """The first value, in rising order, up to which there is the flux wanted."""
    total = 0.0
    for value, part in sorted(zip(values, flux, strict=True)):
        total += part
        if total >= wanted:
            return value
    raise ValueError(wanted)


def by_loop(bundle: RayBundle, forward: bool = True) -> tuple[set[tuple[float, float]], float]:
    """Points of the plane within the distance of 95 % of the flux from the middle of the light, and that distance."""
    points, flux = [], []
    for start, way, part in zip(bundle.origins, bundle.directions, bundle.flux, strict=True):
        if (way[2] > 0.0) == forward:
            length = 0.0 if abs(way[2]) < 1e-9 else -start[2] / way[2]
            points.append(start[:2] + length * way[:2])
            flux.append(part)
    middle = [reached([point[axis] for point in points], flux, 0.5 * sum(flux)) for axis in (0, 1)]
    away = [float(np.hypot(*(point - middle))) for point in points]
    radius = reached(away, flux, 0.95 * sum(flux))
    return {tuple(np.round(point, 9)) for point, far in zip(points, away, strict=True) if far <= radius}, radius


def agrees(outline: np.ndarray, points: set[tuple[float, float]]) -> None:
    """Corners are of the points, and no point lies outside of the polygon."""
    corners = outline[:, :2]
    assert {tuple(corner) for corner in np.round(corners, 9)} <= points
    edges = np.roll(corners, -1, axis=0) - corners
    away = np.array(sorted(points))[:, None] - corners
    left = edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]
    assert (left * np.sign(left.sum()) >= -1e-6).all()
    np.testing.assert_array_equal(outline[:, 2], 0.0)


@pytest.mark.parametrize("unread", [False, True])
@pytest.mark.parametrize(("down", "forward"), [(0.1, True), (1.0, False)])
def test_the_outline_is_around_the_nearest_of_the_crossings(
    unread: bool, down: float, forward: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of rays that go up, or, where none does, of those that go down; rays of a file in nine blocks."""
    monkeypatch.setattr(ray_bundle, "BLOCK_RAYS", 100)
    bundle = rays(900, down=down)
    assert (bundle.directions[:, 2] > 0.0).any() == forward
    agrees(outline_of(LazyRays([bundle]) if unread else bundle, Pose()), by_loop(bundle, forward)[0])


def test_the_outline_of_a_posed_source_is_that_of_the_source_posed() -> None:
    bundle, pose = rays(300), Pose.of_tilts((1.0, 2.0, -3.0), (145.0, 0.0))
    posed = bundle.placed(pose)
    assert (posed.directions[:, 2] > 0.0).any() and (posed.directions[:, 2] < 0.0).any()
    outline, expected = outline_of(posed, pose), pose.points(outline_of(bundle, Pose()))
    order, other = np.lexsort(np.round(outline, 6).T), np.lexsort(np.round(expected, 6).T)
    np.testing.assert_allclose(outline[order], expected[other], atol=1e-9)


def test_rays_along_the_plane_stay_where_they_start() -> None:
    ways = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.9e-9], [1.0, 0.0, 1.1e-9], [0.6, 0.0, -0.8], [0.0, 0.6, 0.8]])
    points, flux = _crossings(RayBundle(np.tile([1.0, 2.0, 4.0], (5, 1)), ways, np.arange(1.0, 6.0)), True)
    np.testing.assert_allclose(points, [[1.0, 2.0], [1.0 - 4.0 / 1.1e-9, 2.0], [1.0, -1.0]])
    assert flux.tolist() == [2.0, 3.0, 5.0]


def test_around_leaves_out_the_rays_beyond_95_per_cent() -> None:
    points = np.array([[0.0, 0.0]] * 10 + [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -2.0], [50.0, 0.0]])
    flux = np.ones(15)
    flux[-1] = 0.7  # 14 of 14.7 are within 2 mm: 95.2 %
    assert {tuple(corner) for corner in _around(lambda: [(points, flux)])} == {
        (1.0, 0.0),
        (0.0, 1.0),
        (-1.0, 0.0),
        (0.0, -2.0),
    }
    flux[-1] = 0.8  # 94.6 %
    assert (50.0, 0.0) in {tuple(corner) for corner in _around(lambda: [(points, flux)])}


def test_one_ray_of_many_that_has_the_light_of_many_is_in_the_outline() -> None:
    """No sample of them is likely to hold it: it reaches ten times as far as any other, with 6 % of the flux."""
    count, bundle = 2**20 + 1, rays(2**20 + 1, down=0.0)  # too many to sort
    bundle.directions[:] = (0.0, 0.0, 1.0)
    bundle.origins[:, :2] = np.random.default_rng(5).uniform(-1.0, 1.0, (count, 2))
    bundle.flux[:] = 1.0
    bundle.origins[70_003, :2], bundle.flux[70_003] = (-3.0, 10.0), 0.064 * count
    outline = outline_of(LazyRays([bundle]), Pose())
    assert [-3.0, 10.0, 0.0] in outline.tolist()
    bundle.flux[70_003] = 0.05 * count  # 4.8 %: left out, and all others are within
    np.testing.assert_allclose(outline_of(LazyRays([bundle]), Pose()), outline_of(bundle, Pose()), rtol=0.0, atol=0.0)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_the_value_at_a_share_of_too_many_to_sort_is_that_of_the_sorted(share) -> None:
    random = np.random.default_rng(8)
    for values in (
        random.normal(size=3000),
        100.0 + 1e-9 * random.normal(size=3000),
        random.integers(-2, 3, 3000) * 1.0,
    ):
        flux = random.uniform(0.0, 1.0, len(values))
        expected = reached(values.tolist(), flux.tolist(), share * float(flux.sum()))
        parts = [(values[:700], flux[:700]), (values[700:], flux[700:])]
        assert _value_at(share * float(flux.sum()), len(flux), lambda parts=parts: parts, 50) == expected
