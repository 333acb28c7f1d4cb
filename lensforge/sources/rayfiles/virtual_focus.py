"""Virtual focus: the point nearest to all rays, by least squares weighted with their flux."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

_PARALLEL = 1e-9  # smallest over largest eigenvalue below which rays count as parallel


@dataclass
class FocusFit:
    """Normal equations of ``min_p sum_i flux_i |(1 - k_i k_i^T)(p - x_i)|^2``, gathered from any number of blocks."""

    matrix: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.zeros((3, 3)))
    moment: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))

    def add(
        self,
        positions: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        flux: Float[np.ndarray, " n"],
    ) -> None:
        """Add ``n`` rays: positions in mm, unit directions, flux above 0 in any unit.

        Sums of columns, not products of matrices: the threads of these spin from one block to the next.
        """
        along = sum((positions[:, axis] * directions[:, axis] for axis in range(3)), np.zeros(len(flux)))
        for row in range(3):
            weighted = flux * directions[:, row]
            self.moment[row] += (flux * positions[:, row]).sum() - (weighted * along).sum()
            for column in range(row, 3):
                self.matrix[row, column] -= (weighted * directions[:, column]).sum()
                self.matrix[column, row] = self.matrix[row, column]
            self.matrix[row, row] += flux.sum()

    def point(self) -> Float[np.ndarray, " 3"] | None:
        """Solve for the virtual focus (mm); None where the rays are parallel."""
        eigenvalues = np.linalg.eigvalsh(self.matrix)
        if not eigenvalues[0] > _PARALLEL * eigenvalues[2]:
            return None
        return np.linalg.solve(self.matrix, self.moment)


def virtual_focus(
    positions: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    flux: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " 3"] | None:
    """Compute the virtual focus (mm) of rays with unit directions; None where they are parallel."""
    fit = FocusFit()
    fit.add(positions, directions, flux)
    return fit.point()
