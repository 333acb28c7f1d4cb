"""The nearest face: for rays in a medium of a chain, the first crossing of the faces that bound it.

A ray meets the faces that bound its medium from inside, and from outside those that it surrounds. The face that is
likely to be met is searched first; another is searched where the crossing found does not rule it out.
"""

from math import inf, sqrt

from lensforge.kernels.bicubic import bounds_of, jet
from lensforge.kernels.compiled import NONE_YET, inline
from lensforge.kernels.first_hit import BELOW, FOUND, GOING, LOST, MISSED, first_hits
from lensforge.kernels.nearly_convex import (
    clear_ahead,
    gauge_along,
    is_first,
    mark_node,
    nodal,
    path_to_ball,
    quick_hits,
    start_quick,
    stays_outside,
)
from lensforge.kernels.ray_packet import (
    ALONG_X,
    CLOSING,
    DX,
    LENGTH,
    LIMIT,
    NUMBER,
    OF_CHAIN,
    ON_FACE,
    PX,
    RHO_X,
    RHO_Y,
    SIZE,
    STATUS,
    X0,
    R,
    T,
    fields,
    in_whole_vectors,
    three,
    write,
)
from lensforge.kernels.traced_body import BODY, CAVITY
from lensforge.kernels.vectors import add_scaled, dot

# The medium in which a ray is, the face last met, the face that it is likely to meet; the nearest crossing found, and
# its face; likewise on the way back into the cavity, as far as it has been followed, and where that ends at the latest;
# what absorption leaves of the flux; the rays that are searched; whether a guess is still to be searched, and its
# radius; the slope of |p|/rho at the face last met; 1 for a ray that comes from before its face, -1 from behind; the
# direction behind a face; the reflectance of a mirror there, below 0 of none; what faces leave of the flux, and both
# fields (real, imaginary).
(
    MEDIUM, LAST, GUESS, FACE, NEXT, NEXT_STATUS, NEXT_X, NEXT_Y, BACK_FACE, BACK, BACK_STATUS, BACK_X, BACK_Y,
    BACK_END, CLEAR, ASKED, PENDING, RADIUS, LEAVING, SIDE, BENT, _, _,
    MIRROR, SHARE, FIELDS,
) = fields(OF_CHAIN, 26)  # fmt: skip
_PASSES = 8  # over the faces of a cavity, until a ray is in all of them


@inline
def keep_nearest(rays, count, face):
    """Keep the crossing with one face if it is nearer than the stored one; a failed search stays failed."""
    for lane in range(count):
        k = int(rays[ASKED + lane])
        if rays[NEXT_STATUS + k] == LOST:
            continue
        status = rays[STATUS + k]
        nearer = rays[LENGTH + k] < rays[NEXT + k]
        if status == LOST:
            rays[NEXT_STATUS + k] = LOST
        elif status == FOUND and nearer:
            rays[NEXT_STATUS + k] = FOUND
            rays[NEXT + k] = rays[LENGTH + k]
            rays[FACE + k] = face
            rays[NEXT_X + k] = rays[RHO_X + k]
            rays[NEXT_Y + k] = rays[RHO_Y + k]
        elif status == BELOW and rays[NEXT_STATUS + k] == MISSED:
            rays[NEXT_STATUS + k] = BELOW


@inline
def start_one(rays, lane, k, face, path, end):
    """Start the search of ray k of a packet for ``face``, from ``path`` (mm) ahead to ``end``."""
    rays[NUMBER + lane] = float(k)
    rays[ASKED + lane] = float(k)
    rays[T + lane] = 0.0
    rays[CLOSING + lane] = 0.0
    rays[ON_FACE + lane] = 1.0 if rays[LAST + k] == face and path == 0.0 else 0.0
    rays[LIMIT + lane] = end - path
    for axis in range(0, 3 * SIZE, SIZE):
        along = rays[DX + axis + k]
        rays[X0 + axis + lane] = rays[PX + axis + k] + path * along
        rays[ALONG_X + axis + lane] = along


@inline
def least_before(medium, body):
    """Radius (mm) of the ball in which no face bounds a medium; infinite if none does anywhere."""
    least = inf
    for face in range(len(body.tables)):
        least = min(least, body.bounds.least[face] if body.sides.before[face] == medium else inf)
    return least


