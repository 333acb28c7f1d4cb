"""Rays among triangles, by a tree of boxes: the first triangle that each meets, and the rim that it passes nearest.

The tree is binary and whole: node k has the children 2 k + 1 and 2 k + 2, so that a walk needs no stack. A ray meets a
triangle by Moeller and Trumbore, J. Graphics Tools 2, 21 (1997), from either side.
"""

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.vectors import add_scaled, cross, difference, dot, length_of, scaled

_IN_LEAF = 4  # triangles at most
_INSIDE = -1e-9  # barycentric coordinates down to this are inside: no ray slips between two triangles
_FLAT = 1e-24  # square of a sine: a triangle without area, or one that is seen edge on
_AHEAD_MM = 1e-6  # beyond the start of a ray, where rims begin to count


class TriangleTree(NamedTuple):
    """Triangles (mm), or edges, in the order of the leaves, the ``numbers`` that they had, and the tree over them.

    ``boxes``: low and high corner of each node, the root first. Leaf k holds the triangles from ``starts[k]`` to
    ``starts[k + 1]``.
    """

    corners: Float[np.ndarray, "t k 3"]
    numbers: Int[np.ndarray, " t"]
    boxes: Float[np.ndarray, "b 2 3"]
    starts: Int[np.ndarray, " s"]


def tree_of(corners: Float[np.ndarray, "t k 3"]) -> TriangleTree:
    """The tree over at least one triangle or edge.

    Each node is halved by number, across the longest side of its centres.
    """
    count = len(corners)
    depth = max(0, int(np.ceil(np.log2(count / _IN_LEAF))))
    centres = corners.mean(axis=1)
    order = np.arange(count)
    for level in range(depth):
        edges = count * np.arange(2**level + 1) // 2**level
        sizes = np.diff(edges)
        ordered = centres[order]
        spans = np.maximum.reduceat(ordered, edges[:-1]) - np.minimum.reduceat(ordered, edges[:-1])
        along = np.repeat(spans.argmax(axis=1), sizes)
        order = order[np.lexsort((ordered[np.arange(count), along], np.repeat(np.arange(len(sizes)), sizes)))]
    starts = count * np.arange(2**depth + 1) // 2**depth
    ordered = corners[order]
    boxes = np.empty((2 ** (depth + 1) - 1, 2, 3))
    boxes[2**depth - 1 :, 0] = np.minimum.reduceat(ordered.min(axis=1), starts[:-1])
    boxes[2**depth - 1 :, 1] = np.maximum.reduceat(ordered.max(axis=1), starts[:-1])
    for node in range(2**depth - 2, -1, -1):
        boxes[node, 0] = np.minimum(*boxes[2 * node + 1 : 2 * node + 3, 0])
        boxes[node, 1] = np.maximum(*boxes[2 * node + 1 : 2 * node + 3, 1])
    return TriangleTree(np.ascontiguousarray(ordered), order, boxes, starts)


@inline
def _following(node, leaves, entered):
    """The next node of a walk, depth first: the first child of an inner one that is ``entered``; -1 behind the last."""
    if entered and node < leaves - 1:
        return 2 * node + 1
    while node > 0 and node % 2 == 0:
        node = node // 2 - 1
    return -1 if node == 0 else node + 1


@inline
def _meets(box, point, inverse, nearest):
    """True if a ray meets a box before the distance ``nearest``."""
    near = 0.0
    far = nearest
    for axis in range(3):
        low = (box[0, axis] - point[axis]) * inverse[axis]
        high = (box[1, axis] - point[axis]) * inverse[axis]
        near = max(near, min(low, high))
        far = min(far, max(low, high))
    return near <= far


@inline
def _reciprocal(component):
    return 1.0 / component if component != 0.0 else 1e300


@inline
def _distance(point, direction, corners):
    """Distance along a ray to a triangle; infinite if the ray misses it, or has it behind."""
    first = difference(corners[1], corners[0])
    second = difference(corners[2], corners[0])
    across = cross(direction, second)
    determinant = dot(first, across)
    if determinant * determinant <= _FLAT * dot(first, first) * dot(second, second):
        return inf
    away = difference(point, corners[0])
    u = dot(away, across) / determinant
    aside = cross(away, first)
    v = dot(direction, aside) / determinant
    distance = dot(second, aside) / determinant
    return distance if min(u, v, 1.0 - u - v) >= _INSIDE and distance > 0.0 else inf


