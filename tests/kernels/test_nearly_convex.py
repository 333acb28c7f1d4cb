"""The number that proves crossings of nearly convex faces, and what it proves, against dense samples."""

import numpy as np
import pytest
from chains import clear, collimator, tables_of, upwards
from inlined import alone

import lensforge.light.table_trace as table_trace
from lensforge.kernels.nearly_convex import hollow, least_bend
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table, tabulate
from lensforge.surfaces.reciprocal import ConicFace, PlaneFace

GRID = TableGrid(81)


def test_a_sphere_and_a_plane_bend_as_they_must() -> None:
    for surface, wanted in ((sphere(4.0), 0.25), (PlaneFace(30.0, 8.0), 0.0), (ConicFace(40.0, 5.0, 0.8), 0.2)):
        bend, rho = alone(least_bend)(tabulate(GRID, surface), 50, 45, GRID.origin, GRID.step)
        assert bend == pytest.approx(wanted, abs=2e-3)
        direction = np.array([GRID.origin + 50 * GRID.step, GRID.origin + 45 * GRID.step])
        square = direction @ direction
        up = np.array([[*(2.0 * direction), 1.0 - square]]) / (1.0 + square)
        assert rho == pytest.approx(evaluate_table(GRID, tabulate(GRID, surface), up)[0], rel=1e-12)


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-2])
def test_a_gauge_exceeds_no_chord_by_more_than_its_hollow_says(noise: float) -> None:
    rng = np.random.default_rng(3)
    most = 0.0
    for number in range(20):
        table = tabulate(GRID, collimator(0.1).faces[number % 4].surface)
        table = table * (1.0 + noise * rng.normal(size=table.shape))
        bound = hollow(table, GRID.origin, GRID.step, np.inf, np.empty((2, GRID.side, 2)))
        ends = rng.normal(size=(2, 2000, 3)) * 4.0
        ends[1] = ends[0] + 0.05 * ends[1]
        ends[..., 2] = np.abs(ends[..., 2])
        length = np.linalg.norm(ends[1] - ends[0], axis=1)
        middle = ends.mean(axis=0)
        one, other, centre = (
            np.linalg.norm(p, axis=1) / evaluate_table(GRID, table, p / np.linalg.norm(p, axis=1)[:, None])
            for p in (*ends, middle)
        )
        nearest = np.linalg.norm(middle, axis=1) - 0.5 * length
        impact = np.linalg.norm(np.cross(ends[0], ends[1]), axis=1) / length
        allowed = bound * impact**2 * length**2 / 8.0 / np.maximum(nearest, 1e-9) ** 3
        ratio = (centre - 0.5 * (one + other)) / (allowed + 1e-12)
        most = max(most, float(ratio.max()))
    assert most < 1.0, most


def test_proven_crossings_are_those_of_the_search_without_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    body = collimator(0.05)
    rays = upwards(4000, 3, 0.5)
    tables = tables_of(body, GRID)
    scene = Scene(clear(), GRID, True, None, body.chain(6))
    quick = TracedBundle.of(tables, scene, rays)
    bounds = table_trace.chain_bounds

    def hopeless(*arguments: object) -> object:
        result = bounds(*arguments)
        return result._replace(hollows=np.full_like(result.hollows, np.inf))

    monkeypatch.setattr(table_trace, "chain_bounds", hopeless)
    walked = TracedBundle.of(tables, scene, rays)
    assert np.array_equal(quick.met, walked.met)
    assert not np.array_equal(quick.lengths, walked.lengths), "nothing was found at once"
    assert np.abs(quick.lengths - walked.lengths).max() < 1e-8
