"""The least irradiance without ray noise: against known pictures, closed forms, and blocks written out."""

from itertools import combinations

import numpy as np
import pytest
from nightly import first_by_day
from noisy_images import bumpy, noisy
from scipy.stats import norm

from lensforge.light.metrics import (
    _Choices,
    _halves,
    _quarters,
    ratio_of,
    uniformity,
    uniformity_estimate,
)
from lensforge.results import Metric

SIDE = 40
EVERYWHERE = np.ones((SIDE, SIDE), dtype=bool)


def _spot(depth: float, width: float = 3.0) -> np.ndarray:
    """A flat top with one dark spot."""
    row, column = np.mgrid[:SIDE, :SIDE]
    return 1.0 - depth * np.exp(-((row - 11.0) ** 2 + (column - 29.0) ** 2) / (2.0 * width**2))


@pytest.mark.parametrize(
    ("truth", "noise"),
    first_by_day(
        3,
        [
            (np.ones((SIDE, SIDE)), 0.01),  # all pixels alike: the noise alone decides
            (bumpy(SIDE, 0.01), 0.001),
            (bumpy(SIDE, 0.01), 0.005),
            (bumpy(SIDE, 0.01), 0.03),  # the noise outweighs the bumps
            (_spot(0.1), 0.002),
            (_spot(0.1), 0.02),
            (np.linspace(0.9, 1.1, SIDE)[:, None] * np.ones((SIDE, SIDE)), 0.01),  # a dark edge of equal pixels
        ],
    ),
    ids=["flat", "bumps, little noise", "bumps", "bumps, much noise", "spot, little noise", "spot", "dark edge"],
)
def test_the_bias_is_within_one_standard_error_which_covers(truth: np.ndarray, noise: float) -> None:
    rng, values, errors, raw = np.random.default_rng(2), [], [], []
    for _ in range(50):
        images = noisy(truth, noise, rng)
        metric = uniformity_estimate(images, EVERYWHERE).metric()
        assert metric.standard_error is not None
        values.append(metric.value)
        errors.append(metric.standard_error)
        raw.append(uniformity(images.mean(axis=0), EVERYWHERE))
    away = np.array(values) - uniformity(truth, EVERYWHERE)
    assert abs(away.mean()) < 0.75 * np.mean(errors)
    assert abs(away.mean()) < 0.5 * abs(np.mean(raw) - uniformity(truth, EVERYWHERE)) + 0.35 * noise
    assert np.mean(np.abs(away) < errors) > 0.5
    assert np.mean(np.abs(away) < 2.0 * np.array(errors)) > 0.87
    assert np.mean(errors) < 2.5 * noise  # one pixel's noise cannot be undercut: no one knows the darkest better


def test_the_blocks_are_balanced() -> None:
    """Each replicate, each pair and each three of them in equally many blocks."""
    for blocks, size, count in ((_halves(), 8, 30), (_quarters(), 4, 140)):
        assert blocks.shape == (count, 16) and set(blocks.ravel()) == {0.0, 1.0}
        assert (blocks.sum(axis=1) == size).all()
        assert len(np.unique(blocks, axis=0)) == count
        for together in (1, 2, 3):
            times = {int(blocks[:, list(chosen)].prod(axis=1).sum()) for chosen in combinations(range(16), together)}
            assert len(times) == 1


def test_two_pixels_follow_clark_and_stein() -> None:
    """Two pixels, one darker by d: the minimum and the value of the chosen one have closed forms (Clark 1961)."""
    d, spread, rng = 0.02, 0.1, np.random.default_rng(8)
    found = []
    for _ in range(500):
        choices = _Choices.of(np.array([1.0, 1.0 + d]) + spread * rng.normal(size=(16, 2)), _halves())
        found.append((choices.minimum, choices.read))
    t = spread**2 / 8.0  # variance of the mean of eight
    theta = np.sqrt(2.0 * t)
    minimum = 1.0 + d * norm.cdf(-d / theta) - theta * norm.pdf(d / theta)
    chosen = 1.0 + d * norm.cdf(-d / theta)
    by_variance = -norm.pdf(d / theta) / theta  # of the minimum, by t
    assert chosen == pytest.approx(minimum - 2.0 * t * by_variance, rel=1e-12)
    means, errors = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(len(found))
    assert abs(means[0] - minimum) < 4.0 * errors[0]
    assert abs(means[1] - chosen) < 4.0 * errors[1]


def test_values_with_one_replicate_left_out_are_those_of_the_others() -> None:
    images = noisy(bumpy(SIDE, 0.01), 0.01, np.random.default_rng(4)).reshape(16, -1)
    for blocks in (_halves(), _quarters()):
        left_out = _Choices.of(images, blocks).left_out(0.7)
        for k in range(16):
            least, readings = [], []
            for block in blocks:
                inside = [j for j in range(16) if block[j]]
                if k not in inside:
                    pixel = images[inside].mean(axis=0).argmin()
                    least.append(images[inside, pixel].mean())
                    readings += [images[j, pixel] for j in range(16) if j not in (*inside, k)]
            u, v = np.mean(least), np.mean(readings)
            assert left_out[k] == pytest.approx(u + 0.7 * (v - u), rel=1e-12)


def test_relative_errors_of_a_ratio_add_in_squares() -> None:
    above, below = Metric(value=3.0, standard_error=0.3), Metric(value=4.0, standard_error=0.2)
    ratio = ratio_of(above, below)
    assert ratio.value == 0.75
    assert ratio.standard_error / ratio.value == pytest.approx(np.hypot(0.1, 0.05))
    assert ratio_of(above, Metric(value=4.0)) == ratio_of(Metric(value=3.0), below) == Metric(value=0.75)
    assert ratio_of(Metric(value=0.03), Metric(value=0.06)).value == pytest.approx(0.5), "little light is light"
    for dark in (0.0, -4.0):
        assert ratio_of(above, Metric(value=dark, standard_error=1.0)) == Metric(value=0.0)
