"""Figures of few replicates, each written out as loops over pixels, pairs and blocks of replicates."""

from itertools import combinations, permutations

import numpy as np
import pytest

from lensforge.results import Metric
from lensforge.results.estimates import (
    ExtremeEstimate,
    PairEstimate,
    _darkest,
    _Level,
    debiased_maximum,
    debiased_minimum,
    error_over_pairs,
    least_over_mean,
    nmse,
    nmse_estimate,
    relative_deviation,
    relative_square,
    rsd_estimate,
    uniformity,
)

SHAPE = (3, 4)
MASK = np.array([[False, True, True, False], [False, True, True, True], [False] * 4])


def pictures(count: int, noise: float, scale: float = 0.01, seed: int = 0) -> np.ndarray:
    """Light far below 1 in all pixels together, as watts on a receiver often are."""
    chance = np.random.default_rng(seed)
    truth = np.linspace(0.6, 1.4, 12).reshape(SHAPE)
    return scale * truth * (1.0 + noise * chance.normal(size=(count, *SHAPE)))


def test_metrics_of_a_picture_are_their_sums_over_pixels() -> None:
    image = pictures(1, 0.2)[0]
    target = np.arange(1.0, 13.0).reshape(SHAPE)
    share = sum(image.flat) / sum(target.flat)
    above = sum((value - share * wanted) ** 2 for value, wanted in zip(image.flat, target.flat, strict=True))
    assert nmse(image, target) == pytest.approx(above / sum((share * pixel) ** 2 for pixel in target.flat), rel=1e-12)
    inside = [value for value, within in zip(image.flat, MASK.flat, strict=True) if within]
    mean = sum(inside) / len(inside)
    assert uniformity(image, MASK) == pytest.approx(min(inside) / mean, rel=1e-12)
    spread = (sum((value - mean) ** 2 for value in inside) / len(inside)) ** 0.5
    assert relative_deviation(image, MASK) == pytest.approx(spread / mean, rel=1e-12)
    both = np.stack([image, 0.01 * target])
    apart = sum((one - other) ** 2 for one, other in zip(*both.reshape(2, -1), strict=True))
    assert relative_square(both) == pytest.approx(apart / sum(pixel**2 for pixel in both[1].flat), rel=1e-12)


def test_a_dark_picture_has_the_largest_error_and_no_uniformity() -> None:
    dark = np.zeros(SHAPE)
    light = np.ones(SHAPE)
    assert nmse(dark, light) == 1.0
    assert uniformity(dark, MASK) == relative_deviation(dark, MASK) == 0.0
    assert relative_square(np.stack([light, dark])) == 0.0


@pytest.mark.parametrize("coupling", [0.0, 3.0])
def test_theerror_over_pairs_is_the_jackknife_less_what_it_counts_twice(coupling: float) -> None:
    """Products with effects of their replicates, and without, where noise outweighs them."""
    chance = np.random.default_rng(3)
    count = 6
    apart = chance.normal(size=(count, count))
    products = apart + apart.T + coupling * np.add.outer(*2 * (chance.normal(size=count),))
    pairs = list(permutations(range(count), 2))
    if coupling == 0.0:  # no effects: every row has the same mean
        for _ in range(60):
            rows = np.array([sum(products[j, k] for k in range(count) if k != j) for j in range(count)])
            products -= np.add.outer(rows, rows) / (2.0 * (count - 1))
    mean = sum(products[j, k] for j, k in pairs) / len(pairs)
    without = [np.mean([products[j, k] for j, k in pairs if left not in (j, k)]) for left in range(count)]
    jackknife = (count - 1) / count * sum((value - np.mean(without)) ** 2 for value in without)
    effects = [
        (sum(products[j, k] for k in range(count) if k != j) - (count - 1) * mean) / (count - 2) for j in range(count)
    ]
    z = sum((products[j, k] - mean - effects[j] - effects[k]) ** 2 for j, k in pairs) / (count * (count - 3))
    interactions = 2.0 * z / (count * (count - 1))
    expected = jackknife - 4.0 * z / (count * (count - 2)) + interactions
    assert (expected > 0.5 * interactions) == (coupling > 0.0)
    assert error_over_pairs(products) == pytest.approx(max(expected, 0.5 * interactions) ** 0.5, rel=1e-9)


