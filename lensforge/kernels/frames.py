"""Frames in which the faces of a lens stand as it was made; see ``kernels.traced_body``."""

from lensforge.kernels.compiled import inline

# Frames of a placement: into the first face's, from the inner one of two faces into the outer one's, and the last back.
INTO = 0
BETWEEN = 1
BACK = -1


@inline
def turn(frame, v):
    """The direction in the next frame."""
    return (
        frame[0, 0] * v[0] + frame[0, 1] * v[1] + frame[0, 2] * v[2],
        frame[1, 0] * v[0] + frame[1, 1] * v[1] + frame[1, 2] * v[2],
        frame[2, 0] * v[0] + frame[2, 1] * v[1] + frame[2, 2] * v[2],
    )


@inline
def place(frame, factor, p):
    """The point in the next frame."""
    x, y, z = turn(frame, p)
    return factor * x + frame[0, 3], factor * y + frame[1, 3], factor * z + frame[2, 3]


@inline
def turn_back(frame, v):
    """The direction, or a sensitivity, in the frame before."""
    return (
        frame[0, 0] * v[0] + frame[1, 0] * v[1] + frame[2, 0] * v[2],
        frame[0, 1] * v[0] + frame[1, 1] * v[1] + frame[2, 1] * v[2],
        frame[0, 2] * v[0] + frame[1, 2] * v[1] + frame[2, 2] * v[2],
    )


@inline
def place_back(frame, p):
    """The point in the frame before."""
    return turn_back(frame, (p[0] - frame[0, 3], p[1] - frame[1, 3], p[2] - frame[2, 3]))


@inline
def turned(placement, number, v):
    """A vector, or a direction, behind the frame of this number; itself where all faces are in place."""
    return v if placement is None else turn(placement.frames[number], v)


@inline
def turned_back(placement, number, v):
    """Sensitivity to a vector before the frame of this number from that behind it."""
    return v if placement is None else turn_back(placement.frames[number], v)


@inline
def turned_between(placement, v):
    """A vector behind the inner one of two faces in the frame of the outer one."""
    if placement is None:
        return v
    return turn(placement.frames[BETWEEN], v) if len(placement.frames) > 2 else v


@inline
def into_faces(placement, p, d):
    """Point and direction of a ray that comes, in the frame of the first face."""
    if placement is None:
        return p, d
    return place(placement.frames[INTO], placement.factor_in, p), turn(placement.frames[INTO], d)


@inline
def to_next_face(placement, p, d):
    """Point and direction of a ray behind the inner one of two faces in the frame of the outer one."""
    if placement is None:
        return p, d
    if len(placement.frames) == 2:
        return p, d
    return place(placement.frames[BETWEEN], 1.0, p), turn(placement.frames[BETWEEN], d)


@inline
def out_of_faces(placement, p, d):
    """Point and direction of a ray that leaves, in the frame of the receivers."""
    if placement is None:
        return p, d
    return place(placement.frames[BACK], placement.factor_out, p), turn(placement.frames[BACK], d)


@inline
def back_into_faces(placement, e, f):
    """Sensitivities to the point and the direction of a ray that leaves, in the frame of the last face."""
    if placement is None:
        return e, f
    frame = placement.frames[BACK]
    factor = placement.factor_out
    return turn_back(frame, (factor * e[0], factor * e[1], factor * e[2])), turn_back(frame, f)


@inline
def z_axis(placement):
    """The axis z in the last face's frame."""
    return turned_back(placement, BACK, (0.0, 0.0, 1.0))
