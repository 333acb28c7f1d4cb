"""Metrics of a pattern, their standard errors, and figures of the light without the noise of its rays.

Standard errors are by the jackknife (Efron & Stein 1981), from replicates or from parts of a sample. Without one
replicate another pixel is seldom the darkest: those of a minimum are by half-samples (McCarthy 1969).

Ray noise adds to every square: the error of the mean of r images is the light's own, and 1/r of the variance between
the images. The product of two *different* images has no such part, so the mean over all pairs of them is unbiased for
any number of rays (a U-statistic; Hoeffding 1948).

The least irradiance in a mask has no unbiased estimate. The darkest pixel of a noisy image is too dark: noise chose it.
Its value in an image that had no part in the choice is too bright: it may not be the darkest. Let u be the expected
minimum at a noise variance t, v the expected true value of the pixel chosen there. Integration by parts (Stein 1981)
gives v = u - 2 t du/dt for Gaussian noise, whatever its correlation, so with u = u0 - a t^p the true minimum is

    u0 = u + h (v - u),  h = 1 / (2 p).

E min(x + s z) is concave in s, the root of t, so h is at most 1: many pixels are as dark as each other. It is 1/2 for a
single dark spot under little noise. u, v at two levels of noise give h: both lie on the line of slope -h through u0.
The levels are means over 8 and over 4 of 16 replicates, read on those left: over the 30 halves and 140 quarters that
are affine subspaces of the 16 numbers of the replicates, taken as vectors of 4 bits, so that no replicate counts more
than another. The least of the mean of all replicates is too dark, and the least of the light is no more than its mean:
both bound the estimate. Chosen by experiment, on known pictures with noise.

The error is by the same estimate from each half of the replicates, with blocks of 4 and of 2 in the half. The halves of
one pair are independent, each with twice the variance of the whole both where one pixel decides, whose noise is as the
root of the replicates, and where all pixels are alike, so that noise is the only scale. In between it is right to a
fifth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from lensforge.results.record import Image, Metric
from lensforge.results.replicate_pairs import error_over_pairs, mean_over_pairs


def jackknife_metric(
    replicates: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float], unit: str = ""
) -> Metric:
    """``statistic`` of the mean over replicates, and its standard error (Efron & Stein 1981); None for a single one."""
    count = len(replicates)
    total = replicates.sum(axis=0)
    value = statistic(total / count)
    if count < 2:
        return Metric(value=value, unit=unit)
    error = jackknife_error(np.array([statistic((total - replicate) / (count - 1)) for replicate in replicates]))
    return Metric(value=value, unit=unit, standard_error=error)


def scaled(metric: Metric, factor: float, unit: str) -> Metric:
    """``metric`` times ``factor``, in another unit."""
    error = None if metric.standard_error is None else metric.standard_error * factor
    return Metric(value=metric.value * factor, unit=unit, standard_error=error)


def with_error(metric: Metric, more: float) -> Metric:
    """``metric`` with a further part of its error added in quadrature; unchanged without an error."""
    if metric.standard_error is None:
        return metric
    return metric.changed(standard_error=float(np.hypot(metric.standard_error, more)))


def in_doubt(metric: Metric, other: Metric, doubt: float) -> Metric:
    """``metric`` chosen before ``other`` by its rays: the error includes the possible choice of the other.

    ``doubt``: the root of p (1 - p), with the probability p of the other.
    """
    return with_error(metric, doubt * abs(metric.value - other.value))


def jackknife_error(left_out: Float[np.ndarray, " r"]) -> float:
    """Standard error of a statistic, from its values ``left_out`` with each replicate left out in turn."""
    count = len(left_out)
    return float(np.sqrt((count - 1) / count * np.sum((left_out - left_out.mean()) ** 2)))


def halves_of(replicates: Float[np.ndarray, "r *shape"]) -> Float[np.ndarray, "h *shape"]:
    """Mean over each half of 16 replicates, followed by that over the other half."""
    return np.asarray(np.tensordot(_halves(), replicates, 1) / (REPLICATES // 2))


def half_sample_error(by_halves: Float[np.ndarray, " h"]) -> float:
    """Standard error of a statistic, from its values by halves of the replicates, each followed by the other half."""
    return float(np.sqrt(np.mean(_above_other_half(by_halves) ** 2)))


def _above_other_half(by_halves: Float[np.ndarray, " h"]) -> Float[np.ndarray, " h"]:
    """Half of what the value by each half of the replicates is above that by the other."""
    others = by_halves.reshape(-1, 2)[:, ::-1].ravel()
    return np.asarray(0.5 * (by_halves - others))


def nmse(irradiance: Image, target: Image) -> float:
    """Eq. (7), with the target scaled to the flux of ``irradiance``: it measures the shape, efficiency the amount.

    1 for a dark image.
    """
    total = irradiance.sum()
    if not total > 0.0:
        return 1.0
    wanted = target * (total / target.sum())
    return float(np.sum((irradiance - wanted) ** 2) / np.sum(wanted**2))


def uniformity(irradiance: Image, mask: Bool[np.ndarray, "h w"]) -> float:
    """Least over mean irradiance inside ``mask``."""
    inside = irradiance[mask]
    return float(inside.min() / inside.mean()) if inside.mean() > 0.0 else 0.0


def relative_deviation(irradiance: Image, mask: Bool[np.ndarray, "h w"]) -> float:
    """RSD: standard deviation over mean inside ``mask``."""
    inside = irradiance[mask]
    return float(inside.std() / inside.mean()) if inside.mean() > 0.0 else 0.0


def relative_square(both: Float[np.ndarray, "2 h w"]) -> float:
    """NMSE between two pictures without scaling: mean square difference over that of the second; 0 if it is dark."""
    reference = float(np.sum(both[1] ** 2))
    return float(np.sum((both[0] - both[1]) ** 2)) / reference if reference > 0.0 else 0.0


_LEAST_REPLICATES = 4  # the fewest that tell effects from interactions

Images = Float[np.ndarray, "r h w"]


@dataclass(frozen=True)
class PairEstimate:
    """An estimate by pairs of replicates, and each pair's deviation from it; None with too few replicates."""

    value: float
    deviations: Float[np.ndarray, "r r"] | None = None

    def metric(self) -> Metric:
        """Value and standard error."""
        error = None if self.deviations is None else error_over_pairs(self.deviations)
        return Metric(value=self.value, standard_error=error)

    @property
    def noise(self) -> Float[np.ndarray, " r"]:
        """Noise by replicate, up to a factor; empty with too few."""
        if self.deviations is None:
            return np.zeros(0)
        return np.asarray(self.deviations.sum(axis=1) - np.diag(self.deviations))

    def change_from(self, before: "PairEstimate") -> Metric:
        """Difference from ``before``, the estimate of another lens by the same rays."""
        if self.deviations is None or before.deviations is None:
            return PairEstimate(self.value - before.value).metric()
        return PairEstimate(self.value - before.value, self.deviations - before.deviations).metric()


