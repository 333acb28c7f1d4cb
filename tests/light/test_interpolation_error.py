"""The stated error of interpolation against its definition, by loops over pairs of samples."""

from itertools import permutations

import numpy as np
import pytest

from lensforge.light.angular_grid import finest_grid
from lensforge.light.angular_resolution import _interpolation_error, _Pyramid
from lensforge.sources.ray_bundle import RayBundle

LEVEL, FINER = (3, 3), (2, 2)


def pyramid(count):
    """Samples of few rays of a beam about the axis, on the finest grid of 42 degrees."""
    finest, samples = finest_grid(42.0), []
    for seed in range(count):
        ways = np.random.default_rng(seed).normal(size=(4000, 3)) * [0.3, 0.3, 0.05] + [0.0, 0.0, 1.0]
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        samples.append(finest.deposit(RayBundle(np.zeros((4000, 3)), ways, np.full(4000, 1.0 / 4000))))
    return _Pyramid(finest, np.stack(samples))


def mean_square(added, weights):
    """Mean over all pairs of different samples: what they have in common, without the noise of either."""
    pairs = [np.sum(weights * one * other) for one, other in permutations(added, 2)]
    return np.mean(pairs) / weights.sum()


@pytest.mark.parametrize("count", [3, 6])
def test_it_is_the_root_of_the_mean_square_and_one_standard_error(count):
    made = pyramid(count)
    added, grid = made.difference(LEVEL, FINER), made.grid(FINER)
    coarse = made.table(LEVEL).mean(axis=0)
    refined = grid.refined(grid.coarser("gamma").refined(coarse[None], "c"), "gamma")[0]
    weights = grid.solid_angles * (refined > 0.1 * refined.max())
    left_out = [mean_square(np.delete(added, k, axis=0), weights) for k in range(count)]
    error = np.sqrt((count - 1) / count * np.sum((left_out - np.mean(left_out)) ** 2))
    expected = 4.0 / 3.0 * np.sqrt(max(mean_square(added, weights) + error, 0.0)) / coarse.max()
    assert _interpolation_error(made, LEVEL) == pytest.approx(expected, rel=1e-9)


def test_two_samples_cannot_tell():
    assert _interpolation_error(pyramid(2), LEVEL) is None
