"""Normals of a smooth surface from the vertices of its mesh alone.

Averages of facet normals lean inward at a rim, where facets lie on one side only: on a lens of 100,000 triangles they
are wrong by 6 mrad there. A local polynomial fit is not: it is third order in the edge length, at the rim too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

NEIGHBOURS = 32  # enough on one side of a rim for the nine terms of a cubic
_CHUNK = 16384  # vertices fitted at a time: bounds the memory
# A term that the neighbours do not determine goes to the lower degree: the ridge grows with the degree.
_RIDGE = np.diag([1e-12] * 2 + [1e-9] * 3 + [1e-6] * 4)


@dataclass(frozen=True)
class VertexFit:
    """The surface around each vertex: unit normals, their change ``bends @ displacement`` (1/mm) along it, and misfit.

    ``misfit`` (mm): rms distance of the neighbouring vertices from the fitted surface.
    """

    normals: Float[np.ndarray, "k 3"]
    bends: Float[np.ndarray, "k 3 3"]
    misfit: Float[np.ndarray, " k"]


def fit_vertices(
    vertices: Float[np.ndarray, "k 3"], triangles: Int[np.ndarray, "t 3"], faces: Int[np.ndarray, " k"]
) -> VertexFit:
    """Fit a cubic around each vertex; the triangles say on which side the outside is.

    ``faces`` numbers the smooth face of each vertex; no vertex looks at a neighbour on another face.
    """
    count = len(vertices)
    fit = VertexFit(facet_average(vertices, triangles), np.zeros((count, 3, 3)), np.zeros(count))
    for members in np.split(np.argsort(faces, kind="stable"), np.cumsum(np.bincount(faces))[:-1]):
        if len(members) < NEIGHBOURS:
            continue  # a few facets, such as those of a box: the average is all there is
        tree = cKDTree(vertices[members])
        for rows in np.split(members, range(_CHUNK, len(members), _CHUNK)):
            near = members[tree.query(vertices[rows], k=NEIGHBOURS)[1]]
            offsets = vertices[near] - vertices[rows, None]
            fit.normals[rows], fit.bends[rows], fit.misfit[rows] = _cubic(offsets, fit.normals[rows])
    return fit


def facet_average(vertices: Float[np.ndarray, "k 3"], triangles: Int[np.ndarray, "t 3"]) -> Float[np.ndarray, "k 3"]:
    """Mean of the facet normals around each vertex by Max's weights, exact where all vertices lie on a sphere.

    N. Max, "Weights for computing vertex normals from facet normals", J. Graphics Tools 4 (1999).
    """
    corners = vertices[triangles]
    total = np.zeros_like(vertices)
    for corner in range(3):
        left = corners[:, (corner + 1) % 3] - corners[:, corner]
        right = corners[:, (corner + 2) % 3] - corners[:, corner]
        lengths = np.sum(left * left, axis=1) * np.sum(right * right, axis=1)
        weighted = np.cross(left, right) / np.maximum(lengths, np.finfo(float).tiny)[:, None]
        np.add.at(total, triangles[:, corner], weighted)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(float).tiny)


def _cubic(
    offsets: Float[np.ndarray, "n m 3"], normals: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"], Float[np.ndarray, " n"]]:
    """Least-squares cubic through each vertex, as a height over the plane across ``normals``."""
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frame = np.stack([first, np.cross(normals, first), normals], axis=2)
    scale = np.sqrt(np.mean(np.sum(offsets * offsets, axis=2), axis=1))
    x, y, height = np.moveaxis(offsets @ frame / scale[:, None, None], 2, 0)
    terms = np.stack([x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], axis=2)
    moments = np.swapaxes(terms, 1, 2)
    coefficients = np.linalg.solve(moments @ terms + _RIDGE, moments @ height[..., None])[..., 0]
    misses = height - (terms @ coefficients[..., None])[..., 0]

    slopes, (xx, xy, yy) = coefficients[:, :2], coefficients[:, 2:5].T
    tilted = normals - (frame[:, :, :2] @ slopes[..., None])[..., 0]
    curvature = np.stack([np.stack([2.0 * xx, xy], 1), np.stack([xy, 2.0 * yy], 1)], 1) / scale[:, None, None]
    bends = -frame[:, :, :2] @ curvature @ np.swapaxes(frame[:, :, :2], 1, 2)
    unit = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    return unit, bends, scale * np.sqrt(np.mean(misses * misses, axis=1))
