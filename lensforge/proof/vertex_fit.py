"""A polynomial around each vertex of a mesh, by weighted least squares: its normal, and the shape around it.

Compiled, with many vertices side by side. As the walk of rays it is of nothing that the design stage computes with.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.compiled import kernel

# Degree of the polynomial fitted around a vertex. It limits what the verification can see: on the smallest shipped
# lenses the normals of a cubic are wrong by 130 urad rms at the vertices, which lands rays 0.027 mm off at 150 mm,
# nearly twice what the criterion allows; those of a quintic land them 0.003 mm off on the same mesh, as do exact ones.
_DEGREE = 5
LANES = 64  # vertices side by side, in vector instructions: 8 take twice as long, more leave the cache
_POWERS = [(degree - k, k) for degree in range(1, _DEGREE + 1) for k in range(degree + 1)]
_TERMS = len(_POWERS)
_SUMS = 2 * _DEGREE + 1
_OF_X, _OF_Y = (np.array(powers) for powers in zip(*_POWERS, strict=True))
# A term that the neighbours do not determine goes to the lower degree: the ridge grows with the degree. At a rim 48
# neighbours are five rows deep; with 1e-7 for the fifth degree the normals there are wrong by 1 mrad.
_RIDGE = np.array([(0.0, 1e-12, 1e-9, 1e-6, 1e-4, 1e-3)[i + j] for i, j in _POWERS])
_LEAST_WEIGHT = 1e-3  # of the farthest neighbour: near ones count more, which takes 0.64 of the error of the normals
_STEEPEST = 0.999  # height of the farthest neighbours over their distance: a dome's are at a tenth
# Numbers of the two vectors of a frame, and rows behind them.
_ACROSS = 6
_SIZE = 6
_FITS = 7


class FitSpace(NamedTuple):
    """Workspace of :func:`fit_polynomials`, for all lanes."""

    frames: Float[np.ndarray, "8 l"]
    places: Float[np.ndarray, "4 m l"]
    products: Float[np.ndarray, "2 l"]
    sums: Float[np.ndarray, "2 s s l"]
    moments: Float[np.ndarray, "t t l"]
    coefficients: Float[np.ndarray, "t l"]


def fit_space(neighbours: int) -> FitSpace:
    """Workspace for so many neighbours of a vertex."""
    sizes = (8,), (4, neighbours), (2,), (2, _SUMS, _SUMS), (_TERMS, _TERMS), (_TERMS,)
    return FitSpace(*(np.empty((*size, LANES)) for size in sizes))


@kernel
def fit_polynomials(vertices, rows, near, normals, shapes, space):
    """Improve ``normals`` (v, 3) at the vertices ``rows`` (n), and fill their ``shapes`` (v, 13), as in ``VertexFit``.

    By a least-squares polynomial through each, as a height over the plane across its normal. ``near`` (n, m): numbers
    of its neighbours, itself among them. A vertex without a normal keeps what it has, and so does one whose neighbours
    are a line or a heap: a mesh of the program's own has none, one that somebody has changed may. ``space``: of
    :func:`fit_space`.
    """
    frames = space.frames
    coefficients = space.coefficients
    for start in range(0, len(rows), LANES):
        count = min(LANES, len(rows) - start)
        for lane in range(LANES):
            vertex = start + min(lane, count - 1)
            _fill_lane(vertices, rows[vertex], near[vertex], normals[rows[vertex]], lane, frames, space.places)
        _add_up(space.places, space.products, space.sums)
        _solve(space.sums, space.moments, coefficients, frames)
        for lane in range(count):
            if frames[_FITS, lane] > 0.0:
                row = rows[start + lane]
                _shape(frames[:, lane], coefficients[:, lane], normals[row], shapes[row])


@kernel
def _fill_lane(vertices, row, near, normal, lane, frames, places):
    """Fill a lane: two vectors across the normal, the neighbours in this frame over their rms distance, and weights."""
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
    total = 0.0
    farthest = 0.0
    highest = 0.0
    vertex = vertices[row]
    for k in range(len(near)):
        neighbour = vertices[near[k]]
        x, y, z = neighbour[0] - vertex[0], neighbour[1] - vertex[1], neighbour[2] - vertex[2]
        squared = x * x + y * y + z * z
        height = x * nx + y * ny + z * nz
        total = total + squared
        farthest = max(farthest, squared)
        highest = max(highest, abs(height))
        places[0, k, lane] = x * fx + y * fy + z * fz
        places[1, k, lane] = x * gx + y * gy + z * gz
        places[2, k, lane] = height
    size = sqrt(total / len(near))
    for k in range(len(near)):
        for axis in range(3):
            places[axis, k, lane] /= size
        near_by = 1.0 - size * size / farthest * (
            places[0, k, lane] ** 2 + places[1, k, lane] ** 2 + places[2, k, lane] ** 2
        )
        places[3, k, lane] = max(near_by, _LEAST_WEIGHT) ** 2
    frames[_SIZE, lane] = size
    frames[_FITS, lane] = 1.0 if length > 0.0 and highest < _STEEPEST * sqrt(farthest) else 0.0


@kernel
def _add_up(places, products, sums):
    """Weighted sums over the neighbours of x^i y^j up to twice the degree, and of the height times those up to it.

    All moments of the monomials are among them: 66 sums for a matrix of 20 by 20.
    """
    sums[:] = 0.0
    of_x = products[0]
    product = products[1]
    for k in range(places.shape[1]):
        x = places[0, k]
        y = places[1, k]
        height = places[2, k]
        for lane in range(LANES):
            of_x[lane] = places[3, k, lane]
        for i in range(_SUMS):
            for lane in range(LANES):
                product[lane] = of_x[lane]
                of_x[lane] *= x[lane]
            for j in range(_SUMS - i):
                alone = sums[0, i, j]
                with_height = sums[1, i, j]
                if i + j <= _DEGREE:
                    for lane in range(LANES):
                        with_height[lane] += product[lane] * height[lane]
                for lane in range(LANES):
                    alone[lane] += product[lane]
                    product[lane] *= y[lane]


@kernel
def _solve(sums, moments, coefficients, frames):
    """Coefficients of the monomials by Cholesky factors of their moments; the diagonal stores its inverse."""
    for a in range(_TERMS):
        factors = moments[a]
        answer = coefficients[a]
        for b in range(a + 1):
            moment = sums[0, _OF_X[a] + _OF_X[b], _OF_Y[a] + _OF_Y[b]]
            for lane in range(LANES):
                factors[b, lane] = moment[lane] + (_RIDGE[a] if a == b else 0.0)
        for lane in range(LANES):
            answer[lane] = sums[1, _OF_X[a], _OF_Y[a], lane]
        for b in range(a + 1):
            factors_above = moments[b]
            for c in range(b):
                for lane in range(LANES):
                    factors[b, lane] -= factors[c, lane] * factors_above[c, lane]
            if b < a:
                for lane in range(LANES):
                    factors[b, lane] *= factors_above[b, lane]
                    answer[lane] -= factors[b, lane] * coefficients[b, lane]
        for lane in range(LANES):
            frames[_FITS, lane] = frames[_FITS, lane] if factors[a, lane] > 0.0 else 0.0  # the neighbours are a line
            factors[a, lane] = 1.0 / sqrt(factors[a, lane])
            answer[lane] *= factors[a, lane]
    for a in range(_TERMS - 1, -1, -1):
        for c in range(a + 1, _TERMS):
            for lane in range(LANES):
                coefficients[a, lane] -= moments[c, a, lane] * coefficients[c, lane]
        for lane in range(LANES):
            coefficients[a, lane] *= moments[a, a, lane]


@kernel
def _shape(frame, coefficients, normal, shape):
    """The normal, and the ``shape`` around it: two tangent vectors, second and third derivatives of the height."""
    by_x = coefficients[0]
    by_y = coefficients[1]
    size = frame[_SIZE]
    total = 0.0
    for i in range(3):
        normal[i] -= frame[i] * by_x + frame[3 + i] * by_y
        total += normal[i] * normal[i]
        shape[i] = frame[i]
        shape[3 + i] = frame[3 + i]
    for i in range(3):
        normal[i] /= sqrt(total)
    for term in range(2, 9):
        i = _OF_X[term]
        j = _OF_Y[term]
        factor = (6.0 if max(i, j) == 3 else 2.0 if max(i, j) == 2 else 1.0) / size ** (i + j - 1)
        shape[_ACROSS + term - 2] = factor * coefficients[term]
