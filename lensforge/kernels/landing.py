"""Intersection of exit rays with the plane ``z = distance`` of a receiver."""

from lensforge.kernels.fates import Fate
from lensforge.kernels.jit import kernel

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
