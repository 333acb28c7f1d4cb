"""The end of a ray inside the lens: every ray has exactly one fate, and none is ever dropped."""

from enum import IntEnum


class Fate(IntEnum):
    """How a ray ended, in the order in which it can happen; a receiver decides about those that left the lens."""

    LEFT_LENS = 0  # passed the outer surface
    BACKWARD = 1  # left the source at or below the horizon, or behind the cavity's opening
    OUTSIDE_CAVITY = 2  # started outside of the inner surface, or entered through the base
    BASE = 3  # met the plane z = 0 inside the cavity or the lens body before the next surface
    TOTAL_REFLECTION = 4  # totally reflected at either surface
    NOT_CONVERGED = 5  # the intersection search gave up; zero at standard accuracy
    CROSSED = 6  # the surfaces cross here: the outer one lies inside of the inner one
