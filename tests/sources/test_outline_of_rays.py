"""The outline of a ray set by loops over its rays: crossings, the middle, the farthest of 95 %, and rays in blocks."""

import numpy as np
import pytest

from lensforge.sources import ray_bundle, ray_set
from lensforge.sources.ray_bundle import ChosenRays, RayBundle
from lensforge.sources.ray_set import _around, _crossings, _inner_radius, _Near, _reached, outline_of
from lensforge.sources.source_pose import SourcePose, rotation_about


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


def by_loop(found: RayBundle, forward: bool = True) -> tuple[set[tuple[float, float]], float]:
    """Points of the plane within the distance of 95 % of the flux from the middle of the light, and that distance."""
    points, flux = [], []
    for start, way, part in zip(found.origins, found.directions, found.flux, strict=True):
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
    unread: bool, down: float, forward: bool, monkeypatch
) -> None:
    """Of rays that go up, or, where none does, of those that go down; in memory, and in blocks of 100."""
    found = rays(900, down=down)
    assert (found.directions[:, 2] > 0.0).any() == forward
    if unread:
        monkeypatch.setattr(ray_bundle, "BLOCK_RAYS", 100)
        monkeypatch.setattr(ray_set, "_SAMPLE", 300)
    outline = outline_of(ChosenRays(found, np.arange(900)) if unread else found, None)
    agrees(outline, by_loop(found, forward)[0])


@pytest.mark.parametrize("heavy", [0, 400, 899])
def test_where_few_rays_have_most_of_the_flux_the_outline_is_the_same(heavy: int, monkeypatch) -> None:
    """A sample of 50 rays says little of where the limit is: the search widens until it is found."""
    found = rays(900, seed=2)
    found.flux[heavy], found.directions[heavy] = 500.0, [0.0, 0.0, 1.0]
    monkeypatch.setattr(ray_bundle, "BLOCK_RAYS", 128)
    monkeypatch.setattr(ray_set, "_SAMPLE", 50)
    agrees(outline_of(ChosenRays(found, np.arange(900)), None), by_loop(found)[0])


def test_the_outline_of_a_posed_source_is_that_of_the_source_posed() -> None:
    own, pose = rays(300), SourcePose(rotation_about("x", 2.5), np.array([1.0, 2.0, -3.0]))
    posed = RayBundle(pose.points(own.origins), pose.directions(own.directions), own.flux)
    assert (posed.directions[:, 2] > 0.0).any() and (posed.directions[:, 2] < 0.0).any()
    found, expected = outline_of(posed, pose), pose.points(outline_of(own, None))
    order, other = np.lexsort(np.round(found, 6).T), np.lexsort(np.round(expected, 6).T)
    np.testing.assert_allclose(found[order], expected[other], atol=1e-9)


def test_rays_along_the_plane_stay_where_they_start() -> None:
    ways = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.9e-9], [1.0, 0.0, 1.1e-9], [0.6, 0.0, -0.8], [0.0, 0.6, 0.8]])
    some = RayBundle(np.tile([1.0, 2.0, 4.0], (5, 1)), ways, np.arange(1.0, 6.0))
    points, flux = _crossings(some, None, True)
    np.testing.assert_allclose(points, [[1.0, 2.0], [1.0 - 4.0 / 1.1e-9, 2.0], [1.0, -1.0]])
    assert flux.tolist() == [2.0, 3.0, 5.0]
    points, flux = _crossings(some, None, False)
    np.testing.assert_allclose(points, [[1.0, 2.0], [4.0, 2.0]])
    assert flux.tolist() == [1.0, 4.0]


VALUES, FLUX = np.array([5.0, 1.0, 3.0, 2.0]), np.array([1.0, 2.0, 3.0, 4.0])  # up to 1, 2, 3, 5: 2, 6, 9, 10


@pytest.mark.parametrize(
    ("wanted", "below", "value"),
    [
        (1.0, 0.0, 1.0), (2.0, 0.0, 1.0), (2.001, 0.0, 2.0), (6.0, 0.0, 2.0), (9.5, 0.0, 5.0), (10.0, 0.0, 5.0),
        (10.001, 0.0, None), (3.5, 1.0, 2.0), (3.0, 1.0, 1.0), (1.0, 1.0, None), (0.5, 1.0, None), (0.0, 0.0, None),
    ],
)  # fmt: skip
def test_the_value_up_to_which_there_is_a_flux_is_one_of_the_values_or_none(wanted, below, value) -> None:
    assert _reached(VALUES, FLUX, wanted, below) == value


def test_only_rays_near_the_limit_are_kept_and_the_flux_of_those_below_is_counted() -> None:
    near = _Near(lambda points: points[:, 0], 2.0, 3.0)
    near.add(np.column_stack([VALUES, VALUES]), FLUX)
    near.add(np.array([[2.5, 0.0], [1.999, 0.0]]), np.array([0.5, 0.25]))
    assert near.below == 2.25 and np.concatenate(near.values).tolist() == [3.0, 2.0, 2.5]
    assert np.concatenate(near.flux).tolist() == [3.0, 4.0, 0.5]
    assert (near.limit(6.25), near.limit(6.3), near.limit(7.0), near.limit(9.76)) == (2.0, 2.5, 3.0, None)


def test_the_disc_inside_a_polygon_touches_its_nearest_side() -> None:
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    assert _inner_radius(square, np.array([1.0, 1.5])) == pytest.approx(1.0, rel=1e-8)
    assert _inner_radius(square, np.array([1.0, 1.5])) < 1.0
    assert _inner_radius(square, np.array([-0.5, 1.0])) == pytest.approx(-0.5, rel=1e-8)
    slanted = np.array([[0.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    assert _inner_radius(slanted, np.array([1.0, 2.0])) == pytest.approx(1.0, rel=1e-8)
    assert _inner_radius(square[:2], np.array([1.0, 0.0])) == -1.0
    twice = np.array([[0.0, 0.0], [0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    assert np.isfinite(_inner_radius(twice, np.array([1.0, 1.0])))


def test_around_leaves_out_the_rays_beyond_95_per_cent() -> None:
    points = np.array([[0.0, 0.0]] * 10 + [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -2.0], [50.0, 0.0]])
    flux = np.ones(15)
    flux[-1] = 0.7  # 14 of 14.7 are within 2 mm: 95.2 %
    assert {tuple(corner) for corner in _around(points, flux)} == {(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -2.0)}
    flux[-1] = 0.8  # 94.6 %
    assert (50.0, 0.0) in {tuple(corner) for corner in _around(points, flux)}
