"""Sharing of a ray's flux among the pixels of a rectangular grid, and its adjoint.

The paper's area weights (its Fig. 3) are bilinear shares between pixel centres. What falls beyond the outermost
centres by more than a pixel reaches no pixel. ``size``: width and height of the grid, in the unit of the hits.
"""

from math import floor

from lensforge.kernels.jit import inline, kernel


@inline
def add_to_pixels(x, y, flux, size, image):
    """Add one ray's flux to ``image`` (rows, columns), row y, column x."""
    rows, columns = image.shape
    u = (x / size[0] + 0.5) * columns - 0.5
    v = (y / size[1] + 0.5) * rows - 0.5
    if not (-1.0 < u < columns and -1.0 < v < rows):
        return
    i = floor(u)
    j = floor(v)
    for row, share in ((j, 1.0 - (v - j)), (j + 1, v - j)):
        if 0 <= row < rows:
            if i >= 0:
                image[row, i] += flux * share * (1.0 - (u - i))
            if i + 1 < columns:
                image[row, i + 1] += flux * share * (u - i)


@inline
def pixels_adjoint(x, y, flux, size, by_image):
    """Sensitivities to a ray's hit (two) and flux from those to the pixels."""
    rows, columns = by_image.shape
    by_x, by_y, by_flux = 0.0, 0.0, 0.0
    u = (x / size[0] + 0.5) * columns - 0.5
    v = (y / size[1] + 0.5) * rows - 0.5
    if not (-1.0 < u < columns and -1.0 < v < rows):
        return by_x, by_y, by_flux
    i = floor(u)
    j = floor(v)
    for row, share, sign in ((j, 1.0 - (v - j), -1.0), (j + 1, v - j, 1.0)):
        if not 0 <= row < rows:
            continue
        left = by_image[row, i] if i >= 0 else 0.0
        right = by_image[row, i + 1] if i + 1 < columns else 0.0
        along = left * (1.0 - (u - i)) + right * (u - i)
        by_x += flux * share * (right - left) * (columns / size[0])
        by_y += flux * sign * along * (rows / size[1])
        by_flux += share * along
    return by_x, by_y, by_flux


@kernel
def splat(hits, flux, size, image):
    """Add every ray's flux to ``image``."""
    for k in range(len(flux)):
        if flux[k] != 0.0:
            add_to_pixels(hits[k, 0], hits[k, 1], flux[k], size, image)


@kernel
def add_to_bins(hits, flux, size, replicate, images):
    """Add every ray's flux to the pixel that it hits in the image (r, rows, columns) of its replicate.

    ``replicate``: the number of each ray's, or one for all.
    """
    _, rows, columns = images.shape
    for k in range(len(flux)):
        u = floor((hits[k, 0] / size[0] + 0.5) * columns)
        v = floor((hits[k, 1] / size[1] + 0.5) * rows)
        if flux[k] > 0.0 and 0 <= u < columns and 0 <= v < rows:
            images[replicate[min(k, len(replicate) - 1)], int(v), int(u)] += flux[k]