@inline
def guess_faces(rays, count, body):
    """Guess the face that each ray meets, and its radius: the nearest where it leaves the ball without faces.

    Seldom the face on which it is. A wrong guess only costs time.
    """
    in_cavity = least_before(CAVITY, body)
    in_body = least_before(BODY, body)
    for k in range(in_whole_vectors(count)):
        p = three(rays, PX + k)
        d = three(rays, DX + k)
        least = in_cavity if rays[MEDIUM + k] == CAVITY else in_body
        ahead = add_scaled(p, path_to_ball(dot(p, d), dot(p, p), least), d)
        mark_node(rays, k, ahead, float(len(body.tables[0])), body.grid)
        rays[RADIUS + k] = inf
    for face in range(len(body.tables)):
        medium = body.sides.before[face]
        table = body.tables[face]
        for k in range(count):
            if rays[MEDIUM + k] == medium:
                radius = nodal(table, rays, k)
                radius = radius if rays[LAST + k] != face else 1e6 * radius
                rays[GUESS + k] = float(face) if radius < rays[RADIUS + k] else rays[GUESS + k]
                rays[RADIUS + k] = min(rays[RADIUS + k], radius)


@inline
def search_quickly(rays, count, face, body):
    """Search the guessed face for rays that do not start on it; undecided rays are left pending."""
    table = body.tables[face]
    bounds = bounds_of(body.bounds, face)
    grid = body.grid
    going = NONE_YET
    ball = body.bounds.balls[face]
    hollow = body.bounds.hollows[face]
    for k in range(count):
        if rays[GUESS + k] == face:
            rays[PENDING + k] = 1.0
            p = three(rays, PX + k)
            if rays[LAST + k] != face and dot(p, p) < ball * ball:
                rays[NUMBER + going] = float(k)
                rays[ASKED + going] = float(k)
                rays[R + going] = rays[RADIUS + k]
                write(rays, X0 + going, p)
                write(rays, ALONG_X + going, three(rays, DX + k))
                going += 1
    if going > 0:
        start_quick(rays, going, table, grid, bounds.least, ball)
        quick_hits(rays, going, table, grid, ball)
    for lane in range(going):
        k = int(rays[ASKED + lane])
        p = three(rays, PX + k)
        d = three(rays, DX + k)
        t = rays[LENGTH + k]
        if rays[STATUS + k] == FOUND and is_first(p, d, t, table, bounds, ball, hollow, grid):
            rays[NEXT_STATUS + k] = FOUND
            rays[NEXT + k] = t
            rays[FACE + k] = float(face)
            rays[PENDING + k] = 0.0
            rays[NEXT_X + k] = rays[RHO_X + k]
            rays[NEXT_Y + k] = rays[RHO_Y + k]


@inline
def start_inside(rays, count, face, guessed, body):
    """Start rays in the medium before a face on their search for it: where it was ``guessed``, or elsewhere.

    Returns their number.
    """
    going = NONE_YET
    medium = body.sides.before[face]
    hollow = body.bounds.hollows[face]
    table = body.tables[face]
    bounds = bounds_of(body.bounds, face)
    for k in range(count):
        if rays[MEDIUM + k] == medium and (rays[GUESS + k] == face) == guessed:
            is_pending = rays[PENDING + k] == 1.0
            if not guessed:
                p = three(rays, PX + k)
                d = three(rays, DX + k)
                starts_on = rays[LAST + k] == face
                is_pending = rays[NEXT_STATUS + k] != FOUND or not clear_ahead(
                    p, d, rays[NEXT + k], starts_on, table, bounds, hollow, body.grid
                )
            if is_pending:
                start_one(rays, going, k, float(face), 0.0, rays[NEXT + k])
                going += 1
    return going


@inline
def start_outside(rays, count, face, body):
    """Start rays in the body that are outside a face of the cavity, where they have been followed.

    Returns their number.
    """
    going = NONE_YET
    for k in range(count):
        if rays[BACK_STATUS + k] != GOING or rays[BACK_FACE + k] == face:
            continue
        path = rays[BACK + k]
        x, y, z = add_scaled(three(rays, PX + k), path, three(rays, DX + k))
        r = sqrt(x * x + y * y + z * z)
        outside = path == 0.0 and rays[LAST + k] == face
        if outside or r > jet(body.tables[face], body.grid, x / (r + z), y / (r + z))[0]:
            start_one(rays, going, k, float(face), path, rays[BACK_END + k])
            going += 1
    return going


@inline
def keep_entry(rays, going, face):
    """Advance the rays that searched their entry into one face of the cavity; others never enter it."""
    for lane in range(going):
        k = int(rays[ASKED + lane])
        rays[BACK + k] += rays[LENGTH + k]
        if rays[STATUS + k] == FOUND:
            rays[BACK_FACE + k] = face
            rays[BACK_X + k] = rays[RHO_X + k]
            rays[BACK_Y + k] = rays[RHO_Y + k]
        else:
            rays[BACK_STATUS + k] = rays[STATUS + k]


