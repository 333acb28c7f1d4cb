"""The least irradiance in a mask, without the noise of the rays, which has no unbiased estimate.

The darkest pixel of a noisy image is too dark: noise chose it. Its value in an image that had no part in the choice is
too bright: it may not be the darkest. Let u be the expected minimum at a noise variance t, v the expected true value
of the pixel chosen there. Integration by parts (Stein 1981) gives v = u - 2 t du/dt for Gaussian noise, whatever its
correlation, so with u = u0 - a t^p the true minimum is

    u0 = u + h (v - u),  h = 1 / (2 p).

E min(x + s z) is concave in s, the root of t, so h is at most 1; that is reached where many pixels are as dark as each
other. It is 1/2 for a single dark spot under little noise, and less where the darkest pixel stands alone. u, v at two
levels of noise give h: both lie on the line of slope -h through u0, in the plane of v - u and u.

The levels are means over 8 and over 4 of 16 replicates, read on those left: over the 30 halves and 140 quarters that
are affine subspaces of the 16 numbers of the replicates, taken as vectors of 4 bits. Each replicate, each pair and each
three of them are in equally many, so that no replicate counts more than another.

The least of the mean of all replicates has noise, and is too dark; the least of the light is no more than its mean:
both are bounds of the estimate. Both lie below v of the halves, so that the first never contradicts u0 <= v.

Chosen by experiment (docs/accuracy.md) among the plain minimum, cross-validated ones, and other extrapolations.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from lensforge.light.metrics import jackknife_error
from lensforge.results import Metric

_REPLICATES = 16
_ROUNDING = 1e-12

Blocks = Float[np.ndarray, "b r"]  # 1 where a replicate is in a block, else 0


@dataclass(frozen=True)
class LeastEstimate:
    """A least value; the same with each replicate left out; and what the extrapolation took off its upper bound.

    With other than 16 replicates there is the value alone.
    """

    value: float
    left_out: Float[np.ndarray, " r"] | None = None
    taken_off: float = 0.0

    def metric(self) -> Metric:
        """Value and standard error, which has two parts: that over the replicates, and what was taken off."""
        if self.left_out is None:
            return Metric(value=self.value)
        return Metric(value=self.value, standard_error=float(np.hypot(jackknife_error(self.left_out), self.taken_off)))

    def change_from(self, before: "LeastEstimate") -> Metric:
        """Difference from ``before``, of another lens by the same rays.

        A small change moves no ray across an edge of the darkest pixels, and all replicates agree on none: the error is
        at least that of one ray. n rays have a relative noise of 1/sqrt(n), so one of them is its square.
        """
        value = self.value - before.value
        if self.left_out is None or before.left_out is None:
            return LeastEstimate(value).metric()
        noise = jackknife_error(before.left_out)
        one_ray = noise**2 / (max(before.value, noise) or 1.0)
        taken_off = float(np.hypot(self.taken_off - before.taken_off, one_ray))
        return LeastEstimate(value, self.left_out - before.left_out, taken_off).metric()


def uniformity_estimate(images: Float[np.ndarray, "r h w"], mask: Bool[np.ndarray, "h w"]) -> LeastEstimate:
    """Least over mean irradiance in ``mask``, of the light to which ``images`` are unbiased."""
    return least_over_mean(images[:, mask])


def least_over_mean(readings: Float[np.ndarray, "r k"]) -> LeastEstimate:
    """Least over mean of the values at ``k`` places, at most 1, without noise: as :func:`least_without_noise`.

    With a replicate without light, too, that of the mean, with its noise; 0 without any.
    """
    means = readings.mean(axis=1)
    if len(readings) == _REPLICATES and (means > 0.0).all():
        return _least(readings / means[:, None], 1.0)
    mean = readings.mean(axis=0)
    return LeastEstimate(float(mean.min() / mean.mean()) if mean.mean() > 0.0 else 0.0)


def least_without_noise(readings: Float[np.ndarray, "r k"]) -> Metric:
    """Least of the values at ``k`` places, of which each replicate is an unbiased reading with noise.

    The standard error has two parts: that of the estimate by the jackknife, with the slope h held, and the rest of the
    way from the estimate to v of the halves, the part that the extrapolation has taken off the rigorous upper bound.
    Other than 16 replicates: the least of their mean, with its noise, and no standard error.
    """
    if len(readings) != _REPLICATES:
        return Metric(value=float(readings.mean(axis=0).min()))
    return _least(readings).metric()


def largest_without_noise(readings: Float[np.ndarray, "r k"]) -> Metric:
    """Largest of the values at ``k`` places: as :func:`least_without_noise`, which would be too large with noise."""
    found = least_without_noise(-readings)
    return found.model_copy(update={"value": -found.value})


def ratio_of(above: Metric, below: Metric) -> Metric:
    """Ratio of two figures whose errors are independent; 0 where the second is not above 0."""
    if not below.value > 0.0:
        return Metric(value=0.0)
    value = above.value / below.value
    if above.standard_error is None or below.standard_error is None:
        return Metric(value=value)
    error = np.hypot(above.standard_error, value * below.standard_error) / below.value
    return Metric(value=value, standard_error=float(error))


def _least(readings: Float[np.ndarray, "r k"], most: float | None = None) -> LeastEstimate:
    """Least value, between that of the mean with its noise and ``most``, by default the mean of all readings."""
    halves, quarters = (_Choices.of(readings, blocks) for blocks in (_halves(), _quarters()))
    slope = _slope(halves, quarters)
    mean = readings.mean(axis=0)
    value = float(np.clip(halves.extrapolated(slope), mean.min(), mean.mean() if most is None else most))
    taken_off = halves.read - value
    return LeastEstimate(value, halves.left_out(slope), taken_off if taken_off > _ROUNDING * abs(value) else 0.0)


def _halves() -> Blocks:
    """The 30 affine hyperplanes of the 16 vectors of 4 bits."""
    return np.array(
        [[((row & k).bit_count() + odd) % 2 for k in range(_REPLICATES)] for row in range(1, 16) for odd in (0, 1)],
        dtype=np.float64,
    )


def _quarters() -> Blocks:
    """The 140 affine planes: every four vectors whose sum is 0."""
    planes = [four for four in combinations(range(_REPLICATES), 4) if four[0] ^ four[1] ^ four[2] ^ four[3] == 0]
    return np.array([[float(k in plane) for k in range(_REPLICATES)] for plane in planes])


@dataclass(frozen=True)
class _Choices:
    """Darkest pixels by the mean over each block of replicates.

    ``blocks``: 1 where a replicate is in a block. ``least``: value of the pixel in that mean. ``readings``: its value
    in every replicate outside the block, 0 in those inside.
    """

    blocks: Blocks
    least: Float[np.ndarray, " b"]
    readings: Float[np.ndarray, "b r"]

    @staticmethod
    def of(images: Float[np.ndarray, "r n"], blocks: Blocks) -> "_Choices":
        values = np.array([_darkest(block, images) for block in blocks])  # one at a time: bounds the memory
        return _Choices(blocks, (blocks * values).sum(axis=1) / blocks.sum(axis=1), (1.0 - blocks) * values)

    @property
    def minimum(self) -> float:
        """The mean least value: u."""
        return float(self.least.mean())

    @property
    def read(self) -> float:
        """The mean reading in the replicates that did not choose: v."""
        return float(self.readings.sum() / (1.0 - self.blocks).sum())

    def extrapolated(self, slope: float) -> float:
        return self.minimum + slope * (self.read - self.minimum)

    def left_out(self, slope: float) -> Float[np.ndarray, " r"]:
        """:meth:`extrapolated` from the blocks without one replicate, which is not read either; for each of them."""
        without = 1.0 - self.blocks
        minimum = self.least @ without / without.sum(axis=0)
        readings = self.readings.sum(axis=1)[:, None] - self.readings
        read = (readings * without).sum(axis=0) / ((without.sum(axis=1) - 1.0) @ without)
        left_out: Float[np.ndarray, " r"] = minimum + slope * (read - minimum)
        return left_out


def _darkest(block: Float[np.ndarray, " r"], images: Float[np.ndarray, "r n"]) -> Float[np.ndarray, " r"]:
    """Value in every replicate of the darkest pixel by ``block``; the mean of them all where rays reached none."""
    light = block @ images
    values: Float[np.ndarray, " r"] = images[:, light == light.min()].mean(axis=1)
    return values


def _slope(halves: _Choices, quarters: _Choices) -> float:
    """The slope h through both levels, within its theoretical bounds 0 and 1; 1, the safe one, where they agree."""
    by_noise = halves.minimum - quarters.minimum
    optimism = (quarters.read - quarters.minimum) - (halves.read - halves.minimum)
    return float(np.clip(by_noise / optimism, 0.0, 1.0)) if optimism > 0.0 else 1.0
