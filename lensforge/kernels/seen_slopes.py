"""Slopes of facets as light sees them: each counts by the area that light along its way sees of it.

Across the way of the light slopes stay normally distributed. Along it, over their rms, they have the density
(k + x) exp(-x^2/2) above -k, where k is the cotangent of the incidence over the rms (Smith, 1967; Heitz and d'Eon,
2014). A normal number a becomes the number x below which the same share of what is seen lies: along the normal both are
the same, at grazing light x has Rayleigh's distribution, and between them facets follow the light without a jump.

To find x takes two or three steps of an iteration. A table has it within 5e-8 for a of up to 4 on both sides: of
G(a, s), where s = 3 / (3 + k) and x = a + s/3 (1 + s G). At s = 0 G is linear in a, as the table is to the last bit.
"""

from functools import cache
from math import erfc, exp, log, sqrt

import numpy as np
from jaxtyping import Float

from lensforge.kernels.bicubic import cubic_splines, index_at
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.ray_packet import SIZE, along_row, fields

_ROOT_HALF = sqrt(0.5)
_PER_ROOT = 0.3989422804014327
_STEPS = 8  # two or three at most places, four at all that rays come to
_CLOSE = 3e-4  # a step of Halley's: it cubes what is left

NODES = 257  # of the table, along a and s: with half as many its error is 16 times as large
_MOST = 8.5  # of a: numbers of 53 bits end at 8.3
_SPREAD = 3.0  # of s about k, so that s has room for what changes fast beside k = |a|
_STEP_A = 2.0 * _MOST / (NODES - 1.0)
_STEP_S = 1.0 / (NODES - 1.0)
_LAST_CELL = NODES - 2.0
_LEAST_SQUARE = 1e-16  # of the sine of incidence
_LEAST_RMS = 1e-20  # of a polished face beside rough ones: nothing is seen beyond what is drawn, 0

# What is kept of each ray while it is found what light sees: rms slope of its face, cosine of incidence, drawn slope
# along the light times the sine, and the table's cell.
RMS, COSINE, ALONG, CELL, _, _, _ = fields(0, 7)
SEEN_FIELDS = 7


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
    """The visible number x of a normal number a.

    Halley's steps on the logarithm of the share above x, or on the root of that below it, whichever is less.
    """
    upper = a > 0.0
    wanted = (k * share_below(k) + bell(k)) * share_below(-a if upper else a)
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
    return x


@kernel
def fill_seen(a, k, numbers):
    """Fill ``numbers`` with :func:`seen_number` of all pairs of a and k."""
    for row in range(len(a)):
        for column in range(len(k)):
            numbers[row, column] = seen_number(a[row], k[column])


@cache
def seen_table() -> Float[np.ndarray, "side side"]:
    """Coefficients of the uniform cubic splines of G(a, s), ``NODES`` + 2 along either."""
    a = np.linspace(-_MOST, _MOST, NODES)
    s = np.linspace(0.0, 1.0, NODES)
    numbers = np.empty((NODES, NODES - 1))
    fill_seen(a, _SPREAD * (1.0 / s[1:] - 1.0), numbers)
    beyond = (_SPREAD * (numbers - a[:, None]) / s[1:] - 1.0) / s[1:]
    samples = np.column_stack([1.0 - a / (2.0 * _SPREAD), beyond])
    splines = _spline_matrix()
    along_a = np.linalg.solve(splines, np.pad(samples, 1)[:, 1:-1])
    return np.ascontiguousarray(np.linalg.solve(splines, np.pad(along_a, 1)[1:-1].T).T)


def _spline_matrix() -> Float[np.ndarray, "side side"]:
    """Uniform cubic splines at the nodes, and, above and below, no jump of the third derivative beside the ends."""
    matrix = np.zeros((NODES + 2, NODES + 2))
    for node in range(1, NODES + 1):
        matrix[node, node - 1 : node + 2] = 1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0
    matrix[0, :5] = matrix[-1, -5:] = 1.0, -4.0, 6.0, -4.0, 1.0
    return matrix


@inline
def incidence(packet, at, k):
    """Cosine and sine of incidence of a ray, sign of the cosine, normal number a, and the divisor of s."""
    c = packet[at + COSINE + k]
    rms = packet[at + RMS + k]
    sign = 1.0 if c > 0.0 else -1.0
    sine = sqrt(max(1.0 - c * c, _LEAST_SQUARE))
    a = min(max(sign * packet[at + ALONG + k] / (rms * sine), -_MOST), _MOST)
    return sign * c, sine, sign, a, sign * c + _SPREAD * rms * sine


@inline
def mark_incidence(packet, at, k, rms, c, along):
    """Note how light comes to a facet: cosine c, below 0 from behind, and drawn slope along it times the sine."""
    rms = max(rms, _LEAST_RMS)
    packet[at + RMS + k] = rms
    packet[at + COSINE + k] = c
    packet[at + ALONG + k] = along
    _, sine, _, a, divisor = incidence(packet, at, k)
    row = (a + _MOST) / _STEP_A
    column = _SPREAD * rms * sine / divisor / _STEP_S
    i = index_at(row, _LAST_CELL)
    j = index_at(column, _LAST_CELL)
    packet[at + CELL + k] = i
    packet[at + CELL + SIZE + k] = j
    packet[at + CELL + 2 * SIZE + k] = row - i
    packet[at + CELL + 3 * SIZE + k] = column - j


@inline
def added_slope(packet, at, k):
    """Visible slope less drawn slope along the light, over the sine of incidence, and its two derivatives.

    Those by the cosine of incidence and by ``along``, as :func:`mark_incidence` had them. The table's coefficients have
    been fetched. With D = c + 3 rms sine the slope is rms^2 (1 + s G) / D: nothing in it is singular along the normal.
    """
    c, sine, sign, a, divisor = incidence(packet, at, k)
    rms = packet[at + RMS + k]
    wa, va, _ = cubic_splines(packet[at + CELL + 2 * SIZE + k])
    ws, vs, _ = cubic_splines(packet[at + CELL + 3 * SIZE + k])
    value = 0.0
    by_a = 0.0
    by_s = 0.0
    for row in range(4):
        first = 4 * row * SIZE + k
        across = along_row(packet, first, ws)
        value += wa[row] * across
        by_a += va[row] * across
        by_s += wa[row] * along_row(packet, first, vs)
    by_a /= _STEP_A
    by_s /= _STEP_S
    s = _SPREAD * rms * sine / divisor
    over = 1.0 + s * value
    per = rms * rms / (divisor * divisor)
    turned = a * c * by_a - (value + s * by_s) / divisor + over * c
    by_c = per * (_SPREAD * rms / sine * turned - over)
    return sign * per * divisor * over, by_c, per * _SPREAD * by_a
