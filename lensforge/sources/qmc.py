"""Quasi-Monte-Carlo points: scrambled Sobol sequences (Owen 1998; Matousek's linear scramble), by scipy."""

import warnings

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc


def sobol(count: int, dimensions: int, seed: int) -> Float[np.ndarray, "n d"]:
    """Draw ``count`` points of the unit cube, scrambled by ``seed``; a power of two is best balanced."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # scipy warns unless the count is a power of two
        points: Float[np.ndarray, "n d"] = qmc.Sobol(dimensions, scramble=True, rng=seed).random(count)
        return points
