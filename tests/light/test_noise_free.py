"""Squared metrics without ray noise: against pictures that are known, in the mean over many draws of the noise."""

import numpy as np
import pytest
from noisy_images import bumpy, noisy

from lensforge.light.metrics import nmse, nmse_estimate, relative_deviation, rsd_estimate

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