def test_the_error_over_pairs_of_noise_alone_is_what_they_scatter_by() -> None:
    """Products of 16 vectors of noise: the variance of their mean is 2 n/(r (r - 1)) of n normal numbers each."""
    chance = np.random.default_rng(4)
    errors = [error_over_pairs(noise @ noise.T) for noise in chance.standard_normal((1000, 16, 100))]
    # Their squares scatter by 0.8 of their mean, so that the root of that of a thousand is known to 1.3 %.
    assert 0.95 < np.sqrt(np.mean(np.square(errors)) / (2.0 * 100 / (16 * 15))) < 1.1


def pair_means(first: list[np.ndarray], scales: list[float]) -> tuple[float, float]:
    pairs = list(permutations(range(len(first)), 2))
    return tuple(  # type: ignore[return-value]
        sum(float(np.sum(terms[j] * terms[k])) for j, k in pairs) / len(pairs) for terms in (first, scales)
    )


@pytest.mark.parametrize("count", [4, 7])
def test_the_nmse_of_each_pair_and_its_distance_from_the_estimate(count: int) -> None:
    images = pictures(count, 0.1)
    target = np.arange(2.0, 14.0).reshape(SHAPE)
    scales = [image.sum() / target.sum() for image in images]
    errors = [image - scale * target for image, scale in zip(images, scales, strict=True)]
    norms = [scale * np.sqrt(np.sum(target**2)) for scale in scales]
    above, below = pair_means(errors, norms)
    estimate = nmse_estimate(images, target)
    assert estimate.value == pytest.approx(above / below, rel=1e-10)
    assert estimate.deviations is not None
    for j, k in np.ndindex(count, count):
        away = (np.sum(errors[j] * errors[k]) - estimate.value * norms[j] * norms[k]) / below
        assert estimate.deviations[j, k] == pytest.approx(away, rel=1e-9, abs=1e-12)
    assert estimate.metric().standard_error == error_over_pairs(estimate.deviations)


@pytest.mark.parametrize("noise", [0.02, 2.0])
def test_the_rsd_is_the_root_of_the_mean_over_pairs_or_zero(noise: float) -> None:
    """Light whose unevenness is far above its noise, and even light of much noise, whose square is below 0."""
    images = pictures(6, noise)
    if noise > 1.0:  # each is as uneven as the one before, the other way
        images = 0.01 + np.array([1.0, -1.0, 1.5, -1.5, 0.5, -0.5])[:, None, None] * (pictures(1, 0.1) - 0.01)
    inside = [image[MASK] for image in images]
    means = [float(pixels.mean()) for pixels in inside]
    errors = [(pixels - mean) / len(pixels) ** 0.5 for pixels, mean in zip(inside, means, strict=True)]
    above, below = pair_means(errors, means)
    estimate = rsd_estimate(images, MASK)
    assert estimate.value == pytest.approx(max(above / below, 0.0) ** 0.5, rel=1e-9)
    assert (estimate.value == 0.0) == (noise > 1.0)
    squares = np.array([[(a @ b - above / below * m * n) / below for b, n in zip(errors, means, strict=True)]
                        for a, m in zip(errors, means, strict=True)])  # fmt: skip
    slope = 2.0 * max(estimate.value, error_over_pairs(squares) ** 0.5)
    np.testing.assert_allclose(estimate.deviations, squares / slope, rtol=1e-8)
    assert estimate.metric().standard_error == pytest.approx(error_over_pairs(squares) / slope, rel=1e-8)


def test_exactly_even_light_has_no_deviation_and_no_error() -> None:
    metric = rsd_estimate(np.full((5, *SHAPE), 0.25), MASK).metric()
    assert (metric.value, metric.standard_error) == (0.0, 0.0)


def test_four_replicates_with_light_are_enough_whatever_the_others() -> None:
    images = np.concatenate([pictures(4, 0.1), np.zeros((3, *SHAPE))])
    target = np.ones(SHAPE)
    for estimate in (nmse_estimate(images, target), rsd_estimate(images, MASK)):
        assert estimate.deviations is not None and estimate.deviations.shape == (7, 7)
    for estimate in (nmse_estimate(images[1:], target), rsd_estimate(images[1:], MASK)):
        assert estimate.deviations is None


