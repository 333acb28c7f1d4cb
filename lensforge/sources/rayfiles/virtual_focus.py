"""The point that the rays seem to come from: least squares over their distances to it."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

_PARALLEL = 1e-9  # smallest over largest eigenvalue below which rays fix no point: parallel or nearly so


@dataclass
class FocusFit:
    """Normal equations of ``min_p sum_i w_i |(1 - k_i k_i^T)(p - x_i)|^2``, gathered from any number of parts."""

    matrix: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.zeros((3, 3)))
    moment: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))

    def add(
        self,
        positions: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        weights: Float[np.ndarray, " n"],
    ) -> None:
        """Take in ``n`` rays: positions in mm, unit directions, positive weights."""
        self.matrix += weights.sum() * np.eye(3) - (weights[:, None] * directions).T @ directions
        across = positions - np.sum(positions * directions, axis=1, keepdims=True) * directions
        self.moment += weights @ across

    def point(self) -> Float[np.ndarray, " 3"] | None:
        """The virtual focus (mm), or None where the rays fix no point."""
        eigenvalues = np.linalg.eigvalsh(self.matrix)
        if not eigenvalues[0] > _PARALLEL * eigenvalues[2]:
            return None
        return np.linalg.solve(self.matrix, self.moment)


def virtual_focus(
    positions: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " 3"] | None:
    """The flux-weighted virtual focus (mm) of rays with unit directions, or None where they fix no point."""
    fit = FocusFit()
    fit.add(positions, directions, weights)
    return fit.point()
