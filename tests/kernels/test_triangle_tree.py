"""Rays among triangles against all of the triangles, one by one: first hits, and rims that rays pass."""

from functools import cache

import numpy as np
import pytest

from lensforge.kernels.triangle_tree import first_hits, nearest_rims, tree_of

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


@pytest.mark.parametrize("count", [1, 4, 5, 9, 33, 200])
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
    every = np.where(inside, distances, np.inf)
    lengths = np.empty(len(points))
    numbers = np.empty(len(points), dtype=np.int64)
    first_hits(points, directions, tree_of(corners), lengths, numbers)
    assert lengths == pytest.approx(every.min(axis=1), rel=1e-9)
    hit = np.isfinite(lengths)
    assert (numbers[~hit] == -1).all() and (every[hit, numbers[hit]] == pytest.approx(lengths[hit]))
    assert count < 30 or 20 < hit.sum() < 690


def beside_edges() -> tuple[np.ndarray, ...]:
    """Triangles; starts, directions and spans of rays, half of which have no end."""
    points, directions = rays(300, 2)
    spans = np.tile([2.0, 25.0], (len(points), 1))
    spans[::2, 1] = FAR
    return soup(24, 3), points, directions, spans


@cache
def least_tangents() -> np.ndarray:
    """Least distance from each ray over that along it, of many places of each edge within the span of the ray."""
    corners, points, directions, spans = beside_edges()
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    least = np.full(len(points), np.inf)
    for start, end in ((corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)):
        for one, other in zip(start, end, strict=True):
            away = (one + share * (other - one))[None] - points[:, None]
            along = (away * directions[:, None]).sum(axis=2)
            aside = np.linalg.norm(away - along[:, :, None] * directions[:, None], axis=2)
            counts = (along > spans[:, :1]) & (along < spans[:, 1:])
            tangents = np.where(counts, aside / np.maximum(along, 1e-9), np.inf)
            least = np.minimum(least, tangents.min(axis=1))
    return least


@pytest.mark.parametrize("most", [0.02, 0.3])
def test_the_nearest_rim_is_that_of_all_edges(most: float) -> None:
    corners, points, directions, spans = beside_edges()
    wanted = np.minimum(least_tangents(), most)
    distances = np.empty(len(points))
    rims = np.zeros((len(points), 3))
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    nearest_rims(points, directions, spans, most, tree_of(edges), distances, rims)
    free = spans[:, 1] == FAR  # at the end of a span an edge may come nearer still, or not at all
    assert distances[free] == pytest.approx(wanted[free], abs=2e-3 * most)
    assert 10 < (distances < most).sum() < len(points)
    close = np.flatnonzero(distances < most)
    away = rims[close] - points[close]
    along = (away * directions[close]).sum(axis=1)
    assert np.linalg.norm(np.cross(away, directions[close]), axis=1) / along == pytest.approx(
        distances[close], rel=1e-9
    )
    assert ((along > 2.0) & (along < spans[close, 1])).all()
