"""The nearest picture of a given sum, under caps: against projections on a simplex, and sums kept."""

import numpy as np
import pytest

from lensforge.scene.possible_light import _filled


def on_simplex(target, total):
    """Nearest non-negative numbers of that sum, by sorting (Held, Wolfe and Crowder 1974)."""
    falling = np.sort(target)[::-1]
    levels = (np.cumsum(falling) - total) / np.arange(1, len(target) + 1)
    level = levels[np.flatnonzero(falling > levels)[-1]]
    return np.maximum(target - level, 0.0)


@pytest.mark.parametrize("total", [0.3, 1.0, 7.0])
def test_without_caps_it_is_the_projection_on_a_simplex(total):
    target = np.random.default_rng(2).uniform(0.0, 1.0, 9)
    found = _filled(target, np.full(9, np.inf), total)
    np.testing.assert_allclose(found, on_simplex(target, total), atol=1e-12)


@pytest.mark.parametrize("total", [0.2, 1.0, 2.5])
def test_under_caps_one_level_is_added_to_all_that_are_neither_dark_nor_full(total):
    chance = np.random.default_rng(3)
    target, caps = chance.uniform(0.0, 0.5, 12), chance.uniform(0.1, 0.6, 12)
    found = _filled(target, caps, total)
    assert found.sum() == pytest.approx(total, abs=1e-12)
    between = (found > 1e-12) & (found < caps - 1e-12)
    assert np.ptp((found - target)[between]) < 1e-12
    level = (found - target)[between][0]
    np.testing.assert_allclose(found, np.clip(target + level, 0.0, caps), atol=1e-12)


def test_caps_that_hold_less_are_filled():
    caps = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(_filled(np.array([0.5, 0.0, 0.1]), caps, 1.0), caps, atol=1e-12)
    assert _filled(np.zeros(0), np.zeros(0), 1.0).size == 0
