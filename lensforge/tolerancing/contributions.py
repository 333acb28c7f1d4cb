"""Causes of a metric's spread: the first-order share of its variance that each tolerance makes (Sobol 1993).

The share of a factor is the part of the variance that its numbers alone explain. It is the sum of the squared products
of the metric with polynomials that are orthonormal over the parts; a sum over pairs of different parts has no bias by
the scatter of so many products (a U-statistic, as of the NMSE). Numbers that are spread have polynomials to degree 4 in
one, and together in two variables; the hundred numbers of a form error those of degree 1 and 2, all products included:
near an optimum a figure of merit is quadratic in them.
"""

import numpy as np
from jaxtyping import Float

from lensforge.deviations.distributions import orthonormal
from lensforge.deviations.draws import Draws
from lensforge.deviations.factors import Factor
from lensforge.jackknife import jackknife_error
from lensforge.records import Metric
from lensforge.tolerancing.yield_result import CauseShare, Variance

_DEGREE = 4
_BLOCKS = 20  # of the jackknife over parts


def contributions(draws: Draws, values: Float[np.ndarray, " n"], noise: float) -> Variance:
    """Shares of the variance of ``values`` over the parts; ``noise``: that of the rays, which is nobody's."""
    centred = values - values.mean()
    blocks = np.arange(len(values)) % _BLOCKS
    total = _left_out(centred**2, blocks)
    total = total * (len(values) / (len(values) - 1)) - noise
    causes, explained = [], np.zeros(_BLOCKS + 1)
    for factor in draws.factors:
        found = _explained(features(factor, draws.numbers[factor.name]), centred, blocks)
        explained = explained + found
        share = _metric(found / total)
        causes.append(
            CauseShare(
                tolerance=factor.name,
                words=factor.words,
                share=share.value,
                standard_error=share.standard_error or 0.0,
            )
        )
    causes.sort(key=lambda cause: cause.rank)
    return Variance(causes=tuple(causes), interactions=_metric(1.0 - explained / total))


def features(factor: Factor, numbers: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n b"]:
    """Functions of the factor's numbers, orthonormal over the parts."""
    count, dimensions = numbers.shape
    if factor.kind == "field":
        pairs = [numbers[:, i : i + 1] * numbers[:, i + 1 :] for i in range(dimensions - 1)]
        return np.concatenate([numbers, (numbers**2 - 1.0) / np.sqrt(2.0), *pairs], axis=1)
    single = orthonormal(factor, numbers, _DEGREE)
    found = [single[:, k] for k in range(dimensions)]
    if dimensions == 2:
        degrees = [(i, j) for i in range(_DEGREE) for j in range(_DEGREE) if i + j + 2 <= _DEGREE]
        found.append(np.stack([single[:, 0, i] * single[:, 1, j] for i, j in degrees], axis=1))
    return np.concatenate(found, axis=1).reshape(count, -1)


def _left_out(each: Float[np.ndarray, "n *b"], blocks: np.ndarray) -> Float[np.ndarray, "s *b"]:
    """Mean over all parts, then with one block after the other left out."""
    sums = np.stack([each[blocks == k].sum(axis=0) for k in range(_BLOCKS)])
    sizes = np.bincount(blocks, minlength=_BLOCKS).reshape(-1, *(1 for _ in each.shape[1:]))
    without = (sums.sum(axis=0) - sums) / (len(each) - sizes)
    return np.concatenate([sums.sum(axis=0)[None] / len(each), without])


def _explained(
    basis: Float[np.ndarray, "n b"], centred: Float[np.ndarray, " n"], blocks: np.ndarray
) -> Float[np.ndarray, " s"]:
    """Variance that the functions explain, by pairs of different parts; all parts, then each block left out."""
    products = basis * centred[:, None]
    means, squares = _left_out(products, blocks), _left_out(np.sum(products**2, axis=1), blocks)
    sizes = len(centred) - np.concatenate([[0], np.bincount(blocks, minlength=_BLOCKS)])
    found: Float[np.ndarray, " s"] = (sizes * np.sum(means**2, axis=1) - squares) / (sizes - 1)
    return found


def _metric(values: Float[np.ndarray, " s"]) -> Metric:
    """The value of all parts, with its jackknife error over the blocks."""
    return Metric(value=float(values[0]), standard_error=jackknife_error(values[1:]))
