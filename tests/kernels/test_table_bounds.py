"""Bounds of a table nearby, by which the search for a crossing steps: held against second derivatives by hand."""

import numpy as np
import pytest

from lensforge.kernels.bicubic import _REACH_CELLS, _TILES, surface_bounds
from lensforge.surfaces.bicubic_table import TableGrid

GRID = TableGrid(81)
BEND = 6.0


def saddle(directions: np.ndarray) -> np.ndarray:
    """Radius (mm) of 10 + 6 X Y on the chart, a saddle all of whose bend is in its mixed derivative."""
    x, y = directions[..., :2].T / (1.0 + directions[..., 2].T)
    return 10.0 + BEND * (x * y).T


def test_the_bend_of_a_saddle_is_bounded_by_its_mixed_derivative() -> None:
    """Along great circles through random points; at the pole, where X is half the angle, it is 6/4 mm/rad^2."""
    along = GRID.origin + GRID.step * np.arange(GRID.side)
    bounds = surface_bounds(10.0 + BEND * np.multiply.outer(along, along), GRID.origin, GRID.step)
    rng = np.random.default_rng(1)
    step = 1e-3
    points = rng.normal(size=(4000, 3)) * [1.0, 1.0, 0.7]
    points[0] = 0.0, 0.0, 1.0
    points[:, 2] = np.abs(points[:, 2])
    points /= np.linalg.norm(points, axis=1)[:, None]
    ways = np.cross(points, rng.normal(size=(4000, 3)))
    ways[0] = 1.0, 1.0, 0.0
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    ends = [saddle(np.cos(angle) * points + np.sin(angle) * ways) for angle in (-step, 0.0, step)]
    bends = np.abs(ends[0] - 2.0 * ends[1] + ends[2]) / step**2
    assert bends[0] == pytest.approx(BEND / 4.0, rel=1e-5)
    places = (points[:, :2] / (1.0 + points[:, 2:]) - GRID.origin) * bounds.per_unit
    nearby = bounds.tiles[tuple(places.astype(int).T)]
    assert (nearby[:, 2] >= bends - 1e-4).all()
    assert nearby[0, 2] < 2.0 * BEND / 4.0, "and no more than it needs"


def test_the_bounds_of_a_wild_table_are_those_of_its_differences_in_numpy() -> None:
    """Every coefficient that acts within reach of a tile counts, the outermost too: all are of random size."""
    grid = TableGrid(53)
    table = 10.0 + np.random.default_rng(4).normal(size=(grid.side, grid.side)) ** 3
    bounds = surface_bounds(table, grid.origin, grid.step)
    cells = -(-grid.side // _TILES)
    reach = -(-grid.side // _REACH_CELLS)
    lit = 0
    for a, b in np.ndindex(bounds.tiles.shape[:2]):
        starts = [grid.origin + k * cells * grid.step for k in (a, b)]
        nearest = [max(0.0, start, -(start + cells * grid.step)) for start in starts]
        if np.hypot(*nearest) > 1.0 + grid.step:
            assert not bounds.tiles[a, b].any()
            continue
        lit += 1
        ends = [(max(0, k * cells - reach - 1), min(grid.side, (k + 1) * cells + reach + 2)) for k in (a, b)]
        acting = table[tuple(slice(*end) for end in ends)]
        x, y = (np.abs(np.diff(acting, axis=axis)).max() / grid.step for axis in (0, 1))
        xx, yy = (np.abs(np.diff(acting, 2, axis=axis)).max() / grid.step**2 for axis in (0, 1))
        xy = np.abs(np.diff(np.diff(acting, axis=0), axis=1)).max() / grid.step**2
        far = [max(abs(grid.origin + k * grid.step) for k in (start, end - 1)) for start, end in ends]
        radius = min(np.hypot(*far), 1.0)
        shrink = 0.5 * (1.0 + radius**2)
        slope = np.hypot(x, y)
        bend = np.linalg.eigvalsh([[xx, xy], [xy, yy]])[1]
        wanted = acting.min(), slope * shrink, bend * shrink**2 + slope * radius * shrink
        assert bounds.tiles[a, b] == pytest.approx(wanted, rel=1e-12), (a, b)
    assert lit > 0.7 * bounds.tiles.shape[0] ** 2
