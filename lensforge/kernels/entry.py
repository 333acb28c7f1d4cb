"""Entry of rays into a body: into the cavity, from above the plane in which it ends, or through its opening there."""

from math import sqrt

from lensforge.kernels.bicubic import bounds_of, jet, tile_of
from lensforge.kernels.compiled import inline
from lensforge.kernels.drawn_faces import across
from lensforge.kernels.fate import Fate
from lensforge.kernels.fields import unpolarised
from lensforge.kernels.frames import INTO, into_faces, turned
from lensforge.kernels.nearest_face import CLEAR, FIELDS, LAST, MEDIUM
from lensforge.kernels.ray_packet import SIZE, store_ray, write
from lensforge.kernels.traced_body import CAVITY, own_or_shared
from lensforge.kernels.vectors import scaled


@inline
def entry(p, d, table, grid, bounds):
    """Entry of a ray into the cavity: its fate, and the path (mm) to z = 0 if it starts below.

    The fate is ``LEFT_LENS`` for a ray that enters.
    """
    if d[2] <= 0.0 and not p[2] > 0.0:
        return Fate.BACKWARD, 0.0
    start = -p[2] / d[2] if p[2] < 0.0 else 0.0
    x, y, z = across((p[0] + start * d[0], p[1] + start * d[1], max(p[2], 0.0)), grid.half_mm)
    r = sqrt(x * x + y * y + z * z)
    if not r <= bounds.most:  # in this form also where x is NaN
        return Fate.OUTSIDE_CAVITY, start
    X = x / (r + z)
    Y = y / (r + z)
    near = r >= bounds.least and r >= tile_of(X, Y, grid, bounds)[0]
    if near and r >= jet(table, grid, X, Y)[0]:
        return Fate.OUTSIDE_CAVITY, start
    return Fate.LEFT_LENS, start


@inline
def entry_of_all(p, d, body, sides):
    """:func:`entry` into a cavity that may have several faces."""
    fate, start = entry(p, d, body.tables[0], body.grid, bounds_of(body.bounds, 0))
    if sides is not None:
        for face in range(1, len(body.tables)):
            if sides.before[face] == CAVITY and fate == Fate.LEFT_LENS:
                fate, start = entry(p, d, body.tables[face], body.grid, bounds_of(body.bounds, face))
    return fate, start


@inline
def begin_fields(packet, lane, k, d, fields, placement, sides):
    """Set the fields of ray k as it enters the cavity, in this lane of the packet, if they are followed."""
    if sides is not None:
        packet[MEDIUM + lane] = CAVITY
        packet[LAST + lane] = -1.0
        packet[CLEAR + lane] = 1.0
        if len(fields) > 0:
            for part in range(0, 12, 3):
                local = turned(placement, INTO, (fields[k, part], fields[k, part + 1], fields[k, part + 2]))
                write(packet, FIELDS + part * SIZE + lane, local)
        else:
            first, second = unpolarised(d)
            write(packet, FIELDS + lane, first)
            write(packet, FIELDS + 3 * SIZE + lane, scaled(0.0, first))
            write(packet, FIELDS + 6 * SIZE + lane, second)
            write(packet, FIELDS + 9 * SIZE + lane, scaled(0.0, first))


@inline
def enter(rays, first, last, body, ways, fates, packet):
    """Put the rays ``first`` to ``last`` that enter the cavity into a packet. Returns their number."""
    entered = 0
    for k in range(first, last):
        if fates[k] != Fate.LEFT_LENS:
            continue
        p = rays.origins[k, 0], rays.origins[k, 1], rays.origins[k, 2]
        d = rays.directions[k, 0], rays.directions[k, 1], rays.directions[k, 2]
        p, d = into_faces(body.placement, p, d)
        fates[k], start = entry_of_all(p, d, body, body.sides)
        if fates[k] == Fate.LEFT_LENS:
            ways.lengths[k, 0] = start
            p = p[0] + start * d[0], p[1] + start * d[1], max(p[2], 0.0)
            store_ray(packet, entered, k, p, d, body.cavity_index / own_or_shared(rays.indices, k))
            begin_fields(packet, entered, k, d, rays.fields, body.placement, body.sides)
            entered += 1
    return entered
