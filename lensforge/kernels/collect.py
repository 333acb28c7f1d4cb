"""Sums over rays for the merit function, in one pass, and their adjoint.

Besides the image and the flux in the window there are two terms for rays that the image misses: they have no flux and
no derivative in it, so descent alone never brings them back. Each term is bounded, ``e/(1+e)``, so that a few
outliers cannot outweigh the image, and counts the flux with which a ray left the source.
"""

from lensforge.kernels.jit import inline, kernel
from lensforge.kernels.pixels import add_to_pixels, pixels_adjoint

# Squared exit sine above which a ray counts as close to total reflection, and the unit of the excess.
SAFE_SIN2 = 0.97
SIN2_SCALE = 0.1


@inline
def excess_outside(x, y, size):
    """Distances of a hit from the receiver in x and in y, in halves of its width and height."""
    return max(abs(x) / (0.5 * size[0]) - 1.0, 0.0), max(abs(y) / (0.5 * size[1]) - 1.0, 0.0)


@inline
def in_window(x, y, window):
    """True within ``window``: half its width, half its height, and its squared radius, which may be infinite."""
    return abs(x) <= window[0] and abs(y) <= window[1] and x * x + y * y <= window[2]


@kernel
def collect(hits, flux, sin2_exit, landed, emitted, size, window, image, sums):
    """Add all rays to ``image`` (rows, columns) and to ``sums``: in the window, outside, totally reflected."""
    for k in range(len(emitted)):
        excess = (sin2_exit[k] - SAFE_SIN2) / SIN2_SCALE
        if excess > 0.0:
            sums[2] += emitted[k] * excess / (1.0 + excess)
        if not landed[k]:
            continue
        x, y = hits[k, 0], hits[k, 1]
        add_to_pixels(x, y, flux[k], size, image)
        if in_window(x, y, window):
            sums[0] += flux[k]
        ex, ey = excess_outside(x, y, size)
        if ex > 0.0 or ey > 0.0:
            excess = ex * ex + ey * ey
            sums[1] += emitted[k] * excess / (1.0 + excess)


@kernel
def collect_adjoint(hits, flux, sin2_exit, landed, emitted, size, window, by_image, by_sums, by_hits, by_flux, by_sin2):
    """Fill the sensitivities to hits (n, 2), flux (n,) and squared exit sines (n,)."""
    for k in range(len(emitted)):
        by_hits[k, 0], by_hits[k, 1], by_flux[k], by_sin2[k] = 0.0, 0.0, 0.0, 0.0
        excess = (sin2_exit[k] - SAFE_SIN2) / SIN2_SCALE
        if excess > 0.0:
            by_sin2[k] = by_sums[2] * emitted[k] / ((1.0 + excess) * (1.0 + excess) * SIN2_SCALE)
        if not landed[k]:
            continue
        x, y = hits[k, 0], hits[k, 1]
        by_x, by_y, by_w = pixels_adjoint(x, y, flux[k], size, by_image)
        if in_window(x, y, window):
            by_w += by_sums[0]
        ex, ey = excess_outside(x, y, size)
        if ex > 0.0 or ey > 0.0:
            bounded = 1.0 + ex * ex + ey * ey
            slope = 4.0 * by_sums[1] * emitted[k] / (bounded * bounded)
            by_x += slope * ex / size[0] if x > 0.0 else -slope * ex / size[0]
            by_y += slope * ey / size[1] if y > 0.0 else -slope * ey / size[1]
        by_hits[k, 0], by_hits[k, 1], by_flux[k] = by_x, by_y, by_w
