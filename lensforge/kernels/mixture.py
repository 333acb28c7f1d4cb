"""Mixture of products of place and angle that rays are fitted by: densities, and one step of their fit.

A factor k has a weight ``place[c, k]`` in each cell, and ``angle[j, k]`` of each function of the angle; a ray is in one
cell, and four functions have a share at its angle. A step is that of expectation and maximisation (Dempster, Laird,
Rubin 1977): it never lowers the likelihood of the rays.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.compiled import inline, kernel

_LEAST = 1e-300


class SortedRays(NamedTuple):
    """Rays as a fit sees them: cell, functions of the angle with their densities there, and share of the flux."""

    cells: Int[np.ndarray, " n"]
    nodes: Int[np.ndarray, "n 4"]
    shares: Float[np.ndarray, "n 4"]
    weights: Float[np.ndarray, " n"]

    def part(self, rows: slice) -> "SortedRays":
        """Some of the rays."""
        return SortedRays(*(each[rows] for each in self))


@inline
def _mixed(rays, ray, place, angle, parts):
    """Density of one ray, and the part of it by each factor."""
    total, cell, nodes, shares = 0.0, rays.cells[ray], rays.nodes, rays.shares
    first, second, third, last = nodes[ray, 0], nodes[ray, 1], nodes[ray, 2], nodes[ray, 3]
    a, b, c, d = shares[ray, 0], shares[ray, 1], shares[ray, 2], shares[ray, 3]
    for k in range(place.shape[1]):
        at_angle = a * angle[first, k] + b * angle[second, k] + c * angle[third, k] + d * angle[last, k]
        parts[k] = at_angle * place[cell, k]
        total += parts[k]
    return total


@kernel
def densities(rays, place, angle, parts, found):
    """Put the density of each ray into ``found``; ``parts``: room for one number of each factor."""
    for ray in range(len(found)):
        found[ray] = _mixed(rays, ray, place, angle, parts)


@kernel
def expect(rays, place, angle, parts, by_place, by_angle):
    """Add the expected weight of each factor in each cell to ``by_place``, over its own in each function to
    ``by_angle``."""
    for ray in range(len(rays.cells)):
        cell, nodes, shares = rays.cells[ray], rays.nodes, rays.shares
        ratio = rays.weights[ray] / max(_mixed(rays, ray, place, angle, parts), _LEAST)
        for k in range(place.shape[1]):
            by_place[cell, k] += ratio * parts[k]
            part = ratio * place[cell, k]
            for corner in range(4):
                by_angle[nodes[ray, corner], k] += shares[ray, corner] * part
