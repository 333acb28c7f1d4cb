"""Compiled work on the mesh of a part: triangles by the cells of a grid, the walk of rays, a polynomial at each vertex.

Rays walk from cell to cell (Amanatides and Woo 1987), to the first triangle that each one hits. Of nothing that the
design stage computes with: the compiler is all that they share.
"""

from math import floor, inf, sqrt

import numpy as np

from lensforge.kernels.compiled import inline, kernel

INSIDE = -1e-9  # barycentric coordinates down to this are inside, so that no ray slips between two triangles
PARALLEL = 1e-5  # cosine between a ray and a normal up to which trimesh takes them to miss each other
_LEAST = 1e-12  # component of a direction, for the walk only: it keeps the ray inside the cells' margin


@inline
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def _difference(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def _distance(origin, direction, triangle, normal):
    """Distance to a triangle, infinite where the ray misses it; the tests are those of trimesh."""
    cosine = _dot(direction, normal)
    if abs(cosine) <= PARALLEL:
        return inf
    distance = _dot(_difference(triangle[0], origin), normal) / cosine
    away = _difference(origin, triangle[0])
    point = away[0] + distance * direction[0], away[1] + distance * direction[1], away[2] + distance * direction[2]
    one, other = _difference(triangle[1], triangle[0]), _difference(triangle[2], triangle[0])
    aa, ab, bb, a, b = _dot(one, one), _dot(one, other), _dot(other, other), _dot(one, point), _dot(other, point)
    area = aa * bb - ab * ab
    second, third = (bb * a - ab * b) / area, (aa * b - ab * a) / area
    return distance if min(second, third, 1.0 - second - third) >= INSIDE else inf


@inline
def _within(origin, slope, corner, width):
    """Distances at which a ray enters and leaves the grid, by one component."""
    one, other = (corner - origin) / slope, (corner + width - origin) / slope
    return min(one, other), max(one, other)


@inline
def _slope(component):
    return component if abs(component) >= _LEAST else _LEAST  # so flat that its sign does not count


@inline
def _first_cell(place, cell, count):
    return min(max(floor(place / cell), 0), count - 1)


@inline
def _crossing(number, slope, origin, corner, cell):
    """Distance at which a ray leaves its cell, by one component."""
    return (corner + (number + (1 if slope > 0.0 else 0)) * cell - origin) / slope


@kernel
def sort_into_cells(triangles, normals, first, span, reach, corner, cell, shape, places, members):
    """List in ``members`` the triangles whose planes cross the cells of their boxes, each from its ``places`` (c) on.

    The places of the cells move behind the last one; with no ``members`` they alone do, so that zeros become counts.
    The boxes (t, 3) begin at the cells ``first`` and are ``span`` cells wide; ``reach`` (t): largest distance of a
    plane from the centre of a cell that it crosses. Mesh and grid as for :func:`walk`.
    """
    for t in range(len(triangles)):
        vertex, normal = triangles[t, 0], normals[t]
        for i in range(first[t, 0], first[t, 0] + span[t, 0]):
            x = (corner[0] + (i + 0.5) * cell - vertex[0]) * normal[0]
            for j in range(first[t, 1], first[t, 1] + span[t, 1]):
                y = (corner[1] + (j + 0.5) * cell - vertex[1]) * normal[1]
                for k in range(first[t, 2], first[t, 2] + span[t, 2]):
                    z = (corner[2] + (k + 0.5) * cell - vertex[2]) * normal[2]
                    if abs(x + y + z) <= reach[t]:
                        number = (i * shape[1] + j) * shape[2] + k
                        if len(members):
                            members[places[number]] = t
                        places[number] += 1


@kernel
def walk(origins, directions, beyond, starts, members, triangles, normals, corner, cell, shape, found, distances):
    """Fill ``found`` (n) with the triangle that each ray hits first, -1 for none, and ``distances`` (n).

    Rays: ``origins`` and unit ``directions`` (n, 3), of which hits up to the distance ``beyond`` (n) do not count.
    Grid: cell ``i, j, k`` of ``shape`` begins at ``corner`` (3) plus so many times ``cell``; cells are numbered with
    ``k`` fastest, and the triangles of number ``c`` are ``members[starts[c]:starts[c + 1]]``. Mesh: ``triangles``
    (t, 3, 3) with ``normals`` (t, 3).
    """
    for ray in range(len(found)):
        found[ray], distances[ray] = -1, inf
        origin, direction = origins[ray], directions[ray]
        dx, dy, dz = _slope(direction[0]), _slope(direction[1]), _slope(direction[2])
        x_in, x_out = _within(origin[0], dx, corner[0], shape[0] * cell)
        y_in, y_out = _within(origin[1], dy, corner[1], shape[1] * cell)
        z_in, z_out = _within(origin[2], dz, corner[2], shape[2] * cell)
        entry = max(x_in, y_in, z_in, beyond[ray])
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
            nearest, candidate = inf, -1
            for place in range(starts[number], starts[number + 1]):
                triangle = members[place]
                distance = _distance(origin, direction, triangles[triangle], normals[triangle])
                if beyond[ray] < distance <= nearest and distance < inf:
                    nearest, candidate = distance, triangle
            if nearest < distances[ray]:
                distances[ray], found[ray] = nearest, candidate
            if distances[ray] <= min(x, y, z):
                break
            if x <= y and x <= z:
                i, x = i + (1 if dx > 0.0 else -1), x + cell / abs(dx)
            elif y <= z:
                j, y = j + (1 if dy > 0.0 else -1), y + cell / abs(dy)
            else:
                k, z = k + (1 if dz > 0.0 else -1), z + cell / abs(dz)


# Degree of the polynomial fitted around a vertex. It limits what the verification can see: on the smallest shipped
# lenses the normals of a cubic are wrong by 130 urad rms at the vertices, which lands rays 0.027 mm off at 150 mm,
# nearly twice what the criterion allows; those of a quintic land them 0.003 mm off on the same mesh, as do exact ones.
_DEGREE = 5
LANES = 64  # vertices side by side, in vector instructions: 8 take twice as long, more leave the cache
_POWERS = [(degree - k, k) for degree in range(1, _DEGREE + 1) for k in range(degree + 1)]
_TERMS, _SUMS = len(_POWERS), 2 * _DEGREE + 1
_OF_X, _OF_Y = (np.array(powers) for powers in zip(*_POWERS, strict=True))
# A term that the neighbours do not determine goes to the lower degree: the ridge grows with the degree. At a rim 48
# neighbours are five rows deep; with 1e-7 for the fifth degree the normals there are wrong by 1 mrad.
_RIDGE = np.array([(0.0, 1e-12, 1e-9, 1e-6, 1e-4, 1e-3)[i + j] for i, j in _POWERS])
_STEEPEST = 0.999  # height of the farthest neighbours over their distance: a dome's are at a tenth
_SIZE, _FITS = 6, 7  # rows of a frame, behind its two vectors


def fit_space(neighbours):
    """Workspace of :func:`fit_polynomials`: frames, places, products, sums, moments and coefficients of all lanes."""
    sizes = (8,), (3, neighbours), (2,), (2, _SUMS, _SUMS), (_TERMS, _TERMS), (_TERMS,)
    return [np.empty((*size, LANES)) for size in sizes]


@kernel
def fit_polynomials(vertices, rows, near, normals, bends, frames, places, products, sums, moments, coefficients):
    """Improve ``normals`` (v, 3) at the vertices ``rows`` (n), and fill their ``bends`` (v, 3, 3), as of ``VertexFit``.

    By a least-squares polynomial through each, as a height over the plane across its normal. ``near`` (n, m): numbers
    of its neighbours, itself among them. A vertex without a normal keeps what it has, and so does one whose neighbours
    are a line or a heap: a mesh of the program's own has none, one that somebody has changed may.
    """
    for start in range(0, len(rows), LANES):
        count = min(LANES, len(rows) - start)
        for lane in range(LANES):
            own = start + min(lane, count - 1)
            _place(vertices, rows[own], near[own], normals[rows[own]], lane, frames, places)
        _add_up(places, products, sums)
        _solve(sums, moments, coefficients, frames)
        for lane in range(count):
            if frames[_FITS, lane] > 0.0:
                _bend(frames[:, lane], coefficients[:, lane], normals[rows[start + lane]], bends[rows[start + lane]])


@kernel
def _place(vertices, row, near, normal, lane, frames, places):
    """Fill a lane: two vectors across the normal, and the neighbours in this frame over their rms distance."""
    nx, ny, nz = normal[0], normal[1], normal[2]
    if abs(nx) <= min(abs(ny), abs(nz)):
        fx, fy, fz = 0.0, nz, -ny
    elif abs(ny) <= abs(nz):
        fx, fy, fz = -nz, 0.0, nx
    else:
        fx, fy, fz = ny, -nx, 0.0
    length = sqrt(fx * fx + fy * fy + fz * fz)
    fx, fy, fz = fx / length, fy / length, fz / length
    gx, gy, gz = ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx
    for number, component in enumerate((fx, fy, fz, gx, gy, gz)):
        frames[number, lane] = component
    total, farthest, highest = 0.0, 0.0, 0.0
    for k in range(len(near)):
        x, y, z = _difference(vertices[near[k]], vertices[row])
        squared, height = x * x + y * y + z * z, x * nx + y * ny + z * nz
        total, farthest, highest = total + squared, max(farthest, squared), max(highest, abs(height))
        places[0, k, lane], places[1, k, lane] = x * fx + y * fy + z * fz, x * gx + y * gy + z * gz
        places[2, k, lane] = height
    size = sqrt(total / len(near))
    for k in range(len(near)):
        for axis in range(3):
            places[axis, k, lane] /= size
    frames[_SIZE, lane] = size
    frames[_FITS, lane] = 1.0 if length > 0.0 and highest < _STEEPEST * sqrt(farthest) else 0.0


@kernel
def _add_up(places, products, sums):
    """Sums over the neighbours of the products x^i y^j up to twice the degree, and of those up to it with the height.

    All moments of the monomials are among them: 66 sums for a matrix of 20 by 20.
    """
    sums[:] = 0.0
    of_x, product = products[0], products[1]
    for k in range(places.shape[1]):
        x, y, height = places[0, k], places[1, k], places[2, k]
        of_x[:] = 1.0
        for i in range(_SUMS):
            for lane in range(LANES):
                product[lane] = of_x[lane]
                of_x[lane] *= x[lane]
            for j in range(_SUMS - i):
                alone, with_height = sums[0, i, j], sums[1, i, j]
                if i + j <= _DEGREE:
                    for lane in range(LANES):
                        with_height[lane] += product[lane] * height[lane]
                for lane in range(LANES):
                    alone[lane] += product[lane]
                    product[lane] *= y[lane]


@kernel
def _solve(sums, moments, coefficients, frames):
    """Coefficients of the monomials by Cholesky's factors of their moments, whose diagonal holds its inverse."""
    for a in range(_TERMS):
        own, answer = moments[a], coefficients[a]
        for b in range(a + 1):
            moment = sums[0, _OF_X[a] + _OF_X[b], _OF_Y[a] + _OF_Y[b]]
            for lane in range(LANES):
                own[b, lane] = moment[lane] + (_RIDGE[a] if a == b else 0.0)
        for lane in range(LANES):
            answer[lane] = sums[1, _OF_X[a], _OF_Y[a], lane]
        for b in range(a + 1):
            other = moments[b]
            for c in range(b):
                for lane in range(LANES):
                    own[b, lane] -= own[c, lane] * other[c, lane]
            if b < a:
                for lane in range(LANES):
                    own[b, lane] *= other[b, lane]
                    answer[lane] -= own[b, lane] * coefficients[b, lane]
        for lane in range(LANES):
            frames[_FITS, lane] = frames[_FITS, lane] if own[a, lane] > 0.0 else 0.0  # the neighbours are a line
            own[a, lane] = 1.0 / sqrt(own[a, lane])
            answer[lane] *= own[a, lane]
    for a in range(_TERMS - 1, -1, -1):
        for c in range(a + 1, _TERMS):
            for lane in range(LANES):
                coefficients[a, lane] -= moments[c, a, lane] * coefficients[c, lane]
        for lane in range(LANES):
            coefficients[a, lane] *= moments[a, a, lane]


@kernel
def _bend(frame, coefficients, normal, bends):
    """The normal and its change with the place, by the slopes and the curvature of a polynomial."""
    by_x, by_y, size = coefficients[0], coefficients[1], frame[_SIZE]
    xx, xy, yy = 2.0 * coefficients[2] / size, coefficients[3] / size, 2.0 * coefficients[4] / size
    total = 0.0
    for i in range(3):
        along, across = frame[i], frame[3 + i]
        normal[i] -= along * by_x + across * by_y
        total += normal[i] * normal[i]
        for j in range(3):
            bends[i, j] = -(along * (xx * frame[j] + xy * frame[3 + j]) + across * (xy * frame[j] + yy * frame[3 + j]))
    for i in range(3):
        normal[i] /= sqrt(total)
