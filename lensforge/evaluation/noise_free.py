"""Squared metrics of the light itself, without the noise of the rays: estimates from replicates of an image.

Ray noise adds to every square: the error of the mean of r images is that of the light, and 1/r of the variance between
the images. The product of two *different* images has no such part, so the mean over all pairs of them is unbiased for
any number of rays (a U-statistic; Hoeffding 1948). Figures and their standard errors follow from the matrix of the
inner products of the images.

Replicates of an analytic source are independent scrambles. Those of a measured source are a random division of its
rays: the estimate is then the light of the LED that was measured, and the standard error that of a file with so many
rays, as far as they are independent draws from the LED's light; rays in a regular pattern are better than stated. A
lens that was designed with the same rays has adapted to their noise, and looks better by its overfit than it is: so
others are held back from the search.

Two lenses lit by the same rays share much of the noise: the error of the change from one to the other is that of the
difference of their pairs.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.evaluation.metrics import nmse, relative_deviation
from lensforge.records import Image, Metric

_LEAST_REPLICATES = 4  # the fewest that tell effects from interactions

Images = Float[np.ndarray, "r h w"]


@dataclass(frozen=True)
class PairEstimate:
    """An estimate by pairs of replicates, and how far each pair is from it; None with too few replicates."""

    value: float
    deviations: Float[np.ndarray, "r r"] | None = None

    def metric(self) -> Metric:
        """Value and standard error."""
        error = None if self.deviations is None else _error_over_pairs(self.deviations)
        return Metric(value=self.value, standard_error=error)

    def change_from(self, before: "PairEstimate") -> Metric:
        """Difference from ``before``, of another lens by the same rays."""
        if self.deviations is None or before.deviations is None:
            return PairEstimate(self.value - before.value).metric()
        return PairEstimate(self.value - before.value, self.deviations - before.deviations).metric()


@dataclass(frozen=True)
class RootEstimate(PairEstimate):
    """The root of ``square``, an estimate by pairs; None with too few replicates."""

    square: PairEstimate | None = None

    def change_of(self, designed: float, before: "RootEstimate") -> Metric:
        """Change of ``designed``, the value of ``before`` by many rays, from ``before`` to this light.

        Squares are unbiased and change alike by few rays and by many, roots do not: of few rays that of the one may be
        0 and of the other above ``designed``. The changed value is the root of the changed square, at least 0.
        """
        if self.square is None or before.square is None:
            return Metric(value=max(self.value - before.value, -designed))
        change = self.square.change_from(before.square)
        value, noise = float(np.sqrt(max(designed**2 + change.value, 0.0))), change.standard_error or 0.0
        error = noise / (2.0 * max(value, 0.5 * np.sqrt(noise) or 1.0))  # the slope of the root, as of the estimate
        return Metric(value=value - designed, standard_error=float(error))


def nmse_without_noise(images: Images, target: Image) -> Metric:
    """:func:`nmse_estimate` as a record."""
    return nmse_estimate(images, target).metric()


def rsd_without_noise(images: Images, mask: Bool[np.ndarray, "h w"]) -> Metric:
    """:func:`rsd_estimate` as a record."""
    return rsd_estimate(images, mask).metric()


def nmse_estimate(images: Images, target: Image) -> PairEstimate:
    """NMSE of the light to which ``images`` are unbiased: D_k = I_k - s_k T, with s_k = sum I_k / sum T.

    Mean over all pairs k != l of <D_k, D_l>, over the mean of s_k s_l <T, T>. It is not clipped: where the light is
    closer to the target than the noise can tell, it may be below 0. Fewer than four replicates, or light in fewer than
    four of them, have no such estimate: the NMSE of their mean, with its noise, and no standard error.
    """
    scales = images.sum(axis=(1, 2)) / target.sum()
    if not _enough(scales):
        return PairEstimate(nmse(images.mean(axis=0), target))
    errors = images - scales[:, None, None] * target
    return PairEstimate(*_ratio_of_squares(errors.reshape(len(images), -1), scales * np.linalg.norm(target)))


def rsd_estimate(images: Images, mask: Bool[np.ndarray, "h w"]) -> RootEstimate:
    """RSD in ``mask`` of the light to which ``images`` are unbiased: the root of its squared relative deviation.

    That square is the mean over all pairs k != l of <E_k, E_l>, E_k the deviations from the mean in the mask, over that
    of the products of the means. An estimate below 0 counts as 0. Too few replicates: as for the NMSE.
    """
    inside = images[:, mask]
    means = inside.mean(axis=1)
    if not _enough(means):
        return RootEstimate(relative_deviation(images.mean(axis=0), mask))
    deviations = (inside - means[:, None]) / np.sqrt(inside.shape[1])
    squared, apart = _ratio_of_squares(deviations, means)
    value, error = np.sqrt(max(squared, 0.0)), _error_over_pairs(apart)
    # the slope of the root, bounded where the square is not larger than its own error, so that 0 has an error too
    slopes = apart / (2.0 * max(value, 0.5 * np.sqrt(error) or 1.0))
    return RootEstimate(float(value), slopes, PairEstimate(squared, apart))


def _enough(amounts: Float[np.ndarray, " r"]) -> bool:
    return int(np.count_nonzero(amounts > 0.0)) >= _LEAST_REPLICATES


def _ratio_of_squares(
    errors: Float[np.ndarray, "r n"], scales: Float[np.ndarray, " r"]
) -> tuple[float, Float[np.ndarray, "r r"]]:
    """``|E errors|^2 / (E scales)^2`` without noise, and how far each pair of replicates is from it."""
    squares, norms = errors @ errors.T, np.outer(scales, scales)
    norm = _over_pairs(norms)
    value = _over_pairs(squares) / norm
    return value, (squares - value * norms) / norm


def _over_pairs(products: Float[np.ndarray, "r r"]) -> float:
    """Mean of the products of two different replicates."""
    count = len(products)
    return float((products.sum() - np.trace(products)) / (count * (count - 1)))


def _error_over_pairs(products: Float[np.ndarray, "r r"]) -> float:
    """Standard error of :func:`_over_pairs`.

    A product is the mean, an effect of either replicate, and an interaction of the two, whose variance is z. The
    jackknife gives 4 z / (r (r - 2)) for the interactions, of which it is 2 z / (r (r - 1)): twice too much where noise
    outweighs the square, so the difference is taken off (Efron & Stein 1981).
    """
    count = len(products)
    mean = _over_pairs(products)
    sums = products.sum(axis=1) - np.diag(products)
    effects = (sums - (count - 1) * mean) / (count - 2)
    rest = products - mean - effects[:, None] - effects[None, :]
    z = (np.sum(rest**2) - np.sum(np.diag(rest) ** 2)) / (count * (count - 3))
    own = 2.0 * z / (count * (count - 1))
    jackknife = 4.0 * np.sum(effects**2) / (count * (count - 1))
    return float(np.sqrt(max(jackknife - 4.0 * z / (count * (count - 2)), 0.0) + own))
