"""Faces that do not stand where they were designed, and rough ones: what ``trace`` and its adjoint do with them.

``placed`` is ``(frames, factor in, factor out)``. ``frames`` (3, 3, 4): a rotation and, in its last column, a shift
(mm), each from one frame into the next: from that of the source into the inner face's own, from there into the outer
face's, and from there back. ``factor in`` is that of lengths on the way into the inner face's frame, ``factor out`` on
the way back: those of a lens that has shrunk, and of a source of another size. ``rough`` is ``(noise, inner slope,
outer slope)``: ``noise`` (n, 6) has three independent standard normal numbers for each ray at either face, and the
slopes are rms along any line on the face.
"""

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
    """The axis z in the outer face's frame."""
    if placed is None:
        return 0.0, 0.0, 1.0
    return turn_back(placed[0][2], 0.0, 0.0, 1.0)


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
def rough_normal(nx, ny, nz, rough, k, face):
    """Normal of a rough face (0: inner, 1: outer) where it meets ray k; n itself where ``rough`` is None."""
    if rough is None:
        return nx, ny, nz
    noise = rough[0][k, 3 * face : 3 * face + 3]
    return tilted(nx, ny, nz, noise[0], noise[1], noise[2], rough[1] if face == 0 else rough[2])


@inline
def rough_normal_adjoint(nx, ny, nz, rough, k, face, hx, hy, hz):
    """Adjoint of :func:`rough_normal`: sensitivity to n from that to the normal (h)."""
    if rough is None:
        return hx, hy, hz
    return tilted_adjoint(
        nx, ny, nz, rough[0][k, 3 * face : 3 * face + 3], rough[1] if face == 0 else rough[2], hx, hy, hz
    )
