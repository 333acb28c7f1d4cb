"""The nearest points of a surface, against its distance by brute force."""

import numpy as np
import pytest
from inlined import alone
from nightly import first_by_day
from scipy.spatial import cKDTree

from lensforge.kernels import clearance
from lensforge.kernels.clearance import nearest_on_table
from lensforge.surfaces.bicubic_table import evaluate_table, grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import grid, to_sphere


@pytest.mark.parametrize("rough", [0.0, 0.7])  # without it many nodes are equally far
def test_the_nearest_node_of_a_window_is_that_of_a_look_at_all(rough: float) -> None:
    rng = np.random.default_rng(7)
    find = alone(clearance.nearest_node)
    nodes = np.stack([*np.mgrid[0:21, 0:21], np.zeros((21, 21))], axis=-1) + rough * rng.normal(size=(21, 21, 3))
    boxes = clearance._boxes(nodes)
    missed = 0
    for _ in range(1000):
        point = rng.integers(-4, 50, size=3) * (0.5, 0.5, 0.1)
        (a, b), (c, d) = (np.sort(rng.choice(22, size=2, replace=False)) for _ in range(2))
        squared = np.full((21, 21), np.inf)
        squared[a:b, c:d] = ((nodes[a:b, c:d] - point) ** 2).sum(axis=-1)
        guess = divmod(int(rng.integers(21**2)), 21)
        best, row, column = find(nodes, boxes, *point, (a, b, c, d), 60.0, guess)
        missed += squared.min() >= 60.0
        wanted = divmod(int(squared.argmin()), 21) if squared.min() < 60.0 else (-1, -1)
        assert (row, column) == wanted and best == pytest.approx(min(squared.min(), 60.0))
    assert 100 < missed < 900


@pytest.mark.parametrize(
    ("functions", "waves", "reach_mm", "wrong"),
    first_by_day(2, [(81, 0.35, 1.5, 0.0), (289, 0.6, 3.0, 0.01), (9, 0.35, 1.5, 0.0)]),
)
def test_each_point_within_reach_of_a_wavy_face_has_its_foot(
    functions: int, waves: float, reach_mm: float, wrong: float
) -> None:
    """No point of 400,000 on the face is nearer, but where valleys lie beside each other; some points are beyond it."""
    rng = np.random.default_rng(functions)
    basis = SrbfBasis((functions,), 1.75)
    face = SrbfSurface(basis, rng.normal(scale=waves, size=functions), 10.0)
    of_table = grid_for(basis.detail_rad, 2.5)
    table = tabulate(of_table, face)
    directions = to_sphere(grid(of_table.nodes)[::2, ::2])
    nodes = face.radius(directions.reshape(-1, 3)).reshape(directions.shape[:2])[:, :, None] * directions
    starts = fibonacci_hemisphere(3000)[:2900]  # but the rim
    radial_mm = rng.uniform(-0.4, 6.0, size=len(starts))
    points = (face.radius(starts) - radial_mm)[:, None] * starts
    feet = nearest_on_table(
        table, of_table.origin, of_table.step, nodes, 2.0 * of_table.step, points, radial_mm, reach_mm
    )

    def on_table(directions: np.ndarray) -> np.ndarray:
        return evaluate_table(of_table, table, directions)[:, None] * directions

    dense_mm, _ = cKDTree(on_table(fibonacci_hemisphere(400_000))).query(points, distance_upper_bound=reach_mm)
    near = np.flatnonzero(np.isfinite(dense_mm))
    assert set(near) <= set(feet.points) and 50 < len(near) < len(feet.points) < 2700, "some others are not looked at"
    found_mm = np.full(len(points), np.inf)
    found_mm[feet.points] = np.linalg.norm(on_table(to_sphere(feet.chart)) - points[feet.points], axis=1)
    excess_mm = found_mm[near] - dense_mm[near]
    assert np.mean(excess_mm > 1e-9) <= wrong
    assert excess_mm.min() > -0.03, "half of the distance between samples"
