"""Form deviation of a measured surface: a smooth function fitted to the points, and its maps over the chart.

The basis functions are those of the design, without its symmetry: manufacturing errors have none. Detail finer than the
narrowest of them stays in the residual, with the noise of the probe.

Mean squares are over the area: the sum over the pixels inside the rim, each with the area of the face over it. On
201 x 201 pixels the mean square of a smooth change is exact to 1e-4.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.cad.patch import Patch
from lensforge.made.measurement_result import area_extent
from lensforge.results import Extent
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface, to_sphere

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


_MAP_PIXELS = 201


@dataclass(frozen=True)
class FacePixels:
    """Pixels of the chart inside the rim: their area (mm^2), and maps of radial changes along the normal (um)."""

    axis: Float[np.ndarray, " m"]
    area_mm2: Float[np.ndarray, "m m"]
    directions: Float[np.ndarray, "k 3"]
    cosine: Float[np.ndarray, " k"]

    @staticmethod
    def of(patch: Patch) -> "FacePixels":
        """Pixels of the face of ``patch``."""
        axis = np.linspace(-1.0, 1.0, _MAP_PIXELS)
        chart = np.stack(np.meshgrid(axis, axis), axis=-1)
        inside = np.sum(chart**2, axis=-1) <= 1.0
        jet, directions = patch.jet(chart[inside]), to_sphere(chart[inside])
        area = np.full(inside.shape, np.nan)
        area[inside] = jet.area_element * (axis[1] - axis[0]) ** 2
        return FacePixels(axis, area, directions, np.sum(jet.normal * directions, axis=1))

    def map_um(self, change: Surface) -> Float[np.ndarray, "m m"]:
        """A radial change along the normal (um), [Y, X], NaN outside the rim."""
        values = np.full(self.area_mm2.shape, np.nan)
        values[np.isfinite(self.area_mm2)] = 1e3 * self.cosine * change.radius(self.directions)
        return values

    def extent_um(self, change: Surface) -> Extent:
        """Largest absolute value and rms over the area of a radial change, along the normal (um)."""
        return area_extent(self.map_um(change), self.area_mm2)
