"""Sum of spherical radial basis functions, alone or with its slope: each function only where it is not negligible.

The angle comes from the chord, ``|u - c|``: arccos of a dot product loses half of the digits near the centre. A
symmetric sum is the mean over the mirror images of each direction.

Directions are taken in blocks. A function that reaches none of a block is left out at once; the others are added to
all directions of it together, in vector instructions, in the same order whatever the block is. Neighbouring directions
should therefore follow one another.

The compiler makes no vector instructions of a loop that calls a library's arcsine or exponential. Both are series
here, to the last bits: ``g^2 = s + s^2/12 + s^3/90 + ...`` with the squared chord ``s = 4 sin(g/2)^2`` needs no root,
and its derivative is ``g / sin g``, which the slope takes. Beyond 90 degrees the series is taken at half of the angle.
"""

from fractions import Fraction
from math import comb, factorial, log, sqrt

import numpy as np

from lensforge.kernels.compiled import inline, kernel, polynomial

NEAR = 2  # squared chord up to which the series takes the angle itself


def _square_terms():
    """Power series of ``4 asin(sqrt(s)/2)^2 / s``, whose sixtieth term is 1e-20 at a squared chord of 2."""
    return [Fraction(2, n * n * comb(2 * n, n)) for n in range(1, 61)]


def _ratio_terms():
    return [n * term for n, term in enumerate(_square_terms(), start=1)]


def _economised(terms, count):
    """The first ``count`` coefficients of a power series, changed so that it holds to the last bits from 0 to NEAR.

    Each power left out is replaced by its Chebyshev polynomial's lower powers, from which it differs little on the
    interval (Lanczos, Applied Analysis, 1956, section VII.7). In fractions: no digit is lost.
    """
    left = list(terms)
    while len(left) > count:
        n = len(left) - 1
        chebyshev = [Fraction((-1) ** (n - k) * n * comb(n + k, 2 * k) * 4**k, (n + k) * NEAR**k) for k in range(n + 1)]
        share = left[n] / chebyshev[n]
        left = [term - share * lower for term, lower in zip(left[:n], chebyshev[:n], strict=True)]
    return left


_square_per_chord = polynomial(lambda: _economised(_square_terms(), 21))  # errs by less than 2e-17 of itself
angle_per_sine = polynomial(lambda: _economised(_ratio_terms(), 22))  # likewise
_exponential = polynomial(lambda: [1.0 / factorial(n) for n in range(14)])  # within half of log 2 of 0: to 4e-18
_SMALLEST = 700.0  # exponents beyond this would leave the normal numbers; a sum leaves functions out at 41
_WHOLE = 1.5 * 2.0**52  # added to a number, leaves its nearest whole number in the last bits
_PER_LOG_2 = 1.0 / log(2.0)
# Cody and Waite: whole numbers times the first are exact.
_LOG_2 = 6.93147180369123816490e-01
_REST_OF_LOG_2 = 1.90821492927058770002e-10
# IEEE 754 binary64.
_BIAS = 1023
_FRACTION_BITS = 52


@inline
def angle_squared(squared):
    """Square of the angle of a squared chord, at most NEAR."""
    return squared * _square_per_chord(squared)


@inline
def half_angle(squared):
    """Squared chord, at most 4, of half of the angle."""
    return 0.5 * squared / (1.0 + sqrt(1.0 - 0.25 * squared))


@inline
def decay(exponent):
    """``exp(-exponent)`` of a number of at least 0: of the fraction after whole powers of 2, which are set as bits."""
    limited = min(exponent, _SMALLEST)
    shifted = _WHOLE - limited * _PER_LOG_2
    whole = shifted - _WHOLE
    fraction = (-limited - whole * _LOG_2) - whole * _REST_OF_LOG_2
    bits = np.float64(shifted).view(np.int64)
    power = np.int64((bits + _BIAS) << _FRACTION_BITS).view(np.float64)
    return _exponential(fraction) * power


BLOCK = 32  # directions: some vectors, and a small part of the sphere
ROWS = 7  # of workspace for a block: turned directions, and their sums
_MARGIN = 1.0 + 1e-9  # a block is taken by its rounded mean, each direction of it by its own distance
_ANTIPODE = 1e-8  # cosine of half the angle below which a slope, which has no direction there, takes no ratio


