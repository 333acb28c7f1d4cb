"""Metrics of a pattern, their standard errors, and squared metrics of the light without the noise of its rays.

Standard errors are by the jackknife (Efron & Stein 1981), from replicates or from parts of a sample.

Ray noise adds to every square: the error of the mean of r images is the light's own, and 1/r of the variance between
the images. The product of two *different* images has no such part, so the mean over all pairs of them is unbiased for
any number of rays (a U-statistic; Hoeffding 1948). Figures and their standard errors follow from the matrix of the
inner products of the images.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.results import Image, Metric


def jackknife(
    replicates: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float]
) -> tuple[float, float | None]:
    """``statistic`` of the mean over replicates, and its standard error (Efron & Stein 1981); None for one."""
    count = len(replicates)
    total = replicates.sum(axis=0)
    value = statistic(total / count)
    if count < 2:
        return value, None
    return value, jackknife_error(np.array([statistic((total - one) / (count - 1)) for one in replicates]))


def jackknife_metric(
    replicates: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float], unit: str = ""
) -> Metric:
    """:func:`jackknife` as a record."""
    value, error = jackknife(replicates, statistic)
    return Metric(value=value, unit=unit, standard_error=error)


def jackknife_error(left_out: Float[np.ndarray, " r"]) -> float:
    """Standard error of a statistic, from its values ``left_out`` with one replicate at a time left out."""
    count = len(left_out)
    return float(np.sqrt((count - 1) / count * np.sum((left_out - left_out.mean()) ** 2)))


def nmse(irradiance: Image, target: Image) -> float:
    """Eq. (7), with the target scaled to the flux of ``irradiance``: it measures the shape, efficiency the amount.

    1 for a dark image, as for a target that is not scaled.
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
    """NMSE between two pictures without scaling: mean square difference over that of the second; 0 where it is dark."""
    reference = float(np.sum(both[1] ** 2))
    return float(np.sum((both[0] - both[1]) ** 2)) / reference if reference > 0.0 else 0.0


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
