"""What became of a ray: every ray ends with exactly one fate, and none is ever dropped."""

from enum import IntEnum


class Fate(IntEnum):
    """How a ray ended, in the order in which it can happen."""

    ARRIVED = 0  # reached the receiver's plane
    BACKWARD = 1  # left the source at or below the horizon, or behind the cavity's opening
    OUTSIDE_CAVITY = 2  # started outside of the inner surface, or entered through the base
    BASE = 3  # met the plane z = 0 inside the cavity or the lens body before the next surface
    TOTAL_REFLECTION = 4  # totally reflected at either surface
    AVERTED = 5  # left the lens, but away from the receiver's plane
    NOT_CONVERGED = 6  # the intersection search gave up; zero at standard accuracy
    CROSSED = 7  # the surfaces cross here: the outer one lies inside of the inner one
