"""Frames in which the faces of a lens stand as it was made, and their roughness; arguments as in ``kernels.trace``."""

from math import sqrt

from lensforge.kernels.compiled import inline


@inline
def turn(frame, x, y, z):
    """The direction in the next frame."""
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@inline
def place(frame, factor, x, y, z):
    """The point in the next frame."""
    x, y, z = turn(frame, x, y, z)
    return factor * x + frame[0, 3], factor * y + frame[1, 3], factor * z + frame[2, 3]


@inline
def turn_back(frame, x, y, z):
    """The direction, or a sensitivity, in the frame before."""
    return (
        frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z,
        frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
        frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
    )


@inline
def z_axis(placed):
    """The axis z in the last face's frame."""
    if placed is None:
        return 0.0, 0.0, 1.0
    return turn_back(placed[0][len(placed[0]) - 1], 0.0, 0.0, 1.0)


@inline
def tilted(nx, ny, nz, a, b, c, slope):
    """Normal n of a rough face, not normalised: tilted by ``slope`` times the noise (a, b, c).

    The noise along n changes its length alone, a tilt by no more than the slope squared.
    """
    scale = slope * sqrt(nx * nx + ny * ny + nz * nz)
    return nx + scale * a, ny + scale * b, nz + scale * c


@inline
def tilted_adjoint(nx, ny, nz, noise, slope, hx, hy, hz):
    """Sensitivity to n from that to the tilted normal (h)."""
    along = slope * (noise[0] * hx + noise[1] * hy + noise[2] * hz) / sqrt(nx * nx + ny * ny + nz * nz)
    return hx + along * nx, hy + along * ny, hz + along * nz


@inline
def rough_normal(nx, ny, nz, rough, k, event, face):
    """Normal of a rough face where ray k meets it; n itself where ``rough`` is None."""
    if rough is None:
        return nx, ny, nz
    noise, first = rough[0], 3 * event % rough[0].shape[1]  # as much for each ray as it has faces
    return tilted(nx, ny, nz, noise[k, first], noise[k, first + 1], noise[k, first + 2], rough[1][face])


@inline
def rough_normal_adjoint(nx, ny, nz, rough, k, event, face, hx, hy, hz):
    """Adjoint of :func:`rough_normal`: sensitivity to n from that to the normal (h)."""
    if rough is None:
        return hx, hy, hz
    first = 3 * event % rough[0].shape[1]
    return tilted_adjoint(nx, ny, nz, rough[0][k, first : first + 3], rough[1][face], hx, hy, hz)