@inline
def is_wall_of_cavity(face, sides):
    """True for a face with the cavity before it and the body behind."""
    return sides.before[face] == CAVITY and sides.behind[face] == BODY


@inline
def leaves_cavity(rays, k, length, body):
    """Tell whether ray k of the packet is outside of one face of the cavity up to the path ``length``."""
    p = three(rays, PX + k)
    d = three(rays, DX + k)
    last = int(rays[LAST + k])
    bounds = body.bounds
    if last >= 0 and body.sides.before[last] == CAVITY:
        return stays_outside(p, d, length, 1.0, rays[LEAVING + k], bounds.least[last], bounds.hollows[last])
    chosen = -1
    least = inf
    mark_node(rays, k, p, float(len(body.tables[0])), body.grid)
    for face in range(len(body.tables)):
        if is_wall_of_cavity(face, body.sides):
            radius = nodal(body.tables[face], rays, k)
            chosen, least = (face, radius) if radius < least else (chosen, least)
    if chosen < 0:
        return False
    value, slope = gauge_along(body.tables[chosen], body.grid, p, d)
    return stays_outside(p, d, length, value, slope, bounds.least[chosen], bounds.hollows[chosen])


@inline
def back_into_cavity(rays, count, body):
    """Re-entry of rays in the body into the cavity, the intersection of the insides of its faces.

    A ray that is outside of one of them is followed to where it enters that one, until it is in all: it cannot have
    been in the cavity before. Crossings nearer than the face that bounds the body are kept. No ray comes back but in
    the ball in which the cavity lies.
    """
    ball = inf
    for face in range(len(body.tables)):
        if is_wall_of_cavity(face, body.sides):
            ball = min(ball, body.bounds.balls[face])
    for k in range(in_whole_vectors(count)):
        p = three(rays, PX + k)
        outward = dot(p, three(rays, DX + k))
        square = outward * outward + ball * ball - dot(p, p)
        root = sqrt(max(square, 0.0))
        comes_back = rays[MEDIUM + k] == BODY and square > 0.0 and root > outward and -outward - root < rays[NEXT + k]
        rays[BACK_STATUS + k] = GOING if comes_back else MISSED
        rays[BACK_END + k] = min(root - outward, rays[NEXT + k])
        rays[BACK + k] = 0.0
        rays[BACK_FACE + k] = -1.0
    for k in range(count):
        if rays[BACK_STATUS + k] == GOING and leaves_cavity(rays, k, rays[BACK_END + k], body):
            rays[BACK_STATUS + k] = MISSED
    moved = 1
    for _ in range(_PASSES):
        if moved == 0:
            break
        moved = 0
        for face in range(len(body.tables)):
            if is_wall_of_cavity(face, body.sides):
                going = start_outside(rays, count, face, body)
                if going > 0:
                    first_hits(rays, going, body.tables[face], body.grid, bounds_of(body.bounds, face), True, True)
                    keep_entry(rays, going, float(face))
                    moved += going
    for k in range(count):
        status = rays[BACK_STATUS + k]
        if status == LOST or (status == GOING and moved > 0):
            rays[NEXT_STATUS + k] = LOST
            continue
        entered = status == GOING and rays[BACK_FACE + k] >= 0.0 and rays[NEXT_STATUS + k] != LOST
        if entered and rays[BACK + k] < rays[NEXT + k]:
            rays[NEXT_STATUS + k] = FOUND
            rays[NEXT + k] = rays[BACK + k]
            rays[FACE + k] = rays[BACK_FACE + k]
            rays[NEXT_X + k] = rays[BACK_X + k]
            rays[NEXT_Y + k] = rays[BACK_Y + k]


@inline
def meet_nearest(rays, count, body):
    """The nearest crossing, for each ray of a packet, with the faces that bound its medium."""
    for k in range(count):
        rays[NEXT + k] = inf
        rays[NEXT_STATUS + k] = MISSED
        rays[FACE + k] = -1.0
    faces = len(body.tables)
    guess_faces(rays, count, body)
    for place_of in range(2 * faces):
        guessed = place_of < faces
        face = place_of % faces
        if guessed:
            search_quickly(rays, count, face, body)
        going = start_inside(rays, count, face, guessed, body)
        if going > 0:
            first_hits(rays, going, body.tables[face], body.grid, bounds_of(body.bounds, face), True, False)
            keep_nearest(rays, going, float(face))
    back_into_cavity(rays, count, body)
