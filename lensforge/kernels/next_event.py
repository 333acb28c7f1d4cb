"""Events: rays go from the faces that they meet out of the body, on to their next face, or nowhere, with a fate.

A mirror reflects its share and absorbs the rest, a flange ends the ray, any other face reflects what total reflection
leaves no other way. What a face reflects beside the light that passes is not followed; what the last event left is the
flux of the ray, whatever its fate.
"""

from math import exp

from lensforge.kernels.bicubic import bounds_of
from lensforge.kernels.compiled import NONE_YET, inline
from lensforge.kernels.drawn_faces import across, is_past_end
from lensforge.kernels.entry import entry
from lensforge.kernels.fate import Fate
from lensforge.kernels.first_hit import FOUND, LOST
from lensforge.kernels.frames import out_of_faces, to_next_face, turned_between
from lensforge.kernels.fresnel import outward_normal
from lensforge.kernels.nearest_face import CLEAR, FACE, FIELDS, LAST, LEAVING, MEDIUM, SIDE
from lensforge.kernels.polarised_event import behind_face, keep_axial, keep_fields
from lensforge.kernels.ray_packet import (
    BEHIND,
    COSINE,
    DX,
    DZ,
    EXCESS,
    LENGTH,
    MX,
    PX,
    RAY,
    RHO_X,
    RHO_Y,
    SIZE,
    STATUS,
    T_P,
    T_S,
    store_ray,
    three,
    write,
)
from lensforge.kernels.ring_scatter import spread_behind
from lensforge.kernels.traced_body import BODY, CAVITY, FROM_BEHIND, OUTSIDE, REFLECTED, own_or_shared, times_met
from lensforge.kernels.vectors import dot, length_of


@inline
def in_order(balls):
    """True where faces are met in their order; known to the compiler."""
    return balls is None


@inline
def face_and_media(packet, lane, event, sides):
    """The face that a ray meets, and the media before and behind it on its way."""
    if sides is None:
        return event, event, event + 1
    face = int(packet[FACE + lane])
    behind = sides.behind[face] if packet[SIDE + lane] > 0.0 else sides.before[face]
    return face, int(packet[MEDIUM + lane]), int(behind)


@inline
def lost_fate(status, medium, dz, path, ordered):
    """Fate of a ray that meets no face at z >= 0; ``path``: how far it was followed (mm)."""
    if status == LOST:
        return Fate.SURFACES_INTERSECT if ordered and medium == BODY and path == 0.0 else Fate.NOT_CONVERGED
    return Fate.BACKWARD if medium == CAVITY and dz <= 0.0 else Fate.BASE


@inline
def share_of_mirror(sides, face):
    """Reflectance of the mirror on a face; negative without one."""
    return -1.0 if sides is None else sides.mirrors[face]


@inline
def is_side_way(face, sides):
    """True for a face by which no light is meant to leave: all but the exit, the last one."""
    return False if sides is None else face + 1 < len(sides.before)


@inline
def exit_sine(face, behind, q_squared, sides):
    """Squared exit sine s, 0 within the lens; 2 - s at a face that is to reflect: the farther from that, the larger."""
    if behind != OUTSIDE:
        return 0.0
    return 1.0 + q_squared if is_side_way(face, sides) else 1.0 - q_squared


@inline
def keep_met(met, packet, lane, event, face, mirrored):
    """Store the face that a ray met at an event, if stored at all."""
    if met is not None:
        from_behind = packet[SIDE + lane] < 0.0
        code = 4 * face + (REFLECTED if mirrored else 0) + (FROM_BEHIND if from_behind else 0)
        met[int(packet[RAY + lane]), event] = code


@inline
def absorb(packet, lane, path, rays, exits):
    """Subtract absorption on a ``path`` (mm) in the body from the flux of a ray."""
    if len(rays.absorptions) > 0:
        k = int(packet[RAY + lane])
        clear = exp(-own_or_shared(rays.absorptions, k) * path)
        arrived = exits.flux[k] * clear
        exits.absorbed[k] += exits.flux[k] - arrived
        exits.flux[k] = arrived
        packet[CLEAR + lane] *= clear


@inline
def leave(packet, lane, arrived, rays, body, exits):
    """Store a ray behind the body, in the frame of the receivers; ``arrived``: flux (W) at the last face."""
    k = int(packet[RAY + lane])
    keep_axial(packet, lane, arrived, rays, body, exits.axial, body.sides)
    keep_fields(packet, lane, body.placement, exits.fields)
    p, b = out_of_faces(body.placement, three(packet, PX + lane), three(packet, DX + lane))
    exits.points[k, 0], exits.points[k, 1], exits.points[k, 2] = p
    exits.directions[k, 0], exits.directions[k, 1], exits.directions[k, 2] = b


@inline
def from_the_rim(p, d, face, body, placement):
    """Path (mm) to the end plane of a face, for a ray below it; negative if the ray misses the opening.

    At the rim a ray may be below that plane if the face stands lower than the one before, or is tilted.
    """
    if placement is None:
        return 0.0
    if p[2] >= 0.0:
        return 0.0
    fate, start = entry(p, d, body.tables[face], body.grid, bounds_of(body.bounds, face))
    return start if fate == Fate.LEFT_LENS else -1.0


