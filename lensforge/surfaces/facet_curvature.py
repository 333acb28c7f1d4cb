"""Curvature of the smooth surface for which the facets of a mesh stand.

The normal of facets jumps from one to the next, so that its slope is 0 everywhere. That of the surface is told by the
edges: in the middle of each, the normal is the mean of those of both facets, and linear in between.
"""

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import lengths

_SMOOTH_RAD = 0.3  # between neighbours of one smooth surface: above the 15 degrees of the coarsest cylinder
_TINY = np.finfo(float).tiny


def facet_curvatures(corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3 3"]:
    """Change of the unit normal (column, 1/mm) by a step along each triangle; 0 for flat surroundings.

    ``corners``: of triangles (mm), of which equal ones have the same bits. Across an edge at which they meet at more
    than 0.3 rad, or that does not join two of them, a surface ends.
    """
    _, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    opposite = np.roll(numbers.reshape(-1, 3), -1, axis=1)  # the edge k lies opposite the corner k
    ends = np.stack([opposite, np.roll(opposite, -1, axis=1)], axis=2).reshape(-1, 2)
    _, edges = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    edges = edges.reshape(-1, 3)
    first, second, third = np.moveaxis(corners, 1, 0)
    areas = np.cross(second - first, third - first)
    twice = np.maximum(lengths(areas), _TINY)[:, None]
    normals = areas / twice
    count = np.bincount(edges.ravel())
    sums = np.zeros((len(count), 3))
    np.add.at(sums, edges, normals[:, None])
    size = np.maximum(lengths(sums), _TINY)
    smooth = (count == 2) & (size > 2.0 * np.cos(0.5 * _SMOOTH_RAD))
    at_edges = np.where(smooth[edges][..., None], (sums / size[:, None])[edges], normals[:, None])
    sides = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    slopes = -2.0 * np.cross(normals[:, None], sides) / twice[:, None]  # of 1 - 2 lambda, which is 1 along an edge
    across = (
        at_edges - (at_edges * normals[:, None]).sum(axis=2, keepdims=True) * normals[:, None]
    )  # a unit vector turns
    return np.einsum("tki,tkj->tij", across, slopes)
