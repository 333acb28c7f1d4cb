"""Slopes of facets as light sees them: each counts by the area that light along its way sees of it.

Across the way of the light slopes stay normally distributed. Along it, over their rms, they have the density
(k + x) exp(-x^2/2) above -k, where k is the cotangent of the incidence over the rms (Smith, 1967; Heitz and d'Eon,
2014). A normal number a becomes the number x below which the same share of what is seen lies: along the normal both are
the same, at grazing light x has Rayleigh's distribution, and between them facets follow the light without a jump.
"""

from math import erfc, exp, log, sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.precision import ByPrecision

_ROOT_HALF = sqrt(0.5)
_PER_ROOT = 0.3989422804014327
_STEPS = 8  # two or three at most places, four at all that rays come to
_CLOSE = ByPrecision(3e-4, 1e-2)  # a step of Halley's: it cubes what is left
_ALONG = ByPrecision(1e-4, 1e-2)  # of 1/k: below it a series is closer than a difference of x and a


@inline
def share_below(x):
    """Share of normal numbers below x."""
    return 0.5 * erfc(-x * _ROOT_HALF)


@inline
def bell(x):
    """Density of normal numbers."""
    return _PER_ROOT * exp(-0.5 * x * x)


@inline
def seen_number(a, k):
    """The visible number x of a normal number a, and its derivatives by a and k.

    Halley's steps on the logarithm of the share above x, or on the root of that below it, whichever is less.
    """
    area = k * share_below(k) + bell(k)
    upper = a > 0.0
    wanted = area * share_below(-a if upper else a)
    x = 0.5 * (a - k + sqrt((a + k) * (a + k) + 4.0))
    for _ in range(_STEPS):
        density = (k + x) * bell(x)
        bend = 1.0 / (k + x) - x
        if upper:
            beyond = k * share_below(-x) + bell(x)
            step = log(beyond / wanted) * beyond / density
            curve = bend + density / beyond
        else:
            before = max(k * (share_below(x) - share_below(-k)) + bell(k) - bell(x), 1e-30)
            step = 2.0 * (sqrt(wanted * before) - before) / density
            curve = bend - 0.5 * density / before
        step /= 1.0 + min(max(0.5 * step * curve, -0.5), 0.5)
        x = x + step if k + x + step > 0.0 else 0.5 * (x - k)
        if abs(step) < _CLOSE:
            break
    density = (k + x) * bell(x)
    if upper:
        change = share_below(-x) - share_below(-a) * share_below(k)
    else:
        change = share_below(a) * share_below(k) + share_below(-k) - share_below(x)
    return x, area * bell(a) / density, change / density


@inline
def added_slope(rms, c, along):
    """Visible slope less drawn slope along the light, over the sine of incidence, and its two derivatives.

    ``along``: the slope as drawn, times that sine; ``c``: cosine of incidence, below 0 of light from behind. The
    derivatives are those by c and by ``along``.
    """
    sign = 1.0 if c > 0.0 else -1.0
    cosine = sign * c
    slope = sign * along
    squared = max(1.0 - c * c, 0.0)
    sine = sqrt(squared)
    if rms * sine <= _ALONG * cosine:
        per = rms * rms / cosine
        a = slope / cosine
        variance_excess = a * a - rms * rms * squared / (cosine * cosine)
        added = per * (1.0 - 0.5 * a + variance_excess / 3.0)
        by_c = per / cosine * (a - 1.0 - variance_excess + 2.0 / 3.0 * rms * rms)
        return sign * added, by_c, per / cosine * (2.0 / 3.0 * a - 0.5)
    a = slope / (rms * sine)
    x, by_a, by_k = seen_number(a, cosine / (rms * sine))
    by_c = by_k / (squared * squared) + rms * cosine / (squared * sine) * ((by_a - 1.0) * a + x - a)
    return sign * rms * (x - a) / sine, by_c, (by_a - 1.0) / squared
