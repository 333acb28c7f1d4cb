"""Bicubic table of ``rho`` over the stereographic chart, and its adjoint.

A table is square, first index X; ``origin`` and ``inverse_step`` place coefficient 0 and the spacing.
"""

from typing import Any

import numpy as np

from lensforge.kernels.jit import inline

_SIXTH, _TWO_THIRDS = 1.0 / 6.0, 2.0 / 3.0


def uniform_cubic(f: Any) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]:
    """The four uniform cubic B-splines at the fraction ``f`` of a cell, a number or a tensor, and two derivatives.

    The first and second derivatives are per step.
    """
    g = 1.0 - f
    return (
        (
            _SIXTH * g * g * g,
            _TWO_THIRDS - f * f * (1.0 - 0.5 * f),
            _TWO_THIRDS - g * g * (1.0 - 0.5 * g),
            _SIXTH * f * f * f,
        ),
        (-0.5 * g * g, f * (1.5 * f - 2.0), g * (2.0 - 1.5 * g), 0.5 * f * f),
        (g, 3.0 * f - 2.0, 3.0 * g - 2.0, f),
    )


cubic_splines = inline(uniform_cubic)


@inline
def index_at(position, most):
    """The whole number up to ``position``, from 0 to ``most``, also where that is NaN; still a float."""
    position = position if position < most else most
    return float(np.int32(position if position > 0.0 else 0.0))


@inline
def value_and_slope(table, origin, inverse_step, X, Y):
    """``rho``, d rho/dX, d rho/dY."""
    most = table.shape[0] - 4.0
    px = (X - origin) * inverse_step
    py = (Y - origin) * inverse_step
    i, j = index_at(px - 1.0, most), index_at(py - 1.0, most)
    wx, dx, _ = cubic_splines(px - (i + 1.0))
    wy, dy, _ = cubic_splines(py - (j + 1.0))
    row, column = int(i), int(j)
    value = 0.0
    slope_x = 0.0
    slope_y = 0.0
    for a in range(4):
        along = wy[0] * table[row + a, column] + wy[1] * table[row + a, column + 1]
        along += wy[2] * table[row + a, column + 2] + wy[3] * table[row + a, column + 3]
        across = dy[0] * table[row + a, column] + dy[1] * table[row + a, column + 1]
        across += dy[2] * table[row + a, column + 2] + dy[3] * table[row + a, column + 3]
        value += wx[a] * along
        slope_x += dx[a] * along
        slope_y += wx[a] * across
    return value, slope_x * inverse_step, slope_y * inverse_step


@inline
def scatter(gradient, i, j, share_x, share_y, inverse_step, by_value, by_slope_x, by_slope_y):
    """Adjoint of :func:`value_and_slope`: add the sensitivities to the sixteen coefficients that acted.

    ``i``, ``j``: the first row and column of them; the shares are those of a step behind the second.
    """
    wx, dx, _ = cubic_splines(share_x)
    wy, dy, _ = cubic_splines(share_y)
    sx = by_slope_x * inverse_step
    sy = by_slope_y * inverse_step
    for a in range(4):
        row = gradient[i + a]
        along = by_value * wx[a] + sx * dx[a]
        across = sy * wx[a]
        for b in range(4):
            row[j + b] += along * wy[b] + across * dy[b]