@dataclass(frozen=True)
class RootEstimate(PairEstimate):
    """The root of ``square``, an estimate by pairs; None with too few replicates."""

    square: PairEstimate | None = None

    def change_of(self, designed: float, before: "RootEstimate") -> Metric:
        """Change from ``before`` to this light of ``designed``, the value of ``before`` by many rays.

        Squares are unbiased and change alike with few rays and with many; roots do not: with few rays one may be 0 and
        the other above ``designed``. The changed value is the root of the changed square, at least 0.
        """
        if self.square is None or before.square is None:
            return Metric(value=max(self.value - before.value, -designed))
        change = self.square.change_from(before.square)
        value = float(np.sqrt(max(designed**2 + change.value, 0.0)))
        noise = change.standard_error or 0.0
        error = noise / (2.0 * max(value, np.sqrt(noise) or 1.0))  # the slope of the root, as of the estimate
        return Metric(value=value - designed, standard_error=float(error))


def nmse_estimate(images: Images, target: Image) -> PairEstimate:
    """NMSE of the light that ``images`` estimate without bias: D_k = I_k - s_k T, with s_k = sum I_k / sum T.

    Mean over all pairs k != l of <D_k, D_l>, over the mean of s_k s_l <T, T>. It is not clipped: if the light is closer
    to the target than the noise can tell, it may be below 0. With fewer than four replicates, or light in fewer than
    four: the NMSE of their mean, with its noise, without standard error.
    """
    scales = images.sum(axis=(1, 2)) / target.sum()
    if not _enough(scales):
        return PairEstimate(nmse(images.mean(axis=0), target))
    errors = images - scales[:, None, None] * target
    return PairEstimate(*_ratio_of_squares(errors.reshape(len(images), -1), scales * np.linalg.norm(target)))


