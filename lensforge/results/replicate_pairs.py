"""Means of products over pairs of replicates, and their standard errors: squares without the noise of the rays."""

import numpy as np
from jaxtyping import Float


def mean_over_pairs(products: Float[np.ndarray, "r r"]) -> float:
    """Mean of ``products`` over all pairs of different replicates, unbiased by noise (Hoeffding 1948)."""
    count = len(products)
    return float((products.sum() - np.trace(products)) / (count * (count - 1)))


def error_over_pairs(products: Float[np.ndarray, "r r"]) -> float:
    """Standard error of the mean of ``products`` over all pairs of different replicates.

    A product is the mean, an effect of either replicate, and an interaction of the two, whose variance is z. The
    jackknife gives 4 z / (r (r - 2)) for the interactions, of which it is 2 z / (r (r - 1)): twice too much where noise
    outweighs the square, so the difference is taken off (Efron & Stein 1981). By chance that may take off nearly all:
    half of the variance of the interactions always remains. With all of it, errors of noise are an eighth too large.
    """
    count = len(products)
    mean = mean_over_pairs(products)
    sums = products.sum(axis=1) - np.diag(products)
    effects = (sums - (count - 1) * mean) / (count - 2)
    residuals = products - mean - effects[:, None] - effects[None, :]
    z = (np.sum(residuals**2) - np.sum(np.diag(residuals) ** 2)) / (count * (count - 3))
    interactions = 2.0 * z / (count * (count - 1))
    jackknife = 4.0 * np.sum(effects**2) / (count * (count - 1))
    variance = jackknife - 4.0 * z / (count * (count - 2)) + interactions
    return float(np.sqrt(max(variance, 0.5 * interactions)))
