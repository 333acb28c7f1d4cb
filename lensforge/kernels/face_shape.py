"""Curvature and draft of a face ``rho u`` from its radius and derivatives on the chart, and their adjoints.

With ``w = ln(rho)``, its gradient ``g`` and Hessian ``W`` on the unit sphere, and ``v = sqrt(1 + |g|^2)``, the first
and second fundamental forms are ``rho^2 (I + g g')`` and ``rho (I + g g' - W) / v``, so that the principal curvatures
are the eigenvalues of ``(I - P W P) / (rho v)`` with ``P = (I + g g')^(-1/2)``: symmetric, hence exact at umbilics, and
``1/rho`` for a sphere about the origin. The chart is conformal with ``scale = 2/(1 + X^2 + Y^2)``.

``derivatives`` (5, k): of ``rho`` by the chart coordinates: X, Y, XX, XY, YY. ``sign``: 1 or -1. An adjoint leaves
points out whose sensitivity is 0: of a limit those at which it does not bind.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.compiled import inline, kernel

_UMBILIC = 1e-24  # below the rounding of a squared eigenvalue: keeps the derivative of the root finite


class ChartPlaces(NamedTuple):
    """Chart coordinates X and Y of points, and the scale of the chart there."""

    x: Float[np.ndarray, " k"]
    y: Float[np.ndarray, " k"]
    scale: Float[np.ndarray, " k"]


@inline
def log_jet(rho, derivatives, k, places):
    """Chart derivatives of ``ln(rho)``: by X and Y, and second ones over ``rho``; then its Hessian on the sphere."""
    per_rho = 1.0 / rho[k]
    wx, wy = derivatives[0, k] * per_rho, derivatives[1, k] * per_rho
    rxx = derivatives[2, k] * per_rho
    rxy = derivatives[3, k] * per_rho
    ryy = derivatives[4, k] * per_rho
    x = places.x[k]
    y = places.y[k]
    scale = places.scale[k]
    fx, fy = -scale * x, -scale * y  # gradient of the scale's logarithm
    turn = fx * wx - fy * wy
    area = 1.0 / (scale * scale)
    hxx = (rxx - wx * wx - turn) * area
    hxy = (rxy - wx * wy - fy * wx - fx * wy) * area
    hyy = (ryy - wy * wy + turn) * area
    return (wx, wy, rxx, rxy, ryy), (hxx, hxy, hyy)


@inline
def stretched(gx, gy, hessian):
    """``v``, the entries of ``P``, and those of ``P W P``: xx, xy, yy."""
    hxx, hxy, hyy = hessian
    v = sqrt(1.0 + gx * gx + gy * gy)
    c = 1.0 / (v * (v + 1.0))
    pxx = 1.0 - c * gx * gx
    pxy = -c * gx * gy
    pyy = 1.0 - c * gy * gy
    # the columns of W P, and then P W P
    axx, axy = hxx * pxx + hxy * pxy, hxx * pxy + hxy * pyy
    ayx, ayy = hxy * pxx + hyy * pxy, hxy * pxy + hyy * pyy
    return v, (pxx, pxy, pyy), (pxx * axx + pxy * ayx, pxx * axy + pxy * ayy, pxy * axy + pyy * ayy)


@inline
def eigenvalue_parts(product):
    """Mean of the eigenvalues of a symmetric matrix, half of the difference of its diagonal, and that of theirs."""
    sxx, sxy, syy = product
    half = 0.5 * (sxx + syy)
    difference = 0.5 * (sxx - syy)
    return half, difference, sqrt(difference * difference + sxy * sxy + _UMBILIC)


@kernel
def least_curvatures(rho, derivatives, places, sign, out):
    """Fill ``out`` (k,) with the smaller principal curvature (1/mm) seen from the air: negative where concave.

    ``sign``: 1 where the air is outside of the face, -1 where it is inside.
    """
    for k in range(len(rho)):
        slopes, hessian = log_jet(rho, derivatives, k, places)
        v, _, product = stretched(slopes[0] / places.scale[k], slopes[1] / places.scale[k], hessian)
        half, _, deviator = eigenvalue_parts(product)
        out[k] = (sign * (1.0 - half) - deviator) / (rho[k] * v)


@inline
def curvature_back(gx, gy, sign, hessian):
    """Derivatives of ``rho`` times the curvature by ``gx`` and ``gy``, by the Hessian xx, xy, yy, and itself."""
    hxx, hxy, hyy = hessian
    v, (pxx, pxy, pyy), product = stretched(gx, gy, hessian)
    half, difference, deviator = eigenvalue_parts(product)
    curvature = (sign * (1.0 - half) - deviator) / v
    by_half = -0.5 * sign / v
    by_difference = -0.5 * difference / (deviator * v)
    bxx = by_half + by_difference
    byy = by_half - by_difference
    bxy = -0.5 * product[1] / (deviator * v)
    # P B, then P B P by the Hessian, and W P B by P
    qxx, qxy = pxx * bxx + pxy * bxy, pxx * bxy + pxy * byy
    qyx, qyy = pxy * bxx + pyy * bxy, pxy * bxy + pyy * byy
    by_hxx = qxx * pxx + qxy * pxy
    by_hyy = qyx * pxy + qyy * pyy
    by_hxy = 2.0 * (qxx * pxy + qxy * pyy)
    by_pxx = 2.0 * (hxx * qxx + hxy * qyx)
    by_pyy = 2.0 * (hxy * qxy + hyy * qyy)
    by_pxy = 2.0 * (hxx * qxy + hxy * qyy + hxy * qxx + hyy * qyx)
    c = 1.0 / (v * (v + 1.0))
    by_c = -(gx * gx * by_pxx + gx * gy * by_pxy + gy * gy * by_pyy)
    per_v = (-curvature / v - by_c * (2.0 * v + 1.0) * c * c) / v
    by_gx = per_v * gx - c * (2.0 * gx * by_pxx + gy * by_pxy)
    by_gy = per_v * gy - c * (2.0 * gy * by_pyy + gx * by_pxy)
    return by_gx, by_gy, by_hxx, by_hxy, by_hyy, curvature


@kernel
def least_curvatures_adjoint(by, rho, derivatives, places, sign, by_rho, by_derivatives):
    """Fill ``by_rho`` (k,) and ``by_derivatives`` (5, k) from the sensitivities ``by`` (k,) to the curvatures."""
    for k in range(len(rho)):
        if by[k] == 0.0:
            by_rho[k] = 0.0
            by_derivatives[:, k] = 0.0
            continue
        (wx, wy, rxx, rxy, ryy), hessian = log_jet(rho, derivatives, k, places)
        x = places.x[k]
        y = places.y[k]
        scale = places.scale[k]
        gx, gy, xx, xy, yy, curvature = curvature_back(wx / scale, wy / scale, sign, hessian)
        area = 1.0 / (scale * scale)
        fx = -scale * x
        fy = -scale * y
        xx = xx * area
        xy = xy * area
        yy = yy * area
        by_wx = gx / scale - 2.0 * wx * xx - (wy + fy) * xy + fx * (yy - xx)
        by_wy = gy / scale - 2.0 * wy * yy - (wx + fx) * xy - fy * (yy - xx)
        per = by[k] / (rho[k] * rho[k])
        by_rho[k] = -per * (curvature + wx * by_wx + wy * by_wy + rxx * xx + rxy * xy + ryy * yy)
        by_derivatives[0, k] = per * by_wx
        by_derivatives[1, k] = per * by_wy
        by_derivatives[2, k] = per * xx
        by_derivatives[3, k] = per * xy
        by_derivatives[4, k] = per * yy


@kernel
def draft_sines(rho, derivatives, places, sign, out):
    """Fill ``out`` (k,) with the sine of the draft angle, ``sign`` times ``n . z`` of the outward normal."""
    for k in range(len(rho)):
        x = places.x[k]
        y = places.y[k]
        scale = places.scale[k]
        wx, wy = derivatives[0, k] / rho[k], derivatives[1, k] / rho[k]
        gx, gy = wx / scale, wy / scale
        out[k] = sign * (scale - 1.0 + x * wx + y * wy) / sqrt(1.0 + gx * gx + gy * gy)


@kernel
def draft_sines_adjoint(by, rho, derivatives, places, sign, by_rho, by_derivatives):
    """Fill ``by_rho`` (k,) and ``by_derivatives`` (5, k) from the sensitivities ``by`` (k,) to the sines."""
    for k in range(len(rho)):
        by_rho[k] = 0.0
        by_derivatives[:, k] = 0.0
        if by[k] == 0.0:
            continue
        x = places.x[k]
        y = places.y[k]
        scale = places.scale[k]
        wx, wy = derivatives[0, k] / rho[k], derivatives[1, k] / rho[k]
        gx, gy = wx / scale, wy / scale
        square = 1.0 + gx * gx + gy * gy
        fall = (scale - 1.0 + x * wx + y * wy) / (square * scale)
        per = sign * by[k] / (sqrt(square) * rho[k])
        by_x, by_y = per * (x - fall * gx), per * (y - fall * gy)
        by_rho[k] = -(wx * by_x + wy * by_y)
        by_derivatives[0, k] = by_x
        by_derivatives[1, k] = by_y