@inline
def _turn(directions, image, x, y, z):
    """Fill ``x``, ``y``, ``z`` with directions (row vectors) times a 3 x 3 matrix; their mean, and the reach of it."""
    mx, my, mz = 0.0, 0.0, 0.0
    for k in range(len(directions)):
        u, v, w = directions[k, 0], directions[k, 1], directions[k, 2]
        x[k] = u * image[0, 0] + v * image[1, 0] + w * image[2, 0]
        y[k] = u * image[0, 1] + v * image[1, 1] + w * image[2, 1]
        z[k] = u * image[0, 2] + v * image[1, 2] + w * image[2, 2]
        mx, my, mz = mx + x[k], my + y[k], mz + z[k]
    mx, my, mz = mx / len(directions), my / len(directions), mz / len(directions)
    farthest = 0.0
    for k in range(len(directions)):
        farthest = max(farthest, (x[k] - mx) ** 2 + (y[k] - my) ** 2 + (z[k] - mz) ** 2)
    return mx, my, mz, sqrt(farthest)


@inline
def _reached(mean, centre, reach):
    """True where a function may reach a block: ``reach``, its squared chord, from the ``mean`` and over the block."""
    mx, my, mz, around = mean
    away = (mx - centre[0]) ** 2 + (my - centre[1]) ** 2 + (mz - centre[2]) ** 2
    return not away > _MARGIN * (sqrt(reach) + around) ** 2  # nor where one of the block is not a number


@kernel
def _add(directions, centre, sigma, reach, weight, values, slopes):
    """Add one function to ``values``, and to ``slopes`` its slope before its component along the direction is removed.

    ``directions`` and ``slopes``: arrays by x, y and z. Without slopes, None, it takes 0.6 of the time.
    """
    x, y, z = directions
    cx = centre[0]
    cy = centre[1]
    cz = centre[2]
    inverse = 1.0 / (sigma * sigma)
    if reach <= NEAR:
        for k in range(len(x)):
            squared = (x[k] - cx) ** 2 + (y[k] - cy) ** 2 + (z[k] - cz) ** 2
            clipped = min(squared, reach)
            value = weight * decay(angle_squared(clipped) * inverse) if squared <= reach else 0.0
            values[k] += value
            if slopes is not None:  # known to the compiler
                slope = value * angle_per_sine(clipped) * (2.0 * inverse)
                slopes[0][k] += slope * cx
                slopes[1][k] += slope * cy
                slopes[2][k] += slope * cz
    else:
        for k in range(len(x)):
            squared = min((x[k] - cx) ** 2 + (y[k] - cy) ** 2 + (z[k] - cz) ** 2, 4.0)
            half = half_angle(squared)
            value = weight * decay(4.0 * angle_squared(half) * inverse) if squared <= reach else 0.0
            values[k] += value
            if slopes is not None:  # known to the compiler
                cosine = 1.0 - 0.5 * half  # of half of the angle: sin g = 2 sin(g/2) cos(g/2)
                ratio = angle_per_sine(half) / cosine if cosine > _ANTIPODE else 1.0
                slope = value * ratio * (2.0 * inverse)
                slopes[0][k] += slope * cx
                slopes[1][k] += slope * cy
                slopes[2][k] += slope * cz


@kernel
def sum_functions(directions, images, centres, sigmas, reaches, weights, rows, sums, gradients):
    """Fill ``sums`` (n,) at unit directions (n, 3), and their tangential ``gradients`` (n, 3), per rad, unless None.

    ``reaches`` (m,): squared chords beyond which to leave out. ``rows`` (ROWS, BLOCK): workspace.
    """
    for start in range(0, len(directions), BLOCK):
        block = directions[start : start + BLOCK]
        count = len(block)
        x = rows[0, :count]
        y = rows[1, :count]
        z = rows[2, :count]
        sx = rows[3, :count]
        sy = rows[4, :count]
        sz = rows[5, :count]
        values = rows[6, :count]
        values[:] = 0.0
        if gradients is not None:  # known to the compiler
            gradients[start : start + count] = 0.0
        for image in range(len(images)):
            turn = images[image]
            mean = _turn(block, turn, x, y, z)
            if gradients is not None:
                sx[:] = 0.0
                sy[:] = 0.0
                sz[:] = 0.0
            for j in range(len(weights)):
                if _reached(mean, centres[j], reaches[j]):
                    if gradients is None:
                        _add((x, y, z), centres[j], sigmas[j], reaches[j], weights[j], values, None)
                    else:
                        _add((x, y, z), centres[j], sigmas[j], reaches[j], weights[j], values, (sx, sy, sz))
            if gradients is not None:
                for k in range(count):
                    # towards the centres; the component along the direction is removed
                    along = sx[k] * x[k] + sy[k] * y[k] + sz[k] * z[k]
                    tx = sx[k] - along * x[k]
                    ty = sy[k] - along * y[k]
                    tz = sz[k] - along * z[k]
                    for axis in range(3):
                        turned_back = tx * turn[axis, 0] + ty * turn[axis, 1] + tz * turn[axis, 2]
                        gradients[start + k, axis] += turned_back / len(images)
        for k in range(count):
            sums[start + k] = values[k] / len(images)
