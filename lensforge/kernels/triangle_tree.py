"""Rays among triangles, by a tree of boxes: the first triangle that each meets.

A node of the tree has eight children, about whose boxes a ray asks at once (``lanes``). Child k of node i of a level is
node 8 i + k of the next; the last level are leaves, of eight triangles at most. A walk keeps eight bits for each level,
of the children that it still has to visit there, and so needs no stack. Children are numbered by three halvings of
their node, across an axis each: a ray takes those first that lie before the others along its way.

A ray meets a triangle by Moeller and Trumbore, J. Graphics Tools 2, 21 (1997), from either side.
"""

from math import inf
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.lanes import LANES, bits_of_lanes, lowest_bit
from lensforge.kernels.vectors import cross, difference, dot

_HALVINGS = 3  # of a node
_INSIDE = -1e-9  # barycentric coordinates down to this are inside: no ray slips between two triangles
_FLAT = 1e-24  # square of a sine: a triangle without area, or one that is seen edge on
_ALL = np.arange(LANES)
_ROWS = tuple(range(10))  # of the triangles of a leaf
AS_MET = np.array(  # by the bits of the halvings against which a ray goes: bits of its children, in its order
    [[(((bits >> (_ALL ^ against)) & 1) << _ALL).sum() for bits in range(2**LANES)] for against in range(LANES)]
)


class TriangleTree(NamedTuple):
    """Triangles (mm), or edges, in the order of the leaves, the ``numbers`` that they had, and the tree over them.

    Leaf k holds those from ``starts[k]`` to ``starts[k + 1]``. ``levels``: the first node of each level above.
    ``boxes``: low x, y, z and high x, y, z of the children of each node. ``against``: of each node, by the bits of a
    ray's negative components, the bits of the halvings against which it goes. ``triangles``: of each leaf a corner, the
    edges from there to the other two, and the least squared volume that these span with a ray; none of edges.
    """

    corners: Float[np.ndarray, "t k 3"]
    numbers: Int[np.ndarray, " t"]
    starts: Int[np.ndarray, " s"]
    levels: Int[np.ndarray, " l"]
    boxes: Float[np.ndarray, "b 6 8"]
    against: Int[np.ndarray, "b 8"]
    triangles: Float[np.ndarray, "c 10 8"]


