"""Gaussians of an angle, ``exp(-g^2/sigma^2)``, from its squared chord: arithmetic alone, so that rows become vectors.

The compiler makes no vector instructions of a loop that calls a library's arcsine or exponential. Both are series here,
to the last bits: ``g^2 = s + s^2/12 + s^3/90 + ...`` with the squared chord ``s = 4 sin(g/2)^2`` needs no root, and its
derivative is ``g / sin g``, which the slope takes. Beyond some 40 degrees the series is that of a quarter of the angle.
"""

from math import comb, factorial, log

import numpy as np

from lensforge.kernels.jit import inline

NEAR = 0.5  # squared chord up to which the series takes the angle itself
_TERMS = 19  # at a quarter of 180 degrees, a squared chord of 0.586, the first one left out is 3e-18
_SQUARE = tuple(2.0 / (n * n * comb(2 * n, n)) for n in range(1, _TERMS + 1))  # 4 asin(sqrt(s)/2)^2 over s
_RATIO = tuple(n * term for n, term in enumerate(_SQUARE, start=1))
_EXPONENTIAL = tuple(1.0 / factorial(n) for n in range(14))  # within half of log 2 of 0: to 4e-18
_SMALLEST = 700.0  # exponents beyond this would leave the normal numbers; a sum leaves functions out at 41
_WHOLE = 1.5 * 2.0**52  # added to a number, leaves its nearest whole number in the last bits
_PER_LOG_2 = 1.0 / log(2.0)
_LOG_2, _REST_OF_LOG_2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # whole numbers times the first: exact
_BIAS, _FRACTION_BITS = 1023, 52  # of a float64


@inline
def _series(terms, x):
    """Polynomial with coefficients ``terms``, the constant one first."""
    total = terms[len(terms) - 1]
    for n in range(len(terms) - 2, -1, -1):
        total = total * x + terms[n]
    return total


@inline
def angle_squared(squared):
    """Square of the angle of a squared chord, at most 0.586."""
    return squared * _series(_SQUARE, squared)


@inline
def angle_per_sine(squared):
    """Angle over its sine, for a squared chord of at most 0.586."""
    return _series(_RATIO, squared)


@inline
def half_angle(squared):
    """Squared chord, at most 4, of half of the angle."""
    return 0.5 * squared / (1.0 + np.sqrt(1.0 - 0.25 * squared))


@inline
def decay(exponent):
    """``exp(-exponent)`` of a number of at least 0: of its rest after whole powers of 2, which are set bit by bit."""
    limited = min(exponent, _SMALLEST)
    shifted = _WHOLE - limited * _PER_LOG_2
    whole = shifted - _WHOLE
    rest = (-limited - whole * _LOG_2) - whole * _REST_OF_LOG_2
    bits = np.float64(shifted).view(np.int64)
    power = np.int64((bits + _BIAS) << _FRACTION_BITS).view(np.float64)
    return _series(_EXPONENTIAL, rest) * power
