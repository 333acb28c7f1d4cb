"""Tracing: rays from face to face and out of the body, packet by packet; see ``kernels.ray_packet``.

An event is what happens where a ray meets a face: it is refracted, or reflected. This loop has all bodies; what the
compiler knows of one, such as that its faces are met in their order, takes the rest of the code out of its kernel.
Path lengths and faces that were met are kept, so that the adjoint need not search again.
"""

from lensforge.kernels.bicubic import bounds_of
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.drawn_faces import become_rays, become_shadows, from_shadows, shadows
from lensforge.kernels.entry import enter
from lensforge.kernels.first_hit import FOUND, first_hits, start_all
from lensforge.kernels.nearest_face import FACE, MEDIUM, NEXT, NEXT_STATUS, NEXT_X, NEXT_Y, SIDE, meet_nearest
from lensforge.kernels.next_event import pass_on
from lensforge.kernels.polarised_event import refract_all
from lensforge.kernels.ray_packet import LENGTH, RATIO, RAY, RHO_X, RHO_Y, SIZE, STATUS
from lensforge.kernels.traced_body import index_in


@inline
def choose_nearest(packet, count, rays, body):
    """Adopt the crossing that :func:`meet_nearest` found for each ray, with the media on both sides."""
    for lane in range(count):
        is_met = packet[NEXT_STATUS + lane] == FOUND
        face = int(packet[FACE + lane])
        medium = packet[MEDIUM + lane]
        packet[STATUS + lane] = packet[NEXT_STATUS + lane]
        packet[LENGTH + lane] = packet[NEXT + lane] if is_met else 0.0
        packet[RHO_X + lane] = packet[NEXT_X + lane]
        packet[RHO_Y + lane] = packet[NEXT_Y + lane]
        if is_met:
            k = int(packet[RAY + lane])
            before = body.sides.before[face]
            behind = body.sides.behind[face]
            packet[SIDE + lane] = 1.0 if medium == before else -1.0
            medium_behind = behind if medium == before else before
            packet[RATIO + lane] = index_in(medium, k, rays, body) / index_in(medium_behind, k, rays, body)


@inline
def note_order(packet, count, event, sides):
    """Set the next face of all rays, the medium before it and the side, if faces are met in order."""
    if sides is not None:
        for lane in range(count):
            packet[FACE + lane] = float(event)
            packet[MEDIUM + lane] = float(event)
            packet[SIDE + lane] = 1.0


@inline
def meet(packet, count, event, rays, body, balls):
    """Find the crossing of each ray of a packet with the face that it meets."""
    if balls is None:  # known to the compiler
        going = start_all(packet, count)
        shadows(packet, going, body.grid.half_mm)
        first_hits(packet, going, body.tables[event], body.grid, bounds_of(body.bounds, event), False, False)
        from_shadows(packet, count, body.grid.half_mm)
        note_order(packet, count, event, body.sides)
    else:
        become_shadows(packet, count, body.grid.half_mm)
        meet_nearest(packet, count, body)
        become_rays(packet, count, body.grid.half_mm)
        choose_nearest(packet, count, rays, body)


@kernel
def trace(rays, body, ways, exits, packet):
    """Trace ``rays`` (``RaysIn``) through a ``body`` (``TracedBody``): fills ``ways`` and ``exits`` (``RaysOut``).

    Rays whose fate in ``exits`` is another one than ``LEFT_LENS`` have ended before. ``packet``: memory of a packet.
    """
    for first in range(0, len(rays.emitted), SIZE):
        last = min(first + SIZE, len(rays.emitted))
        for k in range(first, last):
            exits.flux[k] = rays.emitted[k]
            exits.sin2_exit[k] = 0.0
            ways.lengths[k, :] = 0.0
        count = enter(rays, first, last, body, ways, exits.fates, packet)
        for event in range(ways.lengths.shape[1]):
            meet(packet, count, event, rays, body, body.bounds.balls)
            refract_all(packet, count, event, rays, body, ways, exits, body.sides)
            count = pass_on(packet, count, event, rays, body, ways, exits)