@kernel
def first_hits(points, directions, tree, distances, numbers):
    """Fill the ``distances`` (mm) to the first triangle of each ray, infinite for none, and its number, -1 for none."""
    leaves = len(tree.starts) - 1
    for ray in range(len(points)):
        point = points[ray]
        direction = directions[ray]
        inverse = _reciprocal(direction[0]), _reciprocal(direction[1]), _reciprocal(direction[2])
        nearest = inf
        number = -1
        node = 0
        while node >= 0:
            entered = _meets(tree.boxes[node], point, inverse, nearest)
            if entered and node >= leaves - 1:
                leaf = node - (leaves - 1)
                for k in range(tree.starts[leaf], tree.starts[leaf + 1]):
                    distance = _distance(point, direction, tree.corners[k])
                    if distance < nearest:
                        nearest = distance
                        number = tree.numbers[k]
            node = _following(node, leaves, entered)
        distances[ray] = nearest
        numbers[ray] = number


@inline
def _may_be_near(box, point, direction, inverse, most):
    """True unless a box lies wholly outside the cone of the tangent ``most`` around a line.

    The cone is at most as wide as where the ball about the box ends: the line then meets the box grown by that much.
    """
    x = 0.5 * (box[0, 0] + box[1, 0]) - point[0]
    y = 0.5 * (box[0, 1] + box[1, 1]) - point[1]
    z = 0.5 * (box[0, 2] + box[1, 2]) - point[2]
    radius = 0.5 * sqrt((box[1, 0] - box[0, 0]) ** 2 + (box[1, 1] - box[0, 1]) ** 2 + (box[1, 2] - box[0, 2]) ** 2)
    far = x * direction[0] + y * direction[1] + z * direction[2] + radius
    if far < 0.0:
        return False
    wide = most * far
    near = 0.0
    for axis in range(3):
        low = (box[0, axis] - wide - point[axis]) * inverse[axis]
        high = (box[1, axis] + wide - point[axis]) * inverse[axis]
        near = max(near, min(low, high))
        far = min(far, max(low, high))
    return near <= far


@inline
def _nearest_of_edge(start, end, direction, least_along, most_along):
    """Least tangent of the angle between a line and the places of an edge as its point sees them, and that place.

    ``start``, ``end``: from that point. Seen along the line, places at the depth z are at (x, y)/z.
    """
    z0 = dot(start, direction)
    z1 = dot(end, direction)
    none = inf, 0.0, 0.0, 0.0
    if max(z0, z1) <= least_along:
        return none
    if z0 < least_along or z1 < least_along:  # cut off what lies behind the start of the ray
        share = (least_along - z0) / (z1 - z0)
        cut = add_scaled(start, share, difference(end, start))
        if z0 < least_along:
            start, z0 = cut, least_along
        else:
            end, z1 = cut, least_along
    a = difference(scaled(1.0 / z0, start), direction)
    b = difference(scaled(1.0 / z1, end), direction)
    along = difference(b, a)
    square = dot(along, along)
    share = min(max(-dot(a, along) / square, 0.0), 1.0) if square > 0.0 else 0.0
    aside = add_scaled(a, share, along)
    depth = 1.0 / ((1.0 - share) / z0 + share / z1)
    if depth >= most_along:
        return none
    x, y, z = scaled(depth, add_scaled(aside, 1.0, direction))
    return length_of(aside), x, y, z


@kernel
def nearest_rims(points, directions, spans, most, tree, tangents, rims):
    """Fill the ``tangents`` of the angles between rays and the nearest edges that they pass, seen from ``points``.

    At most ``most``, which stands where no edge of the ``tree`` is so near; with the place (mm) there in ``rims``.
    ``spans``: the distances (mm) from the points at which each ray begins and ends; places beyond do not count.
    """
    leaves = len(tree.starts) - 1
    for ray in range(len(points)):
        point = points[ray]
        direction = directions[ray]
        inverse = _reciprocal(direction[0]), _reciprocal(direction[1]), _reciprocal(direction[2])
        least_along = max(spans[ray, 0], 0.0) + _AHEAD_MM
        nearest = most
        node = 0
        while node >= 0:
            entered = _may_be_near(tree.boxes[node], point, direction, inverse, nearest)
            if entered and node >= leaves - 1:
                leaf = node - (leaves - 1)
                for k in range(tree.starts[leaf], tree.starts[leaf + 1]):
                    start = difference(tree.corners[k, 0], point)
                    end = difference(tree.corners[k, 1], point)
                    tangent, x, y, z = _nearest_of_edge(start, end, direction, least_along, spans[ray, 1])
                    if tangent < nearest:
                        nearest = tangent
                        rims[ray, 0] = point[0] + x
                        rims[ray, 1] = point[1] + y
                        rims[ray, 2] = point[2] + z
            node = _following(node, leaves, entered)
        tangents[ray] = nearest