def tree_of(corners: Float[np.ndarray, "t k 3"]) -> TriangleTree:
    """The tree over at least one triangle or edge.

    Each node is halved by number, across the axis along which its parts are longest on average.
    """
    halvings = max(0, int(np.ceil(np.log2(len(corners) / LANES))))
    depth = max(1, -(-halvings // _HALVINGS))
    order = np.arange(len(corners))
    against = []
    parts = 1
    for level in range(depth):
        nodes = parts
        bits = np.zeros((nodes, LANES), dtype=np.int8)
        for _ in range(_HALVINGS if level else halvings - _HALVINGS * (depth - 1)):
            order, axes = _halved(corners, order, nodes, parts)
            bits = 2 * bits + ((_ALL >> axes[:, None]) & 1).astype(np.int8)
            parts *= 2
        against.append(bits)
    starts = len(order) * np.arange(parts + 1) // parts
    ordered = np.ascontiguousarray(corners[order])
    levels = np.cumsum([0, *map(len, against[:-1])])
    boxes = _boxes_over(ordered, starts[:-1])
    triangles = _in_lanes(ordered, starts) if corners.shape[1] == 3 else np.empty((0, 10, LANES))
    return TriangleTree(ordered, order, starts, levels, _aligned(boxes), np.concatenate(against), _aligned(triangles))


def _aligned(table: Float[np.ndarray, "n k 8"]) -> Float[np.ndarray, "n k 8"]:
    """``table`` with each of its vectors in one line of the cache."""
    memory = np.empty(table.size + LANES)
    first = -memory.ctypes.data // memory.itemsize % LANES
    aligned = memory[first : first + table.size].reshape(table.shape)
    aligned[:] = table
    return aligned


def _halved(
    corners: Float[np.ndarray, "t k 3"], order: Int[np.ndarray, " t"], nodes: int, parts: int
) -> tuple[Int[np.ndarray, " t"], Int[np.ndarray, " n"]]:
    """The ``order`` in which each of the parts of ``nodes`` is halved, and the axes across which they are."""
    count = len(order)
    edges = count * np.arange(parts + 1) // parts
    sizes = np.diff(edges)
    centres = corners.mean(axis=1)[order]
    spans = np.maximum.reduceat(centres, edges[:-1]) - np.minimum.reduceat(centres, edges[:-1])
    axes = spans.reshape(nodes, -1, 3).mean(axis=1).argmax(axis=1)
    along = np.repeat(np.repeat(axes, parts // nodes), sizes)
    part = np.repeat(np.arange(parts), sizes)
    return order[np.lexsort((centres[np.arange(count), along], part))], axes


def _boxes_over(ordered: Float[np.ndarray, "t k 3"], starts: Int[np.ndarray, " s"]) -> Float[np.ndarray, "b 6 8"]:
    """Boxes of the children of all nodes, level by level."""
    low = np.minimum.reduceat(ordered.min(axis=1), starts)
    high = np.maximum.reduceat(ordered.max(axis=1), starts)
    levels: list[Float[np.ndarray, "n 6 8"]] = []
    while len(low) > 1 or not levels:
        none = ((0, -len(low) % LANES), (0, 0))  # of a root of fewer children
        low = np.pad(low, none, constant_values=inf).reshape(-1, LANES, 3)
        high = np.pad(high, none, constant_values=-inf).reshape(-1, LANES, 3)
        levels.insert(0, np.moveaxis(np.concatenate([low, high], axis=2), 1, 2))
        low = low.min(axis=1)
        high = high.max(axis=1)
    return np.ascontiguousarray(np.concatenate(levels))


def _in_lanes(ordered: Float[np.ndarray, "t 3 3"], starts: Int[np.ndarray, " s"]) -> Float[np.ndarray, "c 10 8"]:
    """The ``triangles`` of a :class:`TriangleTree`; lanes of a leaf without a triangle have one without area."""
    leaf = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    corner, first, second = np.moveaxis(ordered, 1, 0)
    first = first - corner
    second = second - corner
    flat = _FLAT * (first**2).sum(axis=1) * (second**2).sum(axis=1)
    lanes = np.zeros((len(starts) - 1, 10, LANES))
    lanes[leaf, :, np.arange(len(leaf)) - starts[leaf]] = np.column_stack([corner, first, second, flat])
    return lanes


@bits_of_lanes
def _entered(planes, ray):
    """Boxes that a ray meets before a distance; ``planes``: near x, y, z and far x, y, z."""
    px, py, pz, per_x, per_y, per_z, nearest = ray
    near = ((planes[0] - px) * per_x).or_more((planes[1] - py) * per_y).or_more((planes[2] - pz) * per_z)
    far = ((planes[3] - px) * per_x).or_less((planes[4] - py) * per_y).or_less((planes[5] - pz) * per_z)
    return near.or_more(0.0) <= far.or_less(nearest)


@bits_of_lanes
def _met(triangle, ray):
    """Triangles that a ray meets before a distance, to within rounding.

    Barycentric coordinates and distance are left times the square of the volume that ray and triangle span: no lane
    divides.
    """
    corner = triangle[:3]
    first = triangle[3:6]
    second = triangle[6:9]
    point = ray[:3]
    direction = ray[3:6]
    nearest = ray[6]
    across = cross.py_func(direction, second)
    volume = dot.py_func(first, across)
    square = volume * volume
    away = difference.py_func(point, corner)
    aside = cross.py_func(away, first)
    u = dot.py_func(away, across) * volume
    v = dot.py_func(direction, aside) * volume
    least = square * _INSIDE
    distance = dot.py_func(second, aside) * volume
    inside = (u >= least) & (v >= least) & (square - u - v >= least)
    return inside & (distance > 0.0) & (distance < nearest * square) & (square > triangle[9])


@inline
def negative_bits(direction):
    """Bits of the negative components of a direction."""
    return (1 if direction[0] < 0.0 else 0) | (2 if direction[1] < 0.0 else 0) | (4 if direction[2] < 0.0 else 0)


@inline
def planes(signs):
    """Rows of a node's boxes: the near x, y, z, and the far ones, of a ray with these bits of negative components."""
    x, y, z = 3 * (signs & 1), 3 * ((signs >> 1) & 1), 3 * ((signs >> 2) & 1)
    return x, 1 + y, 2 + z, 3 - x, 4 - y, 5 - z


@inline
def following(level, index, waiting, against):
    """The next node of a walk, and the bits that then wait: its level, and its number there."""
    place = lowest_bit(waiting)
    up = place // LANES
    waiting = (waiting & (waiting - 1)) >> (LANES * up)
    against = against >> (LANES * up)
    child = (place % LANES) ^ (against % LANES)
    return level - up + 1, (index >> (_HALVINGS * up)) * LANES + child, waiting, against


@inline
def reciprocal(component):
    """1 / x, and a large number for 0."""
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


@inline
def _first_of_leaf(point, direction, tree, leaf, nearest, number):
    """Distance to the first triangle of a leaf before ``nearest``, and its number; else those given."""
    met = _met(tree.triangles, leaf, _ROWS, (*point, *direction, nearest))
    while met != 0:
        k = tree.starts[leaf] + lowest_bit(met)
        met &= met - 1
        distance = _distance(point, direction, tree.corners[k])
        if distance < nearest:
            nearest = distance
            number = tree.numbers[k]
    return nearest, number


@inline
def _any_of_leaves(point, direction, tree, leaf, bits, reach):
    """Number of a triangle that a ray meets in leaves, whose bits from number ``leaf`` on are given; -1 for none."""
    while bits != 0:
        k = leaf + lowest_bit(bits)
        bits &= bits - 1
        met = _met(tree.triangles, k, _ROWS, (*point, *direction, reach))
        if met != 0:
            return tree.numbers[tree.starts[k] + lowest_bit(met)]
    return -1


@kernel
def first_hits(points, directions, reaches, tree, distances, numbers):
    """Fill the ``distances`` (mm) to the first triangle of each ray before its end, and its number, -1 for none.

    ``reaches``: distances (mm) at which rays end, which then stand where they meet none; from 0 down they meet none.
    """
    leaves = len(tree.levels)
    for ray in range(len(points)):
        point = points[ray, 0], points[ray, 1], points[ray, 2]
        direction = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        per = reciprocal(direction[0]), reciprocal(direction[1]), reciprocal(direction[2])
        signs = negative_bits(direction)
        nearest = reaches[ray]
        number = -1
        level = 0
        index = 0
        waiting = 0
        against = 0
        going = nearest > 0.0
        while going:
            bits = 0
            turned = 0
            if level == leaves:
                nearest, number = _first_of_leaf(point, direction, tree, index, nearest, number)
            else:
                node = tree.levels[level] + index
                turned = tree.against[node, signs]
                bits = AS_MET[turned, _entered(tree.boxes, node, planes(signs), (*point, *per, nearest))]
            waiting = waiting << LANES | bits
            against = against << LANES | turned
            going = waiting != 0
            if going:
                level, index, waiting, against = following(level, index, waiting, against)
        distances[ray] = nearest
        numbers[ray] = number


@kernel
def any_hits(points, directions, reaches, tree, numbers):
    """Fill the ``numbers`` of any triangle that each ray meets before its end, as :func:`first_hits`; -1 for none."""
    last = len(tree.levels) - 1
    for ray in range(len(points)):
        point = points[ray, 0], points[ray, 1], points[ray, 2]
        direction = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        per = reciprocal(direction[0]), reciprocal(direction[1]), reciprocal(direction[2])
        signs = negative_bits(direction)
        number = -1
        level = 0
        index = 0
        waiting = 0
        going = reaches[ray] > 0.0
        while going:
            node = tree.levels[level] + index
            bits = _entered(tree.boxes, node, planes(signs), (*point, *per, reaches[ray]))
            if level == last:
                number = _any_of_leaves(point, direction, tree, LANES * index, bits, reaches[ray])
                bits = 0
            waiting = waiting << LANES | bits
            going = waiting != 0 and number < 0
            if going:
                level, index, waiting, _ = following(level, index, waiting, 0)
        numbers[ray] = number
