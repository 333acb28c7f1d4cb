"""Form deviation of a measured surface from the design, as a smooth function fitted to the points.

The basis functions are those of the design, without its symmetry: manufacturing errors have none. Detail finer than
the narrowest of them stays in the residual, with the noise of the probe.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere

_CHUNK = 8192
_RIDGES = np.logspace(-12, 2, 57)  # of the largest eigenvalue
_COVERAGE_DIRECTIONS = 2000


@dataclass(frozen=True)
class FormDeviation:
    """Radial deviation (mm) over direction as an SRBF sum of offset 0, and the rms residual (mm) of the fit."""

    surface: SrbfSurface
    residual_rms_mm: float


def fit_deviation(
    basis: SrbfBasis, directions: Float[np.ndarray, "n 3"], deviations: Float[np.ndarray, " n"]
) -> FormDeviation:
    """Fit radial ``deviations`` (mm) at unit ``directions`` by the functions of ``basis``, without its symmetry.

    Ridge regression, its strength by generalised cross-validation (Golub, Heath and Wahba, Technometrics 21, 1979):
    the noise of the points decides how much of the detail is kept.
    """
    free = SrbfBasis(basis.levels, basis.sigma_c)
    moments, load, total = np.zeros((free.size, free.size)), np.zeros(free.size), float(np.sum(deviations**2))
    for rows in np.split(np.arange(len(directions)), range(_CHUNK, len(directions), _CHUNK)):
        values = free.evaluate(directions[rows])
        moments += values.T @ values
        load += values.T @ deviations[rows]
    eigenvalues, vectors = np.linalg.eigh(moments)
    eigenvalues, turned = np.maximum(eigenvalues, 0.0), vectors.T @ load
    ridge = _best_ridge(eigenvalues, turned, total, len(directions))
    weights = vectors @ (turned / (eigenvalues + ridge))
    surface = SrbfSurface(free, weights, 0.0)
    residual = deviations - surface.radius(directions)
    return FormDeviation(surface, float(np.sqrt(np.mean(residual**2))))


def _best_ridge(
    eigenvalues: Float[np.ndarray, " m"], turned: Float[np.ndarray, " m"], total: float, count: int
) -> float:
    """Ridge with the least ``RSS / (n - degrees of freedom)^2``."""
    ridges = _RIDGES[:, None] * eigenvalues.max()
    kept = eigenvalues / (eigenvalues + ridges)
    explained = turned**2 / (eigenvalues + ridges)
    rss = np.maximum(total - np.sum(explained * (2.0 - kept), axis=1), 1e-14 * total)
    freedom = count - kept.sum(axis=1)
    score = np.where(freedom > 0.0, rss / np.maximum(freedom, 1.0) ** 2, np.inf)
    return float(ridges[np.argmin(score), 0])


def coverage(directions: Float[np.ndarray, "n 3"], reach_rad: float) -> float:
    """Share of the hemisphere that has a measured point within ``reach_rad``; elsewhere the design is assumed."""
    chord = 2.0 * np.sin(0.5 * reach_rad)
    nearest, _ = cKDTree(directions).query(fibonacci_hemisphere(_COVERAGE_DIRECTIONS), distance_upper_bound=chord)
    return float(np.isfinite(nearest).mean())
