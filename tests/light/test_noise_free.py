"""Metrics without ray noise: against pictures that are known, in the mean over many draws of the noise."""

import numpy as np
import pytest
from nightly import first_by_day
from scipy.ndimage import gaussian_filter
from scipy.stats import norm

from lensforge.results import Metric
from lensforge.results.estimates import (
    _Choices,
    _halves,
    least_over_mean,
    nmse,
    nmse_estimate,
    ratio_of,
    relative_deviation,
    rsd_estimate,
    uniformity,
)
from lensforge.scene.pixel_grid import gaussian3

REPLICATES = 16


def bumpy(side: int, deviation: float, seed: int = 0) -> np.ndarray:
    """A flat top with smooth random bumps, 6 pixels wide, of relative standard deviation ``deviation``."""
    bumps = gaussian_filter(np.random.default_rng(seed).normal(size=(side, side)), 6.0, mode="wrap")
    return 1.0 + deviation * bumps / bumps.std()


def noisy(truth: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Replicates whose mean has noise of standard deviation ``noise`` in each pixel, neighbours correlated."""
    white = rng.normal(size=(REPLICATES, *truth.shape))
    point = np.zeros((5, 5))
    point[2, 2] = 1.0
    kept = np.linalg.norm(gaussian3(point, 1.0))
    filtered = np.stack([gaussian3(image, 1.0) for image in white]) / kept
    return truth + noise * np.sqrt(REPLICATES) * filtered


SIDE = 24
EVERYWHERE = np.ones((SIDE, SIDE), dtype=bool)
TARGET = np.ones((SIDE, SIDE)) / SIDE**2


def _estimates(truth: np.ndarray, noise: float, repeats: int = 150) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Value and standard error of each repeat, by metric."""
    rng = np.random.default_rng(5)
    estimates: dict[str, list[tuple[float, float]]] = {"nmse": [], "rsd": []}
    for _ in range(repeats):
        images = noisy(truth, noise, rng)
        for name, metric in (
            ("nmse", nmse_estimate(images, TARGET).metric()),
            ("rsd", rsd_estimate(images, EVERYWHERE).metric()),
        ):
            assert metric.standard_error is not None
            estimates[name].append((metric.value, metric.standard_error))
    return {name: (np.array(rows)[:, 0], np.array(rows)[:, 1]) for name, rows in estimates.items()}


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
        metric = nmse_estimate(few, TARGET).metric()
        even = rsd_estimate(few, EVERYWHERE).metric()
        assert metric.value == nmse(few.mean(axis=0), TARGET)
        assert even.value == relative_deviation(few.mean(axis=0), EVERYWHERE)
        assert metric.standard_error is None and even.standard_error is None


LARGE = 40
WHOLE = np.ones((LARGE, LARGE), dtype=bool)


def _spot(depth: float, width: float = 3.0) -> np.ndarray:
    """A flat top with one dark spot."""
    row, column = np.mgrid[:LARGE, :LARGE]
    return 1.0 - depth * np.exp(-((row - 11.0) ** 2 + (column - 29.0) ** 2) / (2.0 * width**2))


@pytest.mark.parametrize(
    ("truth", "noise"),
    first_by_day(
        3,
        [
            (np.ones((LARGE, LARGE)), 0.01),  # all pixels alike: the noise alone decides
            (bumpy(LARGE, 0.01), 0.001),
            (bumpy(LARGE, 0.01), 0.005),
            (bumpy(LARGE, 0.01), 0.03),  # the noise outweighs the bumps
            (_spot(0.1), 0.002),
            (_spot(0.1), 0.02),
            (np.linspace(0.9, 1.1, LARGE)[:, None] * np.ones((LARGE, LARGE)), 0.01),  # a dark edge of equal pixels
        ],
    ),
    ids=["flat", "bumps, little noise", "bumps", "bumps, much noise", "spot, little noise", "spot", "dark edge"],
)
def test_the_bias_is_within_one_standard_error_which_is_that_of_the_scatter(truth: np.ndarray, noise: float) -> None:
    rng = np.random.default_rng(2)
    values = []
    errors = []
    raw = []
    for _ in range(50):
        images = noisy(truth, noise, rng)
        metric = least_over_mean(images[:, WHOLE]).metric()
        assert metric.standard_error is not None
        values.append(metric.value)
        errors.append(metric.standard_error)
        raw.append(uniformity(images.mean(axis=0), WHOLE))
    away = np.array(values) - uniformity(truth, WHOLE)
    stated = np.sqrt(np.mean(np.square(errors)))
    assert abs(away.mean()) < 0.75 * stated
    assert abs(away.mean()) < 0.5 * abs(np.mean(raw) - uniformity(truth, WHOLE)) + 0.35 * noise
    assert 0.8 < np.std(values, ddof=1) / stated < 1.25, "the scatter is that stated"
    assert np.mean(np.abs(away) < 2.0 * np.array(errors)) > 0.75
    assert np.mean(errors) < 2.5 * noise  # one pixel's noise cannot be undercut: no one knows the darkest better


def test_two_pixels_follow_clark_and_stein() -> None:
    """Two pixels, one darker by d: the minimum and the value of the chosen one have closed forms (Clark 1961)."""
    d = 0.02
    spread = 0.1
    rng = np.random.default_rng(8)
    pairs = []
    for _ in range(500):
        choices = _Choices.of(np.array([1.0, 1.0 + d]) + spread * rng.normal(size=(16, 2)), _halves())
        level = choices.within(np.ones((1, 16)))
        pairs.append((level.minimum[0], level.read[0]))
    t = spread**2 / 8.0  # variance of the mean of eight
    theta = np.sqrt(2.0 * t)
    minimum = 1.0 + d * norm.cdf(-d / theta) - theta * norm.pdf(d / theta)
    chosen = 1.0 + d * norm.cdf(-d / theta)
    by_variance = -norm.pdf(d / theta) / theta  # of the minimum, by t
    assert chosen == pytest.approx(minimum - 2.0 * t * by_variance, rel=1e-12)
    means = np.mean(pairs, axis=0)
    errors = np.std(pairs, axis=0) / np.sqrt(len(pairs))
    assert abs(means[0] - minimum) < 4.0 * errors[0]
    assert abs(means[1] - chosen) < 4.0 * errors[1]


def test_places_read_twice_change_no_least_value() -> None:
    readings = noisy(bumpy(SIDE, 0.02), 0.01, np.random.default_rng(3)).reshape(REPLICATES, -1)
    once, twice = (
        least_over_mean(sample) for sample in (readings, np.concatenate([readings, readings[:, ::-1]], axis=1))
    )
    assert once.metric().standard_error and once.by_halves is not None
    assert twice.value == pytest.approx(once.value, rel=1e-12)
    assert twice.by_halves == pytest.approx(once.by_halves, rel=1e-12)


def test_relative_errors_of_a_ratio_add_in_squares() -> None:
    above = Metric(value=3.0, standard_error=0.3)
    below = Metric(value=4.0, standard_error=0.2)
    ratio = ratio_of(above, below)
    assert ratio.value == 0.75
    assert ratio.standard_error / ratio.value == pytest.approx(np.hypot(0.1, 0.05))
    assert ratio_of(above, Metric(value=4.0)) == ratio_of(Metric(value=3.0), below) == Metric(value=0.75)
    assert ratio_of(Metric(value=0.03), Metric(value=0.06)).value == pytest.approx(0.5), "little light is light"
    for dark in (0.0, -4.0):
        assert ratio_of(above, Metric(value=dark, standard_error=1.0)) == Metric(value=0.0)
