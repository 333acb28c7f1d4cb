"""Entry of rays into a body: into the cavity, from above the plane in which it ends, or through its opening there."""

from math import sqrt

from lensforge.kernels.bicubic import bounds_of, jet, tile_of
from lensforge.kernels.compiled import NONE_YET, inline
from lensforge.kernels.drawn_faces import across
from lensforge.kernels.fate import Fate
from lensforge.kernels.fields import unpolarised
from lensforge.kernels.frames import INTO, into_faces, turned
from lensforge.kernels.nearest_face import CLEAR, FIELDS, LAST, MEDIUM
from lensforge.kernels.ray_packet import DX, RAY, SIZE, in_whole_vectors, store_ray, three, write
from lensforge.kernels.traced_body import CAVITY, own_or_shared


@inline
def is_within(x, y, z, table, grid, bounds):
    """True for a point inside of a face."""
    r = sqrt(x * x + y * y + z * z)
    if not r <= bounds.most:  # in this form also where x is NaN
        return False
    if r < bounds.least:
        return True
    X = x / (r + z)
    Y = y / (r + z)
    return r < tile_of(X, Y, grid, bounds)[0] or r < jet(table, grid, X, Y)[0]


@inline
def entry(p, d, table, grid, bounds):
    """Entry of a ray into the cavity: its fate, and the path (mm) to z = 0 if it starts below.

    The fate is ``LEFT_LENS`` for a ray that enters.
    """
    if d[2] <= 0.0 and not p[2] > 0.0:
        return Fate.BACKWARD, 0.0
    start = -p[2] / d[2] if p[2] < 0.0 else 0.0
    x, y, z = across((p[0] + start * d[0], p[1] + start * d[1], max(p[2], 0.0)), grid.half_mm)
    return Fate.LEFT_LENS if is_within(x, y, z, table, grid, bounds) else Fate.OUTSIDE_CAVITY, start


@inline
def entry_of_all(p, d, body, sides):
    """:func:`entry` into a cavity that may have several faces."""
    fate, start = entry(p, d, body.tables[0], body.grid, bounds_of(body.bounds, 0))
    if sides is not None:
        x, y, z = across((p[0] + start * d[0], p[1] + start * d[1], max(p[2], 0.0)), body.grid.half_mm)
        for face in range(1, len(body.tables)):
            if sides.before[face] == CAVITY and fate == Fate.LEFT_LENS:
                within = is_within(x, y, z, body.tables[face], body.grid, bounds_of(body.bounds, face))
                fate = fate if within else Fate.OUTSIDE_CAVITY
    return fate, start


@inline
def begin_fields(packet, count, rays, placement, sides):
    """Set the fields of the rays of a packet as they enter the cavity, if they are followed."""
    if sides is not None:
        for lane in range(in_whole_vectors(count)):
            packet[MEDIUM + lane] = CAVITY
            packet[LAST + lane] = -1.0
            packet[CLEAR + lane] = 1.0
            first, second = unpolarised(three(packet, DX + lane))
            write(packet, FIELDS + lane, first)
            write(packet, FIELDS + 3 * SIZE + lane, (0.0, 0.0, 0.0))
            write(packet, FIELDS + 6 * SIZE + lane, second)
            write(packet, FIELDS + 9 * SIZE + lane, (0.0, 0.0, 0.0))
        if len(rays.fields) > 0:
            for lane in range(count):
                of_ray = rays.fields[int(packet[RAY + lane])]
                for part in range(0, 12, 3):
                    local = turned(placement, INTO, (of_ray[part], of_ray[part + 1], of_ray[part + 2]))
                    write(packet, FIELDS + part * SIZE + lane, local)


@inline
def enter(rays, first, last, body, ways, fates, packet):
    """Put the rays ``first`` to ``last`` that enter the cavity into a packet. Returns their number."""
    entered = NONE_YET
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
            entered += 1
    begin_fields(packet, entered, rays, body.placement, body.sides)
    return entered
