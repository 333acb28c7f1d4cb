"""Rays among triangles against all of the triangles, one by one: first hits, and rims that rays pass."""

from functools import cache

import numpy as np
import pytest

from lensforge.kernels.rims import dim_beside_rims
from lensforge.kernels.triangle_tree import any_hits, first_hits, tree_of

FAR = 1e9


def soup(count: int, seed: int) -> np.ndarray:
    """Triangles of all sizes, some of them flat or without area."""
    rng = np.random.default_rng(seed)
    sizes = rng.choice([0.3, 3.0, 30.0], (count, 1, 1))
    corners = 10.0 * rng.normal(size=(count, 1, 3)) + sizes * rng.normal(size=(count, 3, 3))
    corners[::7, 2] = corners[::7, 1]
    corners[::5, :, 2] = corners[::5, :1, 2]
    return corners


def rays(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions[::9, 1] = 0.0  # along the sides of boxes
    directions[::11, :2] = 0.0
    return 15.0 * rng.normal(size=(count, 3)), directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("count", [1, 8, 9, 33, 200, 700])
def test_the_first_hit_is_that_of_all_triangles(count: int) -> None:
    """By the planes of the triangles and the barycentric coordinates of the places there."""
    corners = soup(count, count)
    points, directions = rays(700, 1)
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    area = (normals**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = ((a[None] - points[:, None]) * normals).sum(axis=2) / (directions @ normals.T)
        places = points[:, None] + distances[:, :, None] * directions[:, None]
        shares = [(np.cross(q - p, places - p) * normals).sum(axis=2) / area for p, q in ((a, b), (b, c), (c, a))]
        inside = (np.min(shares, axis=0) >= 0.0) & (distances > 0.0) & (area > 0.0)
    ends = np.resize([np.inf, 20.0, 5.0, 0.0, -np.inf], len(points))
    every = np.where(inside & (distances < ends[:, None]), distances, np.inf)
    tree = tree_of(corners)
    lengths = np.empty(len(points))
    numbers, some = np.empty((2, len(points)), dtype=np.int64)
    first_hits(points, directions, ends, tree, lengths, numbers)
    any_hits(points, directions, ends, tree, some)
    hit = np.isfinite(every).any(axis=1)
    assert ((numbers >= 0) == hit).all() and ((some >= 0) == hit).all()
    assert lengths[hit] == pytest.approx(every[hit].min(axis=1), rel=1e-9)
    assert (lengths[~hit] == ends[~hit]).all()
    assert every[hit, numbers[hit]] == pytest.approx(lengths[hit]) and np.isfinite(every[hit, some[hit]]).all()
    assert count < 30 or 20 < hit.sum() < 690


ORIGIN = np.array([1.0, -2.0, 3.0])


def beside_edges() -> tuple[np.ndarray, ...]:
    """Triangles; starts and directions of rays, and their ends, of which a third are nowhere and a third before."""
    points, directions = rays(300, 2)
    return soup(24, 3), points, directions, np.resize([FAR, 25.0, -1.0], len(points))


@cache
def least_tangents() -> np.ndarray:
    """Of many places of each edge, within the way of the ray, seen from the foot of its line before the origin."""
    corners, points, directions, ends = beside_edges()
    begin = ((points - ORIGIN) * directions).sum(axis=1, keepdims=True)
    feet = points - begin * directions
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    least = np.full(len(points), np.inf)
    for start, end in ((corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)):
        for one, other in zip(start, end, strict=True):
            away = (one + share * (other - one))[None] - feet[:, None]
            along = (away * directions[:, None]).sum(axis=2)
            aside = np.linalg.norm(away - along[:, :, None] * directions[:, None], axis=2)
            counts = (along > np.maximum(begin, 0.0)) & (along < begin + ends[:, None])
            tangents = np.where(counts, aside / np.maximum(along, 1e-9), np.inf)
            least = np.minimum(least, tangents.min(axis=1))
    return least


@pytest.mark.parametrize("rim", [0.02, 0.3])
def test_the_nearest_rim_is_that_of_all_edges(rim: float) -> None:
    corners, points, directions, ends = beside_edges()
    wanted = np.minimum(least_tangents(), rim)
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    weights = np.ones(len(points))
    weights[::7] = 0.0
    by_points, by_directions = np.zeros((2, len(points), 3))
    no_face = np.full(len(points), -1)
    tree = tree_of(edges)
    sides = np.zeros((len(edges), 2), dtype=np.int64)
    dim_beside_rims(points, directions, ends, no_face, ORIGIN, rim, tree, sides, weights, by_points, by_directions)
    x = wanted / rim
    lit = np.arange(len(points)) % 7 > 0
    free = (ends == FAR) & lit  # at the end of a ray an edge may come nearer, or not at all
    assert weights[free] == pytest.approx((x * x * (3.0 - 2.0 * x))[free], abs=3e-3)
    assert not weights[::7].any() and (weights[(ends < 0.0) & lit] == 1.0).all()
    dimmed = (weights > 0.0) & (weights < 1.0)
    assert 5 < dimmed[free].sum() < free.sum()
    for slopes in (by_points, by_directions):
        assert slopes[dimmed].any(axis=1).all() and not slopes[~dimmed].any()
