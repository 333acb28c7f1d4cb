"""The convergence studies of benchmarks/: orders, noise and bias against closed forms."""

import numpy as np
import pytest
from convergence.pixels import bias, pixel_study
from convergence.runs import TracedRun
from convergence.study import order_of
from convergence.tables import table_normals
from scenes import random_surface, small_spec
from scipy.stats import linregress

from lensforge.scene.lens import Lens
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(100)
SPEC = small_spec(base={"kind": "none"})


@pytest.fixture(scope="module")
def lens():
    inner, outer = (random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2))
    return Lens.double(inner, outer, SPEC, 0, "draft")


def test_normals_of_a_table_by_differences_are_those_of_the_sum(lens):
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fine = TableGrid(400)
    radius, normals = table_normals(fine, tabulate(fine, lens.outer), directions)
    assert np.abs(radius - lens.outer.radius(directions)).max() < 1e-8
    assert np.abs(normals - lens.outer.normal(directions)).max() < 1e-6


def test_the_bias_of_the_splat_is_what_its_second_moment_says():
    """Binning widens a Gaussian by a box's variance, p^2/12, the splat by a triangle's, p^2/6."""
    runs = [
        TracedRun(np.random.default_rng(k).normal(scale=20.0, size=(2**18, 2)), np.full(2**18, 2.0**-18), 1.0, 0.0, 1.0)
        for k in range(8)
    ]
    for level in pixel_study(runs, small_spec(), (10, 16, 20)).levels:
        pitch = 200.0 / level.setting
        box, triangle = 20.0**2 + pitch**2 / 12.0, 20.0**2 + pitch**2 / 6.0
        expected = 1.0 + box / triangle - 4.0 * box / (box + triangle)
        error = level.errors["splat_nmse"]
        assert abs(error.value - expected) < 0.05 * expected + 3.0 * error.standard_error


def test_noise_does_not_count_as_bias():
    noise = np.random.default_rng(1)
    biases = [bias(1.0 + noise.normal(size=(8, 30, 30)), np.ones((8, 30, 30))) for _ in range(50)]
    assert abs(np.mean(biases)) < 4.0 * np.std(biases) / np.sqrt(50)


def test_an_order_is_the_slope_and_knows_its_error():
    n, y = np.array([1e3, 1e4, 1e5, 1e6]), np.array([0.31, 0.12, 0.02, 0.014])
    line, seen = linregress(np.log(n), np.log(y)), order_of(n, y)
    assert (seen.value, seen.standard_error) == pytest.approx((line.slope, line.stderr))
