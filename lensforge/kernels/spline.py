"""Bicubic table of ``rho`` over the stereographic chart, and its adjoint.

A table is square, first index X; ``origin`` and ``inverse_step`` place coefficient 0 and the spacing.
"""

from typing import Any

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
def cell_of(position, side):
    """First of the four coefficients that act at ``position`` (in steps), kept inside the table."""
    cell = int(position)
    return max(min(cell, side - 3), 1)


@inline
def value_and_slope(table, origin, inverse_step, X, Y):
    """``rho``, d rho/dX, d rho/dY."""
    side = table.shape[0]
    px = (X - origin) * inverse_step
    py = (Y - origin) * inverse_step
    i = cell_of(px, side)
    j = cell_of(py, side)
    wx, dx, _ = cubic_splines(px - i)
    wy, dy, _ = cubic_splines(py - j)
    value = 0.0
    slope_x = 0.0
    slope_y = 0.0
    for a in range(4):
        row = table[i - 1 + a]
        along = wy[0] * row[j - 1] + wy[1] * row[j] + wy[2] * row[j + 1] + wy[3] * row[j + 2]
        across = dy[0] * row[j - 1] + dy[1] * row[j] + dy[2] * row[j + 1] + dy[3] * row[j + 2]
        value += wx[a] * along
        slope_x += dx[a] * along
        slope_y += wx[a] * across
    return value, slope_x * inverse_step, slope_y * inverse_step


@inline
def slope_and_curvature(table, origin, inverse_step, X, Y):
    """First and second derivatives of ``rho`` on the chart: X, Y, XX, XY, YY."""
    side = table.shape[0]
    px = (X - origin) * inverse_step
    py = (Y - origin) * inverse_step
    i = cell_of(px, side)
    j = cell_of(py, side)
    wx, dx, cx = cubic_splines(px - i)
    wy, dy, cy = cubic_splines(py - j)
    x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(4):
        row = table[i - 1 + a]
        along = wy[0] * row[j - 1] + wy[1] * row[j] + wy[2] * row[j + 1] + wy[3] * row[j + 2]
        across = dy[0] * row[j - 1] + dy[1] * row[j] + dy[2] * row[j + 1] + dy[3] * row[j + 2]
        x += dx[a] * along
        y += wx[a] * across
        xx += cx[a] * along
        xy += dx[a] * across
        yy += wx[a] * (cy[0] * row[j - 1] + cy[1] * row[j] + cy[2] * row[j + 1] + cy[3] * row[j + 2])
    square = inverse_step * inverse_step
    return x * inverse_step, y * inverse_step, xx * square, xy * square, yy * square


@inline
def scatter(gradient, origin, inverse_step, X, Y, by_value, by_slope_x, by_slope_y):
    """Adjoint of :func:`value_and_slope`: add the sensitivities to the sixteen coefficients that acted."""
    side = gradient.shape[0]
    px = (X - origin) * inverse_step
    py = (Y - origin) * inverse_step
    i = cell_of(px, side)
    j = cell_of(py, side)
    wx, dx, _ = cubic_splines(px - i)
    wy, dy, _ = cubic_splines(py - j)
    sx = by_slope_x * inverse_step
    sy = by_slope_y * inverse_step
    for a in range(4):
        row = gradient[i - 1 + a]
        along = by_value * wx[a] + sx * dx[a]
        across = sy * wx[a]
        for b in range(4):
            row[j - 1 + b] += along * wy[b] + across * dy[b]
