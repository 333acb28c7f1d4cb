"""Bounds of a table nearby, by which the search for a crossing steps: held against second derivatives by hand."""

import numpy as np
import pytest

from lensforge.kernels.bicubic import surface_bounds
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