def rsd_estimate(images: Images, mask: Bool[np.ndarray, "h w"]) -> RootEstimate:
    """RSD in ``mask`` of the light that ``images`` estimate without bias: the root of its squared relative deviation.

    That square is the mean over all pairs k != l of <E_k, E_l>, E_k the deviations from the mean in the mask, over that
    of the products of the means. An estimate below 0 counts as 0. With too few replicates: as for the NMSE.
    """
    inside = images[:, mask]
    means = inside.mean(axis=1)
    if not _enough(means):
        return RootEstimate(relative_deviation(images.mean(axis=0), mask))
    return root_estimate((inside - means[:, None]) / np.sqrt(inside.shape[1]), means)


def root_estimate(errors: Float[np.ndarray, "r n"], scales: Float[np.ndarray, " r"]) -> RootEstimate:
    """Root of the square sum of ``errors`` over the square of ``scales``, both without noise.

    With fewer than four replicates, or scales above 0: that of the mean, with its noise, without standard error.
    """
    if not _enough(scales):
        mean = float(np.linalg.norm(errors.mean(axis=0)))
        return RootEstimate(mean / float(scales.mean()) if mean > 0.0 else 0.0)
    squared, apart = _ratio_of_squares(errors, scales)
    value = np.sqrt(max(squared, 0.0))
    error = error_over_pairs(apart)
    # the slope of the root where the square is as large as its own error: half of such squares are below 0, and
    # count as 0, so that the root scatters by half of that of the error, whatever it is
    slopes = apart / (2.0 * max(value, np.sqrt(error) or 1.0))
    return RootEstimate(float(value), slopes, PairEstimate(squared, apart))


def _enough(amounts: Float[np.ndarray, " r"]) -> bool:
    return int(np.count_nonzero(amounts > 0.0)) >= _LEAST_REPLICATES


def _ratio_of_squares(
    errors: Float[np.ndarray, "r n"], scales: Float[np.ndarray, " r"]
) -> tuple[float, Float[np.ndarray, "r r"]]:
    """``|E errors|^2 / (E scales)^2`` without noise, and each pair's deviation from it."""
    squares = errors @ errors.T
    norms = np.outer(scales, scales)
    norm = mean_over_pairs(norms)
    value = mean_over_pairs(squares) / norm
    return value, (squares - value * norms) / norm


REPLICATES = 16  # by which extremes are estimated
_ROUNDING = 1e-12
_AT_ONCE = 2**14  # values of pixels by blocks: beyond, each array is fetched from the system anew

Blocks = Float[np.ndarray, "b r"]  # 1 where a replicate is in a block, else 0


@dataclass(frozen=True)
class ExtremeEstimate:
    """A minimum or maximum; the same by each half of the replicates, followed by the other half; and residual noise.

    ``unsure``: distance of the inner bound from a value that noise alone may have made, if no extrapolation is
    possible. Unless there are 16 replicates only the value is known.
    """

    value: float
    by_halves: Float[np.ndarray, " h"] | None = None
    unsure: float = 0.0

    def metric(self) -> Metric:
        """Value and standard error."""
        if self.by_halves is None:
            return Metric(value=self.value)
        error = np.hypot(half_sample_error(self.by_halves), self.unsure)
        return Metric(value=self.value, standard_error=float(error))

    @property
    def noise(self) -> Float[np.ndarray, " h"]:
        """Noise by half of the replicates, up to a factor; empty unless there are 16."""
        return np.zeros(0) if self.by_halves is None else _above_other_half(self.by_halves)

    def change_from(self, before: "ExtremeEstimate") -> Metric:
        """Difference from ``before``, the estimate of another lens by the same rays."""
        value = self.value - before.value
        if self.by_halves is None or before.by_halves is None:
            return ExtremeEstimate(value).metric()
        unsure = abs(self.unsure - before.unsure)
        return ExtremeEstimate(value, self.by_halves - before.by_halves, unsure).metric()

    def change_of(self, designed: float, before: "ExtremeEstimate") -> Metric:
        """Change from ``before`` to this light of ``designed``, a ratio of ``before`` by many rays: within 0 and 1.

        Few rays may change it by more; so may half of them, and the error is that of what is kept within.
        """
        value = float(np.clip(self.value - before.value, -designed, 1.0 - designed))
        if self.by_halves is None or before.by_halves is None:
            return Metric(value=value)
        by_halves = np.clip(self.by_halves - before.by_halves, -designed, 1.0 - designed)
        return ExtremeEstimate(value, by_halves, abs(self.unsure - before.unsure)).metric()


