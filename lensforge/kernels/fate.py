"""Fates of rays inside the lens: every ray has exactly one, and none is ever dropped.

The light starts in the cavity: inside the inner surface, above the plane z = 0 on which the lens stands. Light from
below that plane comes in through the cavity's opening in it.
"""

from enum import IntEnum


class Fate(IntEnum):
    """Fate of a ray, in the order in which it can happen; a receiver tells which of those that left the lens land.

    A ray that starts above z = 0 inside the inner surface enters whichever way it goes; one from z = 0 or below enters
    if it rises, and crosses the plane inside the inner surface. It then goes straight to the inner surface, is
    refracted, goes straight to the outer surface and is refracted again; reflected light is not followed. The first of
    these that holds is its fate. Kernels use the members as they are: numba compiles them to their integers.
    """

    LEFT_LENS = 0  # refracted at both surfaces, both met at z >= 0; on its way upwards, sideways or downwards
    BACKWARD = 1  # sideways or down from z = 0 or below, or through z = 0 before the inner surface: out of the opening
    OUTSIDE_CAVITY = 2  # started above z = 0 on or beyond the inner surface, or crossed z = 0 upwards beyond it
    BASE = 3  # refracted at the inner surface, met the plane z = 0 in the lens body before the outer surface
    TOTAL_REFLECTION = 4  # totally reflected at the outer surface, or met a surface from its far side, at a tangent
    NOT_CONVERGED = 5  # the intersection search gave up; zero at standard accuracy
    SURFACES_INTERSECT = 6  # met the inner surface where the outer one lies inside it
    EVENT_LIMIT = 7  # still in the body after as many refractions and reflections as the scene follows
    FLANGE = 8  # absorbed by what holds the lens: at its flange, or at a capped end of a profile drawn along y
