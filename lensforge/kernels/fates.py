"""Fates of rays inside the lens: every ray has exactly one, and none is ever dropped."""

from enum import IntEnum


class Fate(IntEnum):
    """Fate of a ray, in the order in which it can happen; a receiver tells which of those that left the lens land.

    Kernels use the members as they are: numba compiles them to their integers.
    """

    LEFT_LENS = 0  # passed the outer surface
    BACKWARD = 1  # left the source sideways or downwards, at or below the horizon
    OUTSIDE_CAVITY = 2  # started outside the inner surface, or entered through the base
    BASE = 3  # met the plane z = 0 inside the cavity or the lens body before the next surface
    TOTAL_REFLECTION = 4  # totally reflected at either surface
    NOT_CONVERGED = 5  # the intersection search gave up; zero at standard accuracy
    SURFACES_INTERSECT = 6  # the outer surface lies inside the inner one here