def least_over_mean(readings: Float[np.ndarray, "r k"]) -> ExtremeEstimate:
    """Least over mean of the values at ``k`` places, at most 1, corrected as in :func:`debiased_minimum`.

    If a replicate is dark: that of the mean, with its noise; 0 without light.
    """
    means = readings.mean(axis=1)
    if len(readings) == REPLICATES and (means > 0.0).all():
        return _least(readings / means[:, None], 1.0)
    mean = readings.mean(axis=0)
    return ExtremeEstimate(float(mean.min() / mean.mean()) if mean.mean() > 0.0 else 0.0)


def debiased_minimum(readings: Float[np.ndarray, "r k"], most: float | None = None) -> Metric:
    """Minimum over ``k`` places, corrected for the bias that noise gives the least of several readings.

    Each replicate of ``readings`` is an unbiased reading of all places.

    It is at most ``most``, by default the mean of all readings.

    The standard error is by half-samples. Other than 16 replicates: the least of their mean, with its noise, or
    ``most``, and no standard error.
    """
    return _least(readings, most).metric()


def debiased_maximum(readings: Float[np.ndarray, "r k"], least: float | None = None) -> Metric:
    """Maximum over ``k`` places, corrected for the bias of noise as in :func:`debiased_minimum`.

    It is at least ``least``, by default the mean of all readings.
    """
    return maximum_estimate(readings, least).metric()


def maximum_estimate(readings: Float[np.ndarray, "r k"], least: float | None = None) -> ExtremeEstimate:
    """The estimate of :func:`debiased_maximum`."""
    negative = _least(-readings, None if least is None else -least)
    by_halves = None if negative.by_halves is None else -negative.by_halves
    return ExtremeEstimate(-negative.value, by_halves, negative.unsure)


def ratio_of(part: Metric, largest: Metric) -> Metric:
    """Ratio of a figure to the largest of its kind, with independent errors: at most 1, whatever the noise.

    0 unless the latter is above 0.
    """
    if not largest.value > 0.0:
        return Metric(value=0.0)
    ratio = part.value / largest.value
    value = min(ratio, 1.0)
    if part.standard_error is None or largest.standard_error is None:
        return Metric(value=value)
    error = np.hypot(part.standard_error, ratio * largest.standard_error) / largest.value
    return Metric(value=value, standard_error=float(error))


def _least(readings: Float[np.ndarray, "r k"], most: float | None = None) -> ExtremeEstimate:
    """Minimum, between that of the mean with its noise and ``most``, by default the mean of all readings."""
    if len(readings) != REPLICATES:
        least = float(readings.mean(axis=0).min())
        return ExtremeEstimate(least if most is None else min(least, most))
    whole, halves, quarters, pairs = (
        _Choices.of(readings, blocks) for blocks in (np.ones((1, REPLICATES)), _halves(), _quarters(), _pairs())
    )
    means = readings.mean(axis=1)

    def bounded(samples: _Choices, values: Float[np.ndarray, " s"]) -> Float[np.ndarray, " s"]:
        return np.clip(values, samples.least, samples.mean_of(means) if most is None else most)

    level = halves.within(whole.blocks)
    slope = level.slope(quarters.within(whole.blocks))
    (value,) = bounded(whole, level.extrapolated(slope))
    half_level = quarters.within(halves.blocks)
    by_halves = bounded(halves, half_level.extrapolated(half_level.slope(pairs.within(halves.blocks))))
    # a slope of 0: no ray or too few of them lie in the darkest pixels, of which nothing can be extrapolated
    unsure = max(float(level.read[0] - value), 0.0) if slope[0] == 0.0 else 0.0
    return ExtremeEstimate(float(value), by_halves, unsure)


