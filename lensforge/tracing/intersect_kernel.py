"""Fused kernels, part 2: the first crossing of a ray with a star-shaped surface, proven and fast.

The search walks from the inside along ``F(t) = rho(u(t)) - |p(t)|`` with steps that cannot jump over a root: where
``-F'' <= C`` on the way ahead, the parabola ``F + F' s - C s^2/2`` bounds F from below, and its root is a safe
step. Once Kantorovich's condition ``C F <= F'^2 / 2`` holds the next root is unique and plain Newton finishes.
C comes from bounds on the table's slopes and curvatures on the unit sphere, which :func:`surface_bounds` takes from
differences of the B-spline coefficients (convex-hull property), so they hold between the nodes too.
"""

from math import sqrt

import numpy as np

from lensforge.tracing.jit import inline, kernel
from lensforge.tracing.spline_kernel import value_and_slope

FOUND = 0
BELOW = 1  # passed the plane z = 0 first
LOST = 2  # no convergence

_MAX_STEPS = 200
_TOLERANCE = 1e-13  # of the distance from the origin
_ROUNDING = 2e-15  # F below this share of the distance is noise; near tangency it would move the root for ever


@kernel
def surface_bounds(table, origin, step):
    """Over z >= 0: ``[min rho, max rho, max |grad rho|, max |Hessian of rho|]`` on the unit sphere, mm and rad.

    Chart derivatives become sphere derivatives through the conformal factor 2/(1+R^2) of the stereographic chart.
    """
    side = table.shape[0]
    bounds = np.array([np.inf, -np.inf, 0.0, 0.0])
    for i in range(1, side - 1):
        X = origin + i * step
        for j in range(1, side - 1):
            Y = origin + j * step
            radius = sqrt(X * X + Y * Y)
            if radius > 1.0 + 4.0 * step:
                continue
            c = table[i, j]
            bounds[0] = min(bounds[0], c)
            bounds[1] = max(bounds[1], c)
            east, west, north, south = table[i + 1, j], table[i - 1, j], table[i, j + 1], table[i, j - 1]
            dx = max(abs(east - c), abs(c - west)) / step
            dy = max(abs(north - c), abs(c - south)) / step
            xx = abs(east - 2.0 * c + west) / (step * step)
            yy = abs(north - 2.0 * c + south) / (step * step)
            xy = abs(table[i + 1, j + 1] - table[i + 1, j] - table[i, j + 1] + c) / (step * step)
            outer = radius + 2.0 * step  # the differences act a step or two around this coefficient
            shrink = 0.5 * (1.0 + outer * outer)
            gradient = sqrt(dx * dx + dy * dy)
            chart_hessian = 0.5 * (xx + yy) + sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
            bounds[2] = max(bounds[2], gradient * shrink)
            bounds[3] = max(bounds[3], chart_hessian * shrink * shrink + gradient * outer * shrink)
    # One point may see the extremes of several neighbouring coefficients; a tenth covers that for resolved tables.
    bounds[2] *= 1.1
    bounds[3] *= 1.1
    return bounds


@inline
def first_hit(px, py, pz, dx, dy, dz, table, origin, inverse_step, bounds):
    """Path length to the first crossing from a point with ``|p| <= rho``, and a status."""
    t = 0.0
    newton = False
    for _ in range(_MAX_STEPS):
        x = px + t * dx
        y = py + t * dy
        z = pz + t * dz
        if z < 0.0 and dz <= 0.0:
            return t, BELOW
        r_squared = x * x + y * y + z * z
        r = sqrt(r_squared)
        outward = x * dx + y * dy + z * dz
        if r < bounds[0] and not newton:  # F > 0 in the whole ball: go to its far side
            leap = sqrt(outward * outward + bounds[0] * bounds[0] - r_squared) - outward
            t += leap * (1.0 + 1e-15) + 1e-15 * bounds[0]
            x = px + t * dx
            y = py + t * dy
            z = pz + t * dz
            if z < 0.0 and dz <= 0.0:
                return t, BELOW
            r_squared = x * x + y * y + z * z
            r = sqrt(r_squared)
            outward = x * dx + y * dy + z * dz
        shift = r + z
        if shift <= 0.5 * r:  # far below the horizon: outside of the chart
            return t, BELOW
        X = x / shift
        Y = y / shift
        rho, rho_x, rho_y = value_and_slope(table, origin, inverse_step, X, Y)
        F = rho - r
        climb = outward / r
        ahead = climb + dz
        slope = rho_x * (dx - X * ahead) / shift + rho_y * (dy - Y * ahead) / shift - climb
        if newton:
            move = -F / slope
            t += move
            if abs(move) <= _TOLERANCE * r or abs(F) <= _ROUNDING * r:
                return t, FOUND
            continue
        if _ROUNDING * r >= F:  # at the root to rounding, or started on or beyond it
            return t, FOUND if -1e-12 * r < F and t > 0.0 else LOST
        nearest = r
        if outward < 0.0:
            nearest = max(sqrt(max(r_squared - outward * outward, 0.0)), bounds[0])
        bend = ((bounds[2] + bounds[3]) / nearest + 1.0) / nearest
        if slope < 0.0 and 2.0 * bend * F <= slope * slope:
            newton = True
            move = -F / slope
        else:
            root = sqrt(slope * slope + 2.0 * bend * F)
            move = 2.0 * F / (root - slope) if slope < 0.0 else (slope + root) / bend
            steepest = sqrt(1.0 + (bounds[2] / nearest) ** 2)
            move = max(move, F / steepest)
        t += move
        if abs(move) <= _TOLERANCE * r:
            return t, FOUND
    return t, LOST