def test_a_change_has_the_error_of_the_differences_of_pairs() -> None:
    images = pictures(6, 0.1)
    other = pictures(6, 0.1, seed=5)
    target = np.ones(SHAPE)
    before = nmse_estimate(images, target)
    after = nmse_estimate(other, target)
    change = after.change_from(before)
    assert change.value == pytest.approx(after.value - before.value)
    assert change.standard_error == error_over_pairs(after.deviations - before.deviations)  # type: ignore[operator]
    alone = PairEstimate(0.5)
    assert alone.change_from(before) == Metric(value=0.5 - before.value)
    assert before.change_from(alone) == Metric(value=before.value - 0.5)


def halves_in_pairs() -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """All halves of 16 replicates by the parity of some of the bits of their numbers, with the other half."""
    parities = [[bin(row & k).count("1") % 2 for k in range(16)] for row in range(1, 16)]
    return [
        (tuple(k for k in range(16) if parity[k] == 0), tuple(k for k in range(16) if parity[k] == 1))
        for parity in parities
    ]


def balanced_blocks(size: int) -> list[tuple[int, ...]]:
    """All halves, all planes of four, all pairs."""
    if size == 8:
        return [half for both in halves_in_pairs() for half in both]
    return [block for block in combinations(range(16), size) if size == 2 or not np.bitwise_xor.reduce(block)]


def darkest_by_blocks(readings: np.ndarray, size: int, sample: tuple[int, ...]) -> tuple[float, float]:
    """Mean least value by every balanced block of ``size`` replicates in a sample, and its mean in the others there."""
    least = []
    read = []
    for block in balanced_blocks(size):
        if set(block) <= set(sample):
            light = readings[list(block)].mean(axis=0)
            place = int(light.argmin())
            least.append(light[place])
            read += [readings[k, place] for k in sample if k not in block]
    return float(np.mean(least)), float(np.mean(read))


