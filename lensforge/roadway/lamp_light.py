"""Light of a lamp that shines down on a road, in directions counted from the street.

The lateral angle is 0 towards the street, 90 and 270 degrees along it, 180 towards the house; gamma = 0 is straight
down. That is the frame in which ANSI/IES TM-15 and the distribution types are defined.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from jaxtyping import Float

from lensforge.jackknife import jackknife_metric
from lensforge.records import Metric

if TYPE_CHECKING:
    from scipy import sparse

Degrees = Float[np.ndarray, " k"]


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

    ``street_deg``: azimuth of the street, in the frame of the grid. ``finer``: the same light by a table of half the
    steps, as one sample.
    """

    grid: IntensityGrid
    samples: Float[np.ndarray, "p c g"]
    street_deg: float
    finer: "LampLight | None" = None

    def times(self, count: int) -> "LampLight":
        """Light of so many."""
        finer = None if self.finer is None else self.finer.times(count)
        return replace(self, samples=count * self.samples, finer=finer)

    def intensities(self, lateral_deg: Degrees, gamma_deg: Degrees) -> Float[np.ndarray, "p k"]:
        """Intensity (cd) in each direction, by each sample."""
        matrix = self.grid.readings(lateral_deg + self.street_deg, gamma_deg)
        read: Float[np.ndarray, "p k"] = (matrix @ self.samples.reshape(len(self.samples), -1).T).T
        return read

    @staticmethod
    def figure(by_sample: Float[np.ndarray, " p"], unit: str) -> Metric:
        """Mean of a figure that is linear in the light, with its standard error."""
        return jackknife_metric(by_sample[:, None], lambda mean: float(mean[0]), unit)