@inline
def carry_on(packet, lane, going, placement, sides):
    """Move the polarisation state of a ray from its lane to that of its next event."""
    if sides is None:
        write(packet, MX + going, turned_between(placement, three(packet, MX + lane)))
        packet[T_S + going] = packet[T_S + lane]
        packet[T_P + going] = packet[T_P + lane]
        packet[EXCESS + going] = packet[EXCESS + lane]
    else:
        packet[CLEAR + going] = packet[CLEAR + lane]
        for first in range(FIELDS, FIELDS + 12 * SIZE, 3 * SIZE):
            write(packet, first + going, turned_between(placement, three(packet, first + lane)))


@inline
def to_outer(packet, lane, going, rays, body):
    """Send a ray from the inner to the outer one of two faces.

    Returns its path so far (mm); negative if it does not reach that face's inside.
    """
    k = int(packet[RAY + lane])
    p, d = to_next_face(body.placement, three(packet, PX + lane), three(packet, DX + lane))
    start = from_the_rim(p, d, 1, body, body.placement)
    if start < 0.0:
        return start
    if p[2] < 0.0:
        p = p[0] + start * d[0], p[1] + start * d[1], 0.0
    carry_on(packet, lane, going, body.placement, body.sides)
    store_ray(packet, going, k, p, d, own_or_shared(rays.indices, k) / body.outside_index)
    return start


@inline
def to_nearest(packet, lane, going, face, medium, rays, body):
    """Send a ray from a ``face`` to the nearest one that bounds its ``medium``.

    Returns 0; negative if a facet sends it to the other side of its face, which is followed no further.
    """
    p = three(packet, PX + lane)
    d = three(packet, DX + lane)
    leaving = packet[LEAVING + lane]
    if rays.shifts is not None:  # spread behind the face
        flat = across(p, body.grid.half_mm)
        leaving = dot(outward_normal(flat, packet[RHO_X + lane], packet[RHO_Y + lane]), d) / length_of(flat)
    packet[MEDIUM + going] = medium
    packet[LAST + going] = float(face)
    packet[LEAVING + going] = leaving
    carry_on(packet, lane, going, None, body.sides)
    store_ray(packet, going, int(packet[RAY + lane]), p, d, 1.0)
    return -1.0 if rays.noise is not None and (leaving > 0.0) != (body.sides.behind[face] == medium) else 0.0


@inline
def to_next_event(packet, lane, going, face, medium, rays, body, balls):
    """Send a ray from a ``face`` to its next one.

    Returns its path so far (mm); negative if it does not reach that one's inside.
    """
    if balls is None:  # known to the compiler
        return to_outer(packet, lane, going, rays, body)
    return to_nearest(packet, lane, going, face, medium, rays, body)


@inline
def pass_on(packet, count, event, rays, body, ways, exits):
    """Pass the rays of a packet through the faces at which they are. Returns the number of those that continue."""
    going = NONE_YET
    last = event + 1 == ways.lengths.shape[1]
    ordered = in_order(body.bounds.balls)
    for lane in range(count):
        k = int(packet[RAY + lane])
        status = packet[STATUS + lane]
        z = packet[PX + 2 * SIZE + lane]
        face, medium, behind = face_and_media(packet, lane, event, body.sides)
        path = ways.lengths[k, event] + packet[LENGTH + lane]
        ways.lengths[k, event] = path
        if status != FOUND or z < 0.0:
            exits.fates[k] = lost_fate(status, medium, packet[DZ + lane], path, ordered)
            continue
        mirror = share_of_mirror(body.sides, face)
        if mirror == 0.0:
            keep_met(ways.met, packet, lane, event, face, True)
            exits.fates[k] = Fate.FLANGE
            exits.sin2_exit[k] = 0.0
            continue
        if medium == BODY:
            absorb(packet, lane, path, rays, exits)
        exits.sin2_exit[k] = 0.0 if mirror >= 0.0 else exit_sine(face, behind, packet[BEHIND + lane], body.sides)
        if packet[COSINE + lane] <= 0.0:  # tangent, to the last bit
            exits.fates[k] = Fate.TOTAL_REFLECTION
            continue
        arrived = exits.flux[k]
        mirrored, flux = behind_face(packet, lane, arrived, rays, body, body.sides)
        keep_met(ways.met, packet, lane, event, face, mirrored)
        if not mirrored or mirror >= 0.0:
            times = times_met(ways.met, k, event, face)
            spread_behind(packet, lane, face, mirrored, times, rays.shifts, rays.keys, body.sides)
        exits.flux[k] = flux
        if mirror > 0.0:
            exits.absorbed[k] += arrived * (1.0 - mirror)
        if behind == OUTSIDE and not mirrored and is_past_end(packet[PX + SIZE + lane], body.grid.half_mm):
            exits.fates[k] = Fate.FLANGE
            exits.flux[k] = arrived
            exits.sin2_exit[k] = 0.0
        elif behind == OUTSIDE and not mirrored:
            leave(packet, lane, arrived, rays, body, exits)
        elif last or (mirrored and ordered):
            exits.fates[k] = Fate.TOTAL_REFLECTION if mirrored and mirror < 0.0 else Fate.EVENT_LIMIT
        else:
            entered = medium if mirrored else behind
            start = to_next_event(packet, lane, going, face, entered, rays, body, body.bounds.balls)
            if start < 0.0:
                exits.fates[k] = Fate.BASE if ordered else Fate.EVENT_LIMIT
                continue
            ways.lengths[k, event + 1] = start
            going += 1
    return going
