"""Faces that are a profile drawn along y: a ray meets one where its shadow in the plane y = 0 meets the profile.

Such a face looks the same from every place along y. Its table is read on the line Y = 0 alone, whatever its length; its
normals lie across y. Light goes on along y for ever the way that it came, so that it is absorbed at an end, if at all,
exactly where it would leave the face beyond that end.
"""

from math import sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.nearest_face import LEAVING, NEXT, NEXT_Y
from lensforge.kernels.ray_packet import (
    ALONG_X,
    ALONG_Y,
    ALONG_Z,
    DX,
    DZ,
    KEPT_D,
    KEPT_Y,
    LENGTH,
    PY,
    RHO_Y,
    Y0,
    three,
    write,
)

_LEAST = 1e-12  # of a direction across y: along y no ray meets a face


@inline
def across(vector, half_mm):
    """The part of a vector across y; the vector itself where faces are not drawn."""
    if half_mm is None:  # known to the compiler
        return vector
    return vector[0], 0.0, vector[2]


@inline
def shadows(rays, count, half_mm):
    """Take searching rays to their shadows in the plane y = 0."""
    if half_mm is not None:  # known to the compiler
        for k in range(count):
            per_length = 1.0 / max(sqrt(rays[DX + k] * rays[DX + k] + rays[DZ + k] * rays[DZ + k]), _LEAST)
            rays[Y0 + k] = 0.0
            rays[ALONG_X + k] *= per_length
            rays[ALONG_Y + k] = 0.0
            rays[ALONG_Z + k] *= per_length


@inline
def from_shadows(rays, count, half_mm):
    """Take the paths that were found for shadows to those of the rays, and normals across y."""
    if half_mm is not None:  # known to the compiler
        for k in range(count):
            rays[LENGTH + k] /= max(sqrt(rays[DX + k] * rays[DX + k] + rays[DZ + k] * rays[DZ + k]), _LEAST)
            rays[RHO_Y + k] = 0.0


@inline
def length_across(d):
    """Length of the shadow of a direction in the plane y = 0."""
    return max(sqrt(d[0] * d[0] + d[2] * d[2]), _LEAST)


@inline
def become_shadows(rays, count, half_mm):
    """Put the shadow of each ray of a packet in its place, until :func:`become_rays`."""
    if half_mm is not None:  # known to the compiler
        for k in range(count):
            d = three(rays, DX + k)
            per_length = 1.0 / length_across(d)
            rays[KEPT_Y + k] = rays[PY + k]
            write(rays, KEPT_D + k, d)
            rays[PY + k] = 0.0
            write(rays, DX + k, (d[0] * per_length, 0.0, d[2] * per_length))
            rays[LEAVING + k] *= per_length


@inline
def become_rays(rays, count, half_mm):
    """Put the rays back, with the paths that were found for their shadows, and normals across y."""
    if half_mm is not None:  # known to the compiler
        for k in range(count):
            d = three(rays, KEPT_D + k)
            rays[PY + k] = rays[KEPT_Y + k]
            write(rays, DX + k, d)
            rays[NEXT + k] /= length_across(d)
            rays[NEXT_Y + k] = 0.0


@inline
def is_past_end(y, half_mm):
    """True for light that leaves a drawn face beyond its ends."""
    if half_mm is None:  # known to the compiler
        return False
    return abs(y) > half_mm
