"""The smooth surfaces for which the facets of meshes stand: their curvature, and where each ends.

The normal of facets jumps from one to the next, so that its slope is 0 everywhere. That of the surface is told by the
edges: in the middle of each, the normal is the mean of those of both facets, and linear in between.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from lensforge.optics.arrays import lengths

_SMOOTH_RAD = 0.3  # between neighbours of one smooth surface: above the 15 degrees of the coarsest cylinder
_TINY = np.finfo(float).tiny

_Corners = Float[np.ndarray, "t 3 3"]


class _Joints(NamedTuple):
    """Normals of triangles, the edge opposite each corner, the sum of the normals at edges, and which are smooth."""

    normals: Float[np.ndarray, "t 3"]
    edges: Int[np.ndarray, "t 3"]
    sums: Float[np.ndarray, "e 3"]
    smooth: Bool[np.ndarray, " e"]

    @staticmethod
    def of(corners: _Corners, vertices: Int[np.ndarray, "t 3"]) -> "_Joints":
        """The joints of triangles with numbered ``vertices``."""
        opposite = np.roll(vertices, -1, axis=1)
        ends = np.sort(np.stack([opposite, np.roll(opposite, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        _, edges, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        edges = edges.reshape(-1, 3)
        first, second, third = np.moveaxis(corners, 1, 0)
        areas = np.cross(second - first, third - first)
        normals = areas / np.maximum(lengths(areas), _TINY)[:, None]
        sums = np.zeros((len(count), 3))
        np.add.at(sums, edges, normals[:, None])
        smooth = (count == 2) & (lengths(sums) > 2.0 * np.cos(0.5 * _SMOOTH_RAD))
        return _Joints(normals, edges, sums, smooth)


def facet_curvatures(corners: _Corners) -> Float[np.ndarray, "t 3 3"]:
    """Change of the unit normal (column, 1/mm) by a step along each triangle; 0 for flat surroundings.

    ``corners``: of triangles (mm), of which equal ones have the same bits. Across an edge at which they meet at more
    than 0.3 rad, or that does not join two of them, a surface ends.
    """
    _, vertices = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    joints = _Joints.of(corners, vertices.reshape(-1, 3))
    normals = joints.normals[:, None]
    means = joints.sums / np.maximum(lengths(joints.sums), _TINY)[:, None]
    at_edges = np.where(joints.smooth[joints.edges][..., None], means[joints.edges], normals)
    sides = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    twice = lengths(np.cross(sides[:, 0], sides[:, 1]))
    slopes = -2.0 * np.cross(normals, sides) / np.maximum(twice, _TINY)[:, None, None]  # of 1 - 2 λ, 1 along an edge
    across = at_edges - (at_edges * normals).sum(axis=2, keepdims=True) * normals  # a unit vector turns
    return np.einsum("tki,tkj->tij", across, slopes)


def smooth_faces(
    corners: _Corners, edges: Float[np.ndarray, "e 2 3"]
) -> tuple[Int[np.ndarray, " t"], Int[np.ndarray, "e 2"]]:
    """Number of the smooth surface of each triangle, and of the two at each of some ``edges`` (mm) between them.

    Surfaces end as for :func:`facet_curvatures`.
    """
    places = np.concatenate([corners.reshape(-1, 3), edges.reshape(-1, 3)])
    _, numbers = np.unique(places, axis=0, return_inverse=True)
    vertices = numbers.ravel()[: 3 * len(corners)].reshape(-1, 3)
    joints = _Joints.of(corners, vertices)
    rows = np.flatnonzero(joints.smooth[joints.edges].ravel())
    order = rows[np.argsort(joints.edges.ravel()[rows], kind="stable")].reshape(-1, 2) // 3
    count = len(corners)
    links = sparse.coo_array((np.ones(len(order)), tuple(order.T)), shape=(count, count))
    _, faces = connected_components(links, directed=False)
    ends = np.sort(numbers.ravel()[3 * len(corners) :].reshape(-1, 2), axis=1)
    opposite = np.roll(vertices, -1, axis=1)
    sides = np.sort(np.stack([opposite, np.roll(opposite, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, keys = np.unique(np.concatenate([sides, ends]), axis=0, return_inverse=True)
    keys = keys.ravel()
    least = np.full(keys.max() + 1, count)
    most = np.full(keys.max() + 1, -1)
    np.minimum.at(least, keys[: len(sides)], np.repeat(faces, 3))
    np.maximum.at(most, keys[: len(sides)], np.repeat(faces, 3))
    return faces.astype(np.int64), np.stack([least, most], axis=1)[keys[len(sides) :]]
