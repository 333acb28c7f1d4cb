"""Fused kernels of the receiver: sharing a ray's flux among the four nearest pixels, and the adjoint.

The paper's area weights (its Fig. 3) are bilinear weights between pixel centres. What falls beyond the outermost
centres by more than a pixel reaches no pixel.
"""

from math import floor

from lensforge.tracing.jit import kernel


@kernel
def splat(hits, flux, side, image):
    """Add every ray's flux to ``image`` (pixels, pixels), row y, column x."""
    pixels = image.shape[0]
    for k in range(len(flux)):
        if flux[k] == 0.0:
            continue
        u = (hits[k, 0] / side + 0.5) * pixels - 0.5
        v = (hits[k, 1] / side + 0.5) * pixels - 0.5
        if not (-1.0 < u < pixels and -1.0 < v < pixels):
            continue
        i = floor(u)
        j = floor(v)
        for row, share_v in ((j, 1.0 - (v - j)), (j + 1, v - j)):
            if 0 <= row < pixels:
                if i >= 0:
                    image[row, i] += flux[k] * share_v * (1.0 - (u - i))
                if i + 1 < pixels:
                    image[row, i + 1] += flux[k] * share_v * (u - i)


@kernel
def splat_adjoint(hits, flux, side, by_image, by_hits, by_flux):
    """Fill the sensitivities to hits (n, 2) and flux (n,) from those to the pixels."""
    pixels = by_image.shape[0]
    scale = pixels / side
    for k in range(len(flux)):
        by_hits[k, 0] = 0.0
        by_hits[k, 1] = 0.0
        by_flux[k] = 0.0
        if flux[k] == 0.0:
            continue
        u = (hits[k, 0] / side + 0.5) * pixels - 0.5
        v = (hits[k, 1] / side + 0.5) * pixels - 0.5
        if not (-1.0 < u < pixels and -1.0 < v < pixels):
            continue
        i = floor(u)
        j = floor(v)
        fu = u - i
        for row, share, sign in ((j, 1.0 - (v - j), -1.0), (j + 1, v - j, 1.0)):
            if not 0 <= row < pixels:
                continue
            left = by_image[row, i] if i >= 0 else 0.0
            right = by_image[row, i + 1] if i + 1 < pixels else 0.0
            along = left * (1.0 - fu) + right * fu
            by_hits[k, 0] += flux[k] * share * (right - left) * scale
            by_hits[k, 1] += flux[k] * sign * along * scale
            by_flux[k] += share * along
