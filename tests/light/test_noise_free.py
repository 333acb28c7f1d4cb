"""Squared metrics without ray noise: against pictures that are known, and against sums over pairs written out."""

from itertools import permutations

import numpy as np
import pytest
from noisy_images import bumpy, noisy

from lensforge.light.metrics import _error_over_pairs, nmse, nmse_estimate, relative_deviation, rsd_estimate

SIDE = 24
EVERYWHERE = np.ones((SIDE, SIDE), dtype=bool)
TARGET = np.ones((SIDE, SIDE)) / SIDE**2


def _estimates(truth: np.ndarray, noise: float, repeats: int = 150) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Value and standard error of each repeat, by metric."""
    rng = np.random.default_rng(5)
    found: dict[str, list[tuple[float, float]]] = {"nmse": [], "rsd": []}
    for _ in range(repeats):
        images = noisy(truth, noise, rng)
        for name, metric in (
            ("nmse", nmse_estimate(images, TARGET).metric()),
            ("rsd", rsd_estimate(images, EVERYWHERE).metric()),
        ):
            assert metric.standard_error is not None
            found[name].append((metric.value, metric.standard_error))
    return {name: (np.array(rows)[:, 0], np.array(rows)[:, 1]) for name, rows in found.items()}


@pytest.mark.parametrize(
    ("deviation", "noise", "seen"), [(0.3, 0.02, True), (0.03, 0.02, True), (0.03, 0.1, False), (0.003, 0.02, False)]
)
def test_estimates_are_without_bias_and_their_errors_cover(deviation: float, noise: float, seen: bool) -> None:
    """Light that is further from its flat target than the noise, and closer, so that its RSD is not ``seen``."""
    truth = bumpy(SIDE, deviation)
    by_metric = {"nmse": nmse(truth, TARGET), "rsd": relative_deviation(truth, EVERYWHERE)}
    assert by_metric["rsd"] == pytest.approx(np.sqrt(by_metric["nmse"]), rel=1e-12)
    for name, (values, errors) in _estimates(truth, noise).items():
        away = values - by_metric[name]
        small = name == "rsd" and not seen  # its square is often below 0, and the root is then 0
        assert abs(away.mean()) < (0.5 * errors.mean() if small else 4.0 * values.std() / np.sqrt(len(values)))
        assert 0.8 < np.sqrt(np.mean(errors**2)) / values.std(ddof=1) < (2.5 if small else 1.3)
        if not small:  # Student's t with 15 degrees of freedom: 0.67 and 0.94
            assert 0.57 < np.mean(np.abs(away) < errors) < 0.85
            assert np.mean(np.abs(away) < 2.0 * errors) > 0.89


def test_a_perfect_pattern_is_as_often_below_zero_as_above() -> None:
    values, _ = _estimates(np.ones((SIDE, SIDE)), 0.05)["nmse"]
    assert 0.4 < np.mean(values < 0.0) < 0.6


def test_the_estimate_is_the_mean_over_pairs() -> None:
    """Every pair of different replicates, written out."""
    images = noisy(bumpy(SIDE, 0.1), 0.1, np.random.default_rng(1), replicates=5)
    target = bumpy(SIDE, 0.05, seed=2)
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    mask[3:-4, 5:-2] = True
    above, below, even, level = 0.0, 0.0, 0.0, 0.0
    for j, first in enumerate(images):
        for k, second in enumerate(images):
            if j != k:
                one, two = first.sum() / target.sum() * target, second.sum() / target.sum() * target
                above += np.sum((first - one) * (second - two))
                below += np.sum(one * two)
                even += np.mean((first[mask] - first[mask].mean()) * (second[mask] - second[mask].mean()))
                level += first[mask].mean() * second[mask].mean()
    assert nmse_estimate(images, target).value == pytest.approx(above / below, rel=1e-12)
    assert rsd_estimate(images, mask).value == pytest.approx(np.sqrt(even / level), rel=1e-12)


@pytest.mark.parametrize("lit", [0, 1, 3])
def test_too_few_replicates_leave_the_noise_in_and_have_no_error(lit: int) -> None:
    """Replicates that no light reached tell nothing about the noise of it."""
    images = noisy(bumpy(SIDE, 0.1), 0.1, np.random.default_rng(1))
    for few in (images[: max(lit, 1)], np.where(np.arange(16)[:, None, None] < lit, images, 0.0)):
        if lit == 0:
            few = np.zeros_like(few)
        found, even = nmse_estimate(few, TARGET).metric(), rsd_estimate(few, EVERYWHERE).metric()
        assert found.value == nmse(few.mean(axis=0), TARGET)
        assert even.value == relative_deviation(few.mean(axis=0), EVERYWHERE)
        assert found.standard_error is None and even.standard_error is None


@pytest.mark.parametrize("own", [0.0, 3.0])
def test_the_error_over_pairs_is_the_jackknife_less_what_it_counts_twice(own: float) -> None:
    """Products with effects of their replicates, and without, where noise outweighs them."""
    chance, count = np.random.default_rng(3), 6
    apart = chance.normal(size=(count, count))
    products = apart + apart.T + own * np.add.outer(*2 * (chance.normal(size=count),))
    pairs = list(permutations(range(count), 2))
    if own == 0.0:  # no effects: every row has the same mean
        for _ in range(60):
            rows = np.array([sum(products[j, k] for k in range(count) if k != j) for j in range(count)])
            products -= np.add.outer(rows, rows) / (2.0 * (count - 1))
    mean = sum(products[j, k] for j, k in pairs) / len(pairs)
    without = [np.mean([products[j, k] for j, k in pairs if left not in (j, k)]) for left in range(count)]
    jackknife = (count - 1) / count * sum((each - np.mean(without)) ** 2 for each in without)
    effects = [
        (sum(products[j, k] for k in range(count) if k != j) - (count - 1) * mean) / (count - 2) for j in range(count)
    ]
    z = sum((products[j, k] - mean - effects[j] - effects[k]) ** 2 for j, k in pairs) / (count * (count - 3))
    expected = max(jackknife - 4.0 * z / (count * (count - 2)), 0.0) + 2.0 * z / (count * (count - 1))
    assert _error_over_pairs(products) == pytest.approx(expected**0.5, rel=1e-9)
    assert (jackknife > 4.0 * z / (count * (count - 2))) == (own > 0.0)
