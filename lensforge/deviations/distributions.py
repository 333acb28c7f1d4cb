"""Distributions of a tolerance, in units of its amount: quantiles, and polynomials that are orthonormal under them."""

from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from lensforge.deviations.factors import Factor

_PER_AMOUNT = 2.0  # standard deviations of a normal distribution: 95 % of the parts lie within the amount
_TAIL = float(norm.cdf(-_PER_AMOUNT))
_QUADRATURE = 200  # Gauss points over the width of a distribution: moments to degree 8 are exact
_WIDEST = 10.0  # standard deviations of a normal distribution: beyond, no part is ever drawn


def quantiles(factor: Factor, levels: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Values (in units of the amount) below which the shares ``levels``, between 0 and 1, of the parts lie.

    Of a one-sided factor the distribution of the absolute value.
    """
    if factor.kind == "field":
        return np.asarray(norm.ppf(levels))
    share = 0.5 + 0.5 * levels if factor.kind == "one-sided" else levels
    if factor.distribution == "uniform":
        return 2.0 * share - 1.0
    if factor.distribution == "truncated":
        share = _TAIL + (1.0 - 2.0 * _TAIL) * share
    return np.asarray(norm.ppf(share) / _PER_AMOUNT)


def orthonormal(factor: Factor, values: Float[np.ndarray, "*n"], degree: int) -> Float[np.ndarray, "*n d"]:
    """Polynomials of degree 1 to ``degree`` at ``values`` (in units of the amount), orthonormal over the parts."""
    nodes, weights = _quadrature(factor)
    _, triangle = np.linalg.qr(np.vander(nodes, degree + 1, increasing=True) * np.sqrt(weights)[:, None])
    powers = values[..., None] ** np.arange(degree + 1)
    found: Float[np.ndarray, "*n d"] = np.linalg.solve(triangle.T, powers.reshape(-1, degree + 1).T).T
    return found.reshape(*values.shape, degree + 1)[..., 1:]


def _quadrature(factor: Factor) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Values, and the shares of the parts for which each stands."""
    high = _WIDEST / _PER_AMOUNT if factor.distribution == "normal" else 1.0
    low = 0.0 if factor.kind == "one-sided" else -high
    points, weights = _gauss()
    values = low + 0.5 * (high - low) * (points + 1.0)
    density = np.ones(_QUADRATURE) if factor.distribution == "uniform" else norm.pdf(_PER_AMOUNT * values)
    shares = weights * density
    return values, shares / shares.sum()


@cache
def _gauss() -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Points and weights on -1 to 1: 20 ms, which a study would spend once for each of its factors."""
    return np.polynomial.legendre.leggauss(_QUADRATURE)
