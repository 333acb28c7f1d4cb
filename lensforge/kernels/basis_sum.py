"""Sum of spherical radial basis functions and its slope: each function only where it is not negligible.

The angle comes from the chord, ``g = 2 asin(|u - c|/2)``: arccos of a dot product loses half of the digits near the
centre. A symmetric sum is the mean over the mirror images of each direction.
"""

from math import asin, exp, sqrt

from lensforge.kernels.jit import inline, kernel

_SMOOTH = 1e-8  # half chord below which angle over sine is 1 to the last bit


@inline
def chord_squared(ux, uy, uz, centre):
    """Squared distance of a unit direction from a centre; at most 4."""
    dx, dy, dz = ux - centre[0], uy - centre[1], uz - centre[2]
    return min(dx * dx + dy * dy + dz * dz, 4.0)


@inline
def turned(direction, image):
    """A direction (row vector) times a 3 x 3 matrix."""
    x, y, z = direction[0], direction[1], direction[2]
    return (
        x * image[0, 0] + y * image[1, 0] + z * image[2, 0],
        x * image[0, 1] + y * image[1, 1] + z * image[2, 1],
        x * image[0, 2] + y * image[1, 2] + z * image[2, 2],
    )


@kernel
def sum_values(directions, images, centres, sigmas, reaches, weights, total):
    """Fill ``total`` (n,) at unit directions (n, 3); ``reaches`` (m,): squared chords beyond which to leave out."""
    for k in range(len(directions)):
        value = 0.0
        for image in range(len(images)):
            ux, uy, uz = turned(directions[k], images[image])
            for j in range(len(weights)):
                squared = chord_squared(ux, uy, uz, centres[j])
                if squared <= reaches[j]:
                    scaled = 2.0 * asin(0.5 * sqrt(squared)) / sigmas[j]
                    value += weights[j] * exp(-scaled * scaled)
        total[k] = value / len(images)


@kernel
def sum_slopes(directions, images, centres, sigmas, reaches, weights, total):
    """Fill ``total`` (n, 3) with the tangential gradient (per rad) of the sum at unit directions (n, 3)."""
    for k in range(len(directions)):
        gx, gy, gz = 0.0, 0.0, 0.0
        for image in range(len(images)):
            turn = images[image]
            ux, uy, uz = turned(directions[k], turn)
            sx, sy, sz, along = 0.0, 0.0, 0.0, 0.0
            for j in range(len(weights)):
                squared = chord_squared(ux, uy, uz, centres[j])
                if squared <= reaches[j]:
                    half = 0.5 * sqrt(squared)
                    angle, sine = 2.0 * asin(half), 2.0 * half * sqrt(1.0 - half * half)
                    scaled = angle / sigmas[j]
                    ratio = angle / sine if sine > _SMOOTH else 1.0
                    slope = 2.0 * weights[j] * exp(-scaled * scaled) * ratio / (sigmas[j] * sigmas[j])
                    sx += slope * centres[j, 0]
                    sy += slope * centres[j, 1]
                    sz += slope * centres[j, 2]
                    along += slope * (1.0 - 0.5 * squared)
            # d g / d u points away from the centre; its component along u is removed
            sx, sy, sz = sx - along * ux, sy - along * uy, sz - along * uz
            gx += sx * turn[0, 0] + sy * turn[0, 1] + sz * turn[0, 2]
            gy += sx * turn[1, 0] + sy * turn[1, 1] + sz * turn[1, 2]
            gz += sx * turn[2, 0] + sy * turn[2, 1] + sz * turn[2, 2]
        total[k, 0], total[k, 1], total[k, 2] = gx / len(images), gy / len(images), gz / len(images)