@cache
def _halves() -> Blocks:
    """The 30 affine hyperplanes of the 16 vectors of 4 bits, each followed by its complement."""
    return np.array(
        [[((row & k).bit_count() + odd) % 2 for k in range(REPLICATES)] for row in range(1, 16) for odd in (0, 1)],
        dtype=np.float64,
    )


@cache
def _quarters() -> Blocks:
    """The 140 affine planes: every four vectors whose sum is 0."""
    planes = [four for four in combinations(range(REPLICATES), 4) if four[0] ^ four[1] ^ four[2] ^ four[3] == 0]
    return _blocks_of(planes)


@cache
def _pairs() -> Blocks:
    """The 120 affine lines: every two vectors."""
    return _blocks_of(list(combinations(range(REPLICATES), 2)))


def _blocks_of(members: Sequence[tuple[int, ...]]) -> Blocks:
    return np.array([[float(k in block) for k in range(REPLICATES)] for block in members])


@dataclass(frozen=True)
class _Level:
    """Least values at one level of noise in each of ``s`` samples of the replicates: the mean of those in the mean of
    each block within the sample, u, and of the readings there in the rest of the sample, v.
    """

    minimum: Float[np.ndarray, " s"]
    read: Float[np.ndarray, " s"]

    def slope(self, noisier: "_Level") -> Float[np.ndarray, " s"]:
        """The slope h through both levels, within its theoretical bounds 0 and 1; 1, the safe one, if they agree."""
        by_noise = self.minimum - noisier.minimum
        optimism = (noisier.read - noisier.minimum) - (self.read - self.minimum)
        agree = optimism <= _ROUNDING * np.abs(self.read)  # all blocks chose the same pixels
        return np.where(agree, 1.0, np.clip(by_noise / np.where(agree, 1.0, optimism), 0.0, 1.0))

    def extrapolated(self, slope: Float[np.ndarray, " s"]) -> Float[np.ndarray, " s"]:
        """The value without noise."""
        return np.asarray(self.minimum + slope * (self.read - self.minimum))


@dataclass(frozen=True)
class _Choices:
    """Darkest pixels by the mean over each block of replicates.

    ``blocks``: 1 where a replicate is in a block. ``values``: of the pixel that a block chose, in every replicate.
    """

    blocks: Blocks
    values: Float[np.ndarray, "b r"]

    @staticmethod
    def of(images: Float[np.ndarray, "r n"], blocks: Blocks) -> "_Choices":
        parts = 1 + len(blocks) * images.shape[1] // _AT_ONCE  # bounds the memory
        return _Choices(
            blocks, np.concatenate([_darkest(some_blocks, images) for some_blocks in np.array_split(blocks, parts)])
        )

    def mean_of(self, values: Float[np.ndarray, " r"]) -> Float[np.ndarray, " b"]:
        """Mean over the replicates of each block."""
        return np.asarray(self.blocks @ values / self.blocks.sum(axis=1))

    @cached_property
    def least(self) -> Float[np.ndarray, " b"]:
        """Value of the pixel in the mean that chose it."""
        return np.asarray((self.blocks * self.values).sum(axis=1) / self.blocks.sum(axis=1))

    def within(self, samples: Blocks) -> _Level:
        """Least values by the blocks that lie within each of ``samples``, all of one size."""
        inside = (1.0 - samples) @ self.blocks.T == 0.0
        rest = samples.sum(axis=1) - self.blocks[0].sum()
        in_block = (self.blocks * self.values).sum(axis=1)
        readings = (samples @ self.values.T - in_block) / rest[:, None]
        count = inside.sum(axis=1)
        return _Level(inside @ self.least / count, (inside * readings).sum(axis=1) / count)


def _darkest(blocks: Blocks, images: Float[np.ndarray, "r n"]) -> Float[np.ndarray, "b r"]:
    """Value in every replicate of each block's darkest pixel; the mean of all if several are as dark but for rounding.

    No ray reaches some of them, or one ray of those that are alike.
    """
    light = blocks @ images
    limit = light.min(axis=1) + _ROUNDING * np.abs(light).max(axis=1)
    block, pixel = np.divmod(np.flatnonzero(light <= limit[:, None]), images.shape[1])
    first = np.searchsorted(block, np.arange(len(blocks)))
    sums = np.add.reduceat(images.T[pixel], first)
    return sums / np.diff(first, append=len(block))[:, None]
