"""Integrals over the area of a face: Gauss-Legendre in the chart's radius times the trapezoidal rule in azimuth.

The unit circle of the chart is the rim, so the rule fits the face and needs no share of cells that the rim cuts. For
smooth integrands both factors converge faster than any power. Measured: areas of spheres, spheroids and ellipsoids
1e-9, of a random face of 115 functions 1e-8. Shares of the area below a limit have an edge inside the face: it is
located along each radius to second order, and the zone of a hemisphere with little draft comes out to 3e-5 of its area.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

RADII, AZIMUTHS = 96, 192


@dataclass(frozen=True)
class AreaRule:
    """Integration points on the unit disc, radius slowest, and their weights in chart area."""

    radii: int
    chart: Float[np.ndarray, "q 2"]
    weights: Float[np.ndarray, " q"]
    nodes: Float[np.ndarray, " r"]
    edges: Float[np.ndarray, " r1"]  # of the stretch of radius that each node stands for

    def share_below(self, values: Float[np.ndarray, " q"], limit: float, areas: Float[np.ndarray, " q"]) -> float:
        """Share of the area where ``values`` are below ``limit``; ``areas``: of the face, for each point."""
        excess = values.reshape(self.radii, -1) - limit
        slope = np.gradient(excess, self.nodes, axis=0)
        inner = excess + slope * (self.edges[:-1] - self.nodes)[:, None]
        outer = excess + slope * (self.edges[1:] - self.nodes)[:, None]
        low, high = np.minimum(inner, outer), np.maximum(inner, outer)
        rise = np.where(high > low, high - low, 1.0)
        below = np.where(high <= 0.0, 1.0, np.where(low >= 0.0, 0.0, -low / rise))
        return float(np.sum(areas * below.ravel()) / np.sum(areas))


@cache
def area_rule(radii: int = RADII, azimuths: int = AZIMUTHS) -> AreaRule:
    """The rule with ``radii`` x ``azimuths`` points."""
    node, weight = np.polynomial.legendre.leggauss(radii)
    node, weight = (node + 1.0) / 2.0, weight / 2.0
    azimuth = np.arange(azimuths) * (2.0 * np.pi / azimuths)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    return AreaRule(
        radii=radii,
        chart=(node[:, None, None] * circle).reshape(-1, 2),
        weights=np.repeat(weight * node * (2.0 * np.pi / azimuths), azimuths),
        nodes=node,
        edges=np.concatenate([[0.0], np.cumsum(weight)]),  # Gauss weights interlace with their nodes
    )
