"""The stereographic chart of the hemisphere: one square patch, no pole, no seam.

``(X, Y) = tan(theta/2) (cos phi, sin phi)``; the hemisphere is the unit disc and its rim the unit
circle. Every surface of a lens is a radius ``rho`` over this chart, star-shaped about the origin.
"""

import numpy as np
from jaxtyping import Float

# The chart's square reaches a little past the rim, so that the rim is inside the splines' domain.
HALF_WIDTH = 1.02


def to_sphere(chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
    """Unit directions of chart points: ``u = (2X, 2Y, 1 - R^2) / (1 + R^2)``."""
    squared = np.sum(chart * chart, axis=-1, keepdims=True)
    unit: Float[np.ndarray, "*n 3"] = np.concatenate([2.0 * chart, 1.0 - squared], axis=-1) / (1.0 + squared)
    return unit


def to_chart(directions: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
    """Chart points of directions of any length: ``(X, Y) = (x, y) / (r + z)``; singular at -z only."""
    radius = np.linalg.norm(directions, axis=-1, keepdims=True)
    projected: Float[np.ndarray, "*n 2"] = directions[..., :2] / (radius + directions[..., 2:])
    return projected


def gradient_on_sphere(chart: Float[np.ndarray, "n 2"], slopes: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Tangential gradient on the unit sphere of a function from its slopes along X and Y.

    The chart is conformal, with the scale ``2/(1 + R^2)``; the unit tangents of its axes are the derivatives of
    ``u = (2X, 2Y, 1 - R^2) / (1 + R^2)`` over their length.
    """
    x, y = chart[:, 0], chart[:, 1]
    squared = 1.0 + x**2 + y**2
    along_x = np.stack([1.0 - x**2 + y**2, -2.0 * x * y, -2.0 * x], axis=1) / squared[:, None]
    along_y = np.stack([-2.0 * x * y, 1.0 + x**2 - y**2, -2.0 * y], axis=1) / squared[:, None]
    by_angle = 0.5 * squared[:, None] * slopes
    gradient: Float[np.ndarray, "n 3"] = by_angle[:, :1] * along_x + by_angle[:, 1:] * along_y
    return gradient


def grid(nodes: int, half_width: float = HALF_WIDTH) -> Float[np.ndarray, "n n 2"]:
    """A square grid of ``nodes`` x ``nodes`` chart points, first index X, second index Y."""
    axis = np.linspace(-half_width, half_width, nodes)
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
