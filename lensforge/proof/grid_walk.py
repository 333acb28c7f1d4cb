"""Triangles by the cells of a grid, and the walk of rays through it, to the first triangle that each one hits.

From cell to cell by Amanatides and Woo (1987). Compiled, and of nothing that the design stage computes with: the
compiler is all that they share.
"""

from math import floor, inf
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.compiled import inline, kernel

INSIDE = -1e-9  # barycentric coordinates down to this are inside, so that no ray slips between two triangles
PARALLEL = 1e-5  # cosine between a ray and a normal up to which trimesh takes them to miss each other
_LEAST = 1e-12  # component of a direction, for the walk only: it keeps the ray inside the cells' margin


class FacetMesh(NamedTuple):
    """Triangles of a mesh (mm), with their unit normals."""

    triangles: Float[np.ndarray, "t 3 3"]
    normals: Float[np.ndarray, "t 3"]


class CellGrid(NamedTuple):
    """Cubes of edge ``cell`` (mm) from ``corner``, numbered with the last axis of ``shape`` fastest."""

    corner: Float[np.ndarray, "3"]
    cell: float
    shape: Int[np.ndarray, "3"]


class FacetBoxes(NamedTuple):
    """Boxes of triangles: the ``first`` cells, how many these ``span``, and how far planes ``reach``.

    ``reach``: largest distance (mm) of a triangle's plane from the centre of a cell that it crosses.
    """

    first: Int[np.ndarray, "t 3"]
    span: Int[np.ndarray, "t 3"]
    reach: Float[np.ndarray, " t"]


@inline
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def _difference(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def _distance(origin, direction, triangle, normal):
    """Distance to a triangle, infinite if the ray misses it; the tests are those of trimesh."""
    cosine = _dot(direction, normal)
    if abs(cosine) <= PARALLEL:
        return inf
    distance = _dot(_difference(triangle[0], origin), normal) / cosine
    away = _difference(origin, triangle[0])
    point = away[0] + distance * direction[0], away[1] + distance * direction[1], away[2] + distance * direction[2]
    first_edge = _difference(triangle[1], triangle[0])
    second_edge = _difference(triangle[2], triangle[0])
    aa = _dot(first_edge, first_edge)
    ab = _dot(first_edge, second_edge)
    bb = _dot(second_edge, second_edge)
    a = _dot(first_edge, point)
    b = _dot(second_edge, point)
    area = aa * bb - ab * ab
    second = (bb * a - ab * b) / area
    third = (aa * b - ab * a) / area
    return distance if min(second, third, 1.0 - second - third) >= INSIDE else inf


@inline
def _within(origin, slope, corner, width):
    """Distances at which a ray enters and leaves the grid, by one component."""
    at_low = (corner - origin) / slope
    at_high = (corner + width - origin) / slope
    return min(at_low, at_high), max(at_low, at_high)


@inline
def _slope(component):
    return component if abs(component) >= _LEAST else _LEAST  # so flat that its sign does not count


@inline
def _first_cell(place, cell, count):
    return min(max(floor(place / cell), 0), count - 1)


@inline
def _crossing(number, slope, origin, corner, cell):
    return (corner + (number + (1 if slope > 0.0 else 0)) * cell - origin) / slope


@kernel
def sort_into_cells(facets, boxes, grid, places, members):
    """List in ``members`` the facets whose planes cross the cells of their boxes, from each cell's ``places`` (c) on.

    Places advance past the last entry; with empty ``members`` only they do, which counts the facets.
    """
    first = boxes.first
    span = boxes.span
    corner = grid.corner
    cell = grid.cell
    shape = grid.shape
    for t in range(len(facets.triangles)):
        vertex = facets.triangles[t, 0]
        normal = facets.normals[t]
        for i in range(first[t, 0], first[t, 0] + span[t, 0]):
            x = (corner[0] + (i + 0.5) * cell - vertex[0]) * normal[0]
            for j in range(first[t, 1], first[t, 1] + span[t, 1]):
                y = (corner[1] + (j + 0.5) * cell - vertex[1]) * normal[1]
                for k in range(first[t, 2], first[t, 2] + span[t, 2]):
                    z = (corner[2] + (k + 0.5) * cell - vertex[2]) * normal[2]
                    if abs(x + y + z) <= boxes.reach[t]:
                        number = (i * shape[1] + j) * shape[2] + k
                        if len(members):
                            members[places[number]] = t
                        places[number] += 1


@kernel
def walk(rays, facets, grid, starts, members, found, distances):
    """Fill ``found`` (n) with the facet that each of ``rays`` (``Leg``) hits first, -1 for none, and ``distances`` (n).

    The facets of the cell ``c`` of the ``grid`` are ``members[starts[c]:starts[c + 1]]``.
    """
    corner = grid.corner
    cell = grid.cell
    shape = grid.shape
    for ray in range(len(found)):
        found[ray] = -1
        distances[ray] = inf
        origin = rays.origins[ray]
        direction = rays.directions[ray]
        beyond = rays.beyond[ray]
        dx, dy, dz = _slope(direction[0]), _slope(direction[1]), _slope(direction[2])
        x_in, x_out = _within(origin[0], dx, corner[0], shape[0] * cell)
        y_in, y_out = _within(origin[1], dy, corner[1], shape[1] * cell)
        z_in, z_out = _within(origin[2], dz, corner[2], shape[2] * cell)
        entry = max(x_in, y_in, z_in, beyond)
        if not entry < min(x_out, y_out, z_out):
            continue
        i = _first_cell(origin[0] + entry * dx - corner[0], cell, shape[0])
        j = _first_cell(origin[1] + entry * dy - corner[1], cell, shape[1])
        k = _first_cell(origin[2] + entry * dz - corner[2], cell, shape[2])
        x, y, z = (
            _crossing(i, dx, origin[0], corner[0], cell),
            _crossing(j, dy, origin[1], corner[1], cell),
            _crossing(k, dz, origin[2], corner[2], cell),
        )
        while 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]:
            number = (i * shape[1] + j) * shape[2] + k
            nearest = inf
            candidate = -1
            for place in range(starts[number], starts[number + 1]):
                facet = members[place]
                distance = _distance(origin, direction, facets.triangles[facet], facets.normals[facet])
                if beyond < distance <= nearest and distance < inf:
                    nearest = distance
                    candidate = facet
            if nearest < distances[ray]:
                distances[ray] = nearest
                found[ray] = candidate
            if distances[ray] <= min(x, y, z):
                break
            if x <= y and x <= z:
                i = i + (1 if dx > 0.0 else -1)
                x = x + cell / abs(dx)
            elif y <= z:
                j = j + (1 if dy > 0.0 else -1)
                y = y + cell / abs(dy)
            else:
                k = k + (1 if dz > 0.0 else -1)
                z = z + cell / abs(dz)
