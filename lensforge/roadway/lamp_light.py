"""Light of a lamp that shines down on a road, in directions counted from the street.

The lateral angle is 0 towards the street, 90 and 270 degrees along it, 180 towards the house; gamma = 0 is straight
down. That is the frame in which ANSI/IES TM-15 and the distribution types are defined.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from jaxtyping import Float

from lensforge.jackknife import jackknife_metric
from lensforge.records import Metric

if TYPE_CHECKING:
    from scipy import sparse

Degrees = Float[np.ndarray, " k"]
_POINTS = 4  # of Gauss in each cell: sin(gamma) times a line over 10 degrees is integrated to 1e-11


class IntensityGrid(Protocol):
    """Nodes of an intensity table, from whose values the intensity in any direction follows."""

    @property
    def gamma_deg(self) -> Float[np.ndarray, " g"]:
        """Angles of its cones."""
        ...

    @property
    def c_deg(self) -> Float[np.ndarray, " c"]:
        """Angles of its half-planes."""
        ...

    def readings(self, c_deg: Degrees, gamma_deg: Degrees) -> "sparse.csr_array":
        """Matrix from the values of the nodes to the intensity in each direction."""
        ...


@dataclass(frozen=True)
class LampLight:
    """Intensities (cd) of a whole lamp at the nodes of ``grid``, by independent ``samples`` of the rays.

    ``street_deg``: azimuth of the street, in the frame of the grid.
    """

    grid: IntensityGrid
    samples: Float[np.ndarray, "p c g"]
    street_deg: float

    def intensities(self, lateral_deg: Degrees, gamma_deg: Degrees) -> Float[np.ndarray, "p k"]:
        """Intensity (cd) in each direction, by each sample."""
        matrix = self.grid.readings(lateral_deg + self.street_deg, gamma_deg)
        read: Float[np.ndarray, "p k"] = (matrix @ self.samples.reshape(len(self.samples), -1).T).T
        return read

    def flux(self, lateral_deg: tuple[float, float], gamma_deg: tuple[float, float]) -> Metric:
        """Flux (lm) in a zone between two lateral angles and two of gamma: exact for the bilinear table."""
        turns, turn_weights = _gauss(_breaks(self.grid.c_deg - self.street_deg, lateral_deg, 360.0))
        gammas, gamma_weights = _gauss(_breaks(self.grid.gamma_deg, gamma_deg))
        weights = np.outer(turn_weights, gamma_weights * np.sin(np.deg2rad(gammas))).ravel()
        lateral, gamma = (each.ravel() for each in np.meshgrid(turns, gammas, indexing="ij"))
        return self.figure(self.intensities(lateral, gamma) @ weights, "lm")

    @staticmethod
    def figure(by_sample: Float[np.ndarray, " p"], unit: str) -> Metric:
        """Mean of a figure that is linear in the light, with its standard error."""
        return jackknife_metric(by_sample[:, None], lambda mean: float(mean[0]), unit)


def _breaks(nodes: Degrees, ends: tuple[float, float], period: float = 0.0) -> Degrees:
    """Ends of a zone, and the nodes of the table between them, which may repeat with ``period``."""
    low, high = ends
    images = np.concatenate([nodes + turn * period for turn in range(-2, 3)]) if period else nodes
    inside = images[(images > low) & (images < high)]
    breaks: Degrees = np.unique(np.round(np.concatenate([[low, high], inside]), 9))
    return breaks


def _gauss(breaks: Degrees) -> tuple[Degrees, Degrees]:
    """Points (deg) and weights (rad) of Gauss-Legendre quadrature in every cell between ``breaks``."""
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    half = 0.5 * np.diff(breaks)[:, None]
    places = breaks[:-1, None] + half * (1.0 + points)
    return places.ravel(), (np.deg2rad(half) * weights).ravel()