def least_of(readings: np.ndarray, sample: tuple[int, ...]) -> float:
    """The least reading by the replicates of a sample, at most the mean."""
    u, v = darkest_by_blocks(readings, len(sample) // 2, sample)
    u_few, v_few = darkest_by_blocks(readings, len(sample) // 4, sample)
    optimism = (v_few - u_few) - (v - u)
    slope = min(max((u - u_few) / optimism, 0.0), 1.0) if optimism > 1e-12 * abs(v) else 1.0
    mean = readings[list(sample)].mean(axis=0)
    return float(min(max(u + slope * (v - u), mean.min()), mean.mean()))


@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_the_least_reading_is_on_the_line_through_both_levels_of_noise(noise: float) -> None:
    """Its error is by that of the halves of the replicates."""
    readings = pictures(16, noise).reshape(16, -1)
    least = debiased_minimum(readings)
    assert least.value == pytest.approx(least_of(readings, tuple(range(16))), rel=1e-9)
    apart = [least_of(readings, half) - least_of(readings, other) for half, other in halves_in_pairs()]
    assert least.standard_error == pytest.approx(0.5 * np.sqrt(np.mean(np.square(apart))), rel=1e-9)
    largest = debiased_maximum(-readings)
    assert largest.value == -least.value and largest.standard_error == least.standard_error
    images = readings.reshape(16, *SHAPE)
    relative = images[:, MASK] / images[:, MASK].mean(axis=1, keepdims=True)
    assert least_over_mean(images[:, MASK]).metric() == debiased_minimum(relative)


def test_by_halves_a_mean_has_its_standard_error() -> None:
    """Where one pixel is darkest by far, the least is its mean."""
    readings = pictures(16, 0.01).reshape(16, -1) + np.array([0.0] + [1.0] * 11)
    expected = readings[:, 0].std(ddof=1) / 4.0
    assert debiased_minimum(readings).standard_error == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("level", "noisier", "slope"),
    [
        ((1.0, 1.1), (0.92, 1.22), 0.4),  # both on a line of slope 0.4 through 1.04
        ((1.0, 1.1), (0.5, 0.7), 1.0),  # more by noise than by optimism
        ((1.0, 1.1), (1.01, 1.3), 0.0),  # darker with less noise, which no light is
        ((1.0, 1.25), (0.75, 1.0), 1.0),  # as optimistic
        ((1.0, 1.5), (0.75, 1.0), 1.0),  # less optimistic
    ],
)
def test_the_slope_is_that_of_the_line_within_its_bounds(level, noisier, slope) -> None:
    less, more = (_Level(np.array([minimum]), np.array([read])) for minimum, read in (level, noisier))
    assert less.slope(more) == pytest.approx(slope, abs=1e-12)
    assert less.extrapolated(np.array([0.25])) == pytest.approx(0.75 * level[0] + 0.25 * level[1])


def test_pixels_that_are_equally_dark_are_read_together() -> None:
    images = np.array([[0.0, 0.0, 2.0], [1.0, 3.0, 2.0], [0.0, 4.0, 5.0]])
    np.testing.assert_array_equal(_darkest(np.array([[1.0, 0.0, 0.0]]), images), [[0.0, 2.0, 2.0]])


def test_as_dark_but_for_rounding_is_as_dark() -> None:
    """Light of equal rays: of another unit it has the same least value and error."""
    chance = np.random.default_rng(7)
    readings = chance.poisson(0.4, (16, 60)) @ (0.1 * np.eye(60) + 0.03 * np.eye(60, k=1)) + 0.01
    minimum = debiased_minimum(readings)
    for unit in (1.0 / 3.0, 0.7, 1.1):
        other = debiased_minimum(unit * readings)
        assert other.value == pytest.approx(unit * minimum.value, rel=1e-9)
        assert other.standard_error == pytest.approx(unit * minimum.standard_error, rel=1e-9)


@pytest.mark.parametrize("count", [3, 16])
def test_a_bound_holds_where_the_readings_are_beyond_it(count: int) -> None:
    readings = pictures(count, 0.02).reshape(count, -1)
    least = debiased_minimum(readings).value
    largest = debiased_maximum(readings).value
    assert [debiased_minimum(readings, most).value for most in (0.5 * least, 2.0 * largest)] == [0.5 * least, least]
    values = [debiased_maximum(readings, bound).value for bound in (0.5 * least, 2.0 * largest)]
    assert values == [largest, 2.0 * largest]


@pytest.mark.parametrize("count", [1, 15, 17])
def test_other_than_sixteen_replicates_have_the_least_of_their_mean(count: int) -> None:
    readings = pictures(count, 0.3).reshape(count, -1)
    means = [sum(column) / count for column in readings.T]
    assert debiased_minimum(readings).value == pytest.approx(min(means), rel=1e-12)
    assert debiased_maximum(readings).value == pytest.approx(max(means), rel=1e-12)
    assert debiased_minimum(readings).standard_error is None


def test_a_changed_ratio_and_its_halves_stay_within_0_and_1() -> None:
    """Few rays change it by -0.7 from 0.6 by many: to 0, and by one half to 1 in the place of 1.2."""
    before = ExtremeEstimate(0.9, np.array([0.9, 0.8, 0.2, 0.9]), 0.01)
    after = ExtremeEstimate(0.2, np.array([0.1, 0.3, 0.8, 0.2]), 0.04)
    change = after.change_of(0.6, before)
    assert change.value == pytest.approx(-0.6)
    kept = (-0.6 + 0.5) ** 2 + (0.4 + 0.6) ** 2  # of -0.8 and -0.5, 0.6 and -0.7
    assert change.standard_error == pytest.approx((kept / 8.0 + 0.03**2) ** 0.5)
    assert after.change_from(before).standard_error == pytest.approx(((0.3**2 + 1.3**2) / 8.0 + 0.03**2) ** 0.5)
    assert ExtremeEstimate(0.9).change_of(0.6, before) == Metric(value=0.0)


def test_what_no_extrapolation_tells_is_a_part_of_the_error() -> None:
    """Of pixels that no ray of a block has met nothing is known but what the others have there."""
    by_halves = np.array([0.4, 0.6] * 14 + [0.7, 0.3])
    error = ExtremeEstimate(0.5, by_halves, 0.04).metric().standard_error
    assert error == pytest.approx((((14 * 0.1**2) + 0.2**2) / 15 + 0.04**2) ** 0.5, rel=1e-12)
    assert ExtremeEstimate(0.5).metric() == Metric(value=0.5)
    minimum = debiased_minimum(np.random.default_rng(0).poisson(0.1, (16, 4000)).astype(float))
    assert (minimum.value, minimum.standard_error) == (0.0, pytest.approx(0.1, rel=0.1)), "each block has dark pixels"
