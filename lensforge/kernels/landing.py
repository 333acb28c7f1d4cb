"""Exit rays onto a receiver: their intersection with a plane, the sharing of flux among pixels, and its adjoint.

The paper's area weights (its Fig. 3) are bilinear shares between pixel centres. What falls beyond the outermost
centres by more than a pixel reaches no pixel.
"""

from math import floor

from lensforge.kernels.fates import Fate
from lensforge.kernels.jit import inline, kernel

# Least z component of a direction that reaches the plane: below it the hit, or its square, could overflow.
LEAST_RISE = 1e-12


@kernel
def land(points, directions, exit_flux, fates, distance, hits, flux, landed, missed_receiver):
    """Fill, per ray, hit x and y (2), flux, whether it landed, and whether it left the lens and misses the plane."""
    for k in range(len(exit_flux)):
        hits[k, 0], hits[k, 1], flux[k] = 0.0, 0.0, 0.0
        left = fates[k] == Fate.LEFT_LENS
        landed[k] = left and directions[k, 2] > LEAST_RISE
        missed_receiver[k] = left and not landed[k]
        if landed[k]:
            t = (distance - points[k, 2]) / directions[k, 2]
            hits[k, 0] = points[k, 0] + t * directions[k, 0]
            hits[k, 1] = points[k, 1] + t * directions[k, 1]
            flux[k] = exit_flux[k]


@inline
def add_to_pixels(x, y, flux, side, image):
    """Add one ray's flux to ``image`` (pixels, pixels), row y, column x."""
    pixels = image.shape[0]
    u = (x / side + 0.5) * pixels - 0.5
    v = (y / side + 0.5) * pixels - 0.5
    if not (-1.0 < u < pixels and -1.0 < v < pixels):
        return
    i = floor(u)
    j = floor(v)
    for row, share in ((j, 1.0 - (v - j)), (j + 1, v - j)):
        if 0 <= row < pixels:
            if i >= 0:
                image[row, i] += flux * share * (1.0 - (u - i))
            if i + 1 < pixels:
                image[row, i + 1] += flux * share * (u - i)


@inline
def pixels_adjoint(x, y, flux, side, by_image):
    """Sensitivities to a ray's hit (two) and flux from those to the pixels."""
    pixels = by_image.shape[0]
    scale = pixels / side
    by_x, by_y, by_flux = 0.0, 0.0, 0.0
    u = (x / side + 0.5) * pixels - 0.5
    v = (y / side + 0.5) * pixels - 0.5
    if not (-1.0 < u < pixels and -1.0 < v < pixels):
        return by_x, by_y, by_flux
    i = floor(u)
    j = floor(v)
    for row, share, sign in ((j, 1.0 - (v - j), -1.0), (j + 1, v - j, 1.0)):
        if not 0 <= row < pixels:
            continue
        left = by_image[row, i] if i >= 0 else 0.0
        right = by_image[row, i + 1] if i + 1 < pixels else 0.0
        along = left * (1.0 - (u - i)) + right * (u - i)
        by_x += flux * share * (right - left) * scale
        by_y += flux * sign * along * scale
        by_flux += share * along
    return by_x, by_y, by_flux


@kernel
def splat(hits, flux, side, image):
    """Add every ray's flux to ``image``."""
    for k in range(len(flux)):
        if flux[k] != 0.0:
            add_to_pixels(hits[k, 0], hits[k, 1], flux[k], side, image)
