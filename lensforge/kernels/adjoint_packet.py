"""A packet of rays of the adjoint: what is kept of each, at each of its events and behind the last; shared steps.

Fields of the packet have room for ``SIZE`` rays each, as in ``kernels.ray_packet``. What belongs to an event lies in a
block of its own, so that both events of a double-freeform lens are at hand without a copy.

Differentiating ``|p| = rho`` at a hit gives Eq. (9) of the paper; the change of the normal with the hit needs the
Hessian of ``|p| - rho``, contracted with one vector. Both are exact for the table.
"""

from math import sqrt
from typing import NamedTuple

from lensforge.kernels.bicubic import scatter
from lensforge.kernels.compiled import inline
from lensforge.kernels.drawn_faces import across
from lensforge.kernels.facet_normals import drawn_slope, facet_normal, facet_normal_adjoint, note_incidence
from lensforge.kernels.fresnel import outward_normal, reflect_adjoint, refract_adjoint
from lensforge.kernels.ray_packet import (
    COEFFICIENTS,
    SIZE,
    fetch_table,
    fields,
    in_whole_vectors,
    jet_at,
    mark_hit,
    three,
    write,
)
from lensforge.kernels.seen_slopes import CELL as SEEN_CELL
from lensforge.kernels.seen_slopes import SEEN_FIELDS, added_slope
from lensforge.kernels.vectors import add_scaled, dot, scaled

# A ray's number; sensitivities to its point and direction, first behind the body and then ever nearer to its start,
# to its flux, that along z and the squared exit sine; whether it left the lens; the flux emitted; the share of it
# that absorption leaves; the absorption; by how much more of a path in the body the number that is differentiated
# grows; whether the ray has a derivative at all.
(
    RAY, EX, EY, EZ, FX, FY, FZ, BY_FLUX, BY_AXIAL, BY_SIN2, LEFT, EMITTED, CLEAR, ABSORPTION, BY_PATH, SMOOTH,
) = fields(COEFFICIENTS, 16)  # fmt: skip
# At an event, from the start of its block: hit and direction before it, path, index ratio, the table's cell and five
# derivatives, sensitivities to the table's value and slopes, and the facet: its slopes, what is seen beyond these, and
# the derivatives of that.
P, _, _, D, _, _, PATH, INDEX_RATIO, CELL, _, _, _, JET, _, _, _, _, BY_TABLE, _, _, FACET, _, _, _, _ = fields(0, 25)
BLOCK = 25
SEEN = fields(COEFFICIENTS + 16, SEEN_FIELDS)[0]  # while it is found what light sees of facets
_OF_RAY = COEFFICIENTS + 16 + SEEN_FIELDS
FIRST_EVENT, SECOND_EVENT = fields(_OF_RAY, 2 * BLOCK)[::BLOCK]
OF_POLARISATION = _OF_RAY + 2 * BLOCK  # what follows is that of the polarisation


class MetFace(NamedTuple):
    """An event of all rays of a packet.

    Its number and face, the number of earlier hits of that face, 1 for rays from before the face and -1 from behind,
    whether it reflects them, and the media.
    """

    event: int
    face: int
    times: int
    side: float
    mirrored: bool
    medium: int
    behind: int


class Hit(NamedTuple):
    """A ray at an event: number, index ratio, hit, direction before, the table's derivatives, and normals.

    The latter are one away from the origin, and one along the ray, tilted by roughness.
    """

    number: int
    ratio: float
    p: tuple[float, float, float]
    d: tuple[float, float, float]
    jet: tuple[float, float, float, float, float]
    normal: tuple[float, float, float]
    tilted: tuple[float, float, float]


class ByEvent(NamedTuple):
    """Sensitivities to a hit and to the direction behind it, beside these to cosine, unit normal and direction before.

    And to the path there, for absorption.
    """

    hit: tuple[float, float, float]
    direction: tuple[float, float, float]
    cosine: float
    normal: tuple[float, float, float]
    direction_before: tuple[float, float, float]
    path: float


@inline
def move_to_face(packet, count, at, table, grid):
    """Move all rays to the face of an event, whose block begins ``at``, and find the table's cells there."""
    side = float(len(table))
    for k in range(count):
        p = add_scaled(three(packet, at + P + k), packet[at + PATH + k], three(packet, at + D + k))
        write(packet, at + P + k, p)
        mark_hit(packet, k, across(p, grid.half_mm), at + CELL, side, grid)


@inline
def take_jets(packet, count, at, grid):
    """Derivatives of the table at all hits, whose coefficients have been fetched."""
    inverse_step = grid.inverse_step
    for k in range(count):
        share_x, share_y = packet[at + CELL + 2 * SIZE + k], packet[at + CELL + 3 * SIZE + k]
        jet = jet_at(packet, k, share_x, share_y, inverse_step)
        slopes = across(jet[:2] + jet[:1], grid.half_mm)
        write(packet, at + JET + k, (slopes[0], slopes[1], jet[2]))
        write(packet, at + JET + 2 * SIZE + k, jet[2:])


@inline
def jet_of(packet, place):
    """The five derivatives of the table at a hit."""
    x, y, xx = three(packet, place)
    _, xy, yy = three(packet, place + 2 * SIZE)
    return x, y, xx, xy, yy


@inline
def fetch_facets(packet, count, at, face, noise, keys, body):
    """The facets that all rays meet at an event, at whose hits they are."""
    if noise is not None:  # known to the compiler
        if body.slopes[face.face] > 0.0:
            rms = body.slopes[face.face]
            whole = in_whole_vectors(count)
            for k in range(count):
                x, y = drawn_slope(int(packet[RAY + k]), face.face, face.times, noise, keys, body.slopes)
                packet[at + FACET + k] = x
                packet[at + FACET + SIZE + k] = y
            for k in range(whole):
                jet = jet_of(packet, at + JET + k)
                normal = outward_normal(across(three(packet, at + P + k), body.grid.half_mm), jet[0], jet[1])
                note_incidence(packet, SEEN, k, at + FACET, rms, normal, three(packet, at + D + k))
            fetch_table(packet, count, body.seen, SEEN + SEEN_CELL)
            for k in range(whole):
                write(packet, at + FACET + 2 * SIZE + k, added_slope(packet, SEEN, k))
        else:
            for k in range(in_whole_vectors(count)):
                write(packet, at + FACET + k, (0.0, 0.0, 0.0))
                packet[at + FACET + 3 * SIZE + k] = 0.0
                packet[at + FACET + 4 * SIZE + k] = 0.0


@inline
def hit_at(packet, k, at, face, rays, grid):
    """The hit of ray k of the packet at an event, as a :class:`Hit`."""
    number = int(packet[RAY + k])
    ratio = packet[at + INDEX_RATIO + k]
    p = three(packet, at + P + k)
    d = three(packet, at + D + k)
    jet = jet_of(packet, at + JET + k)
    normal = outward_normal(across(p, grid.half_mm), jet[0], jet[1])
    tilted = facet_normal(packet, at + FACET + k, normal, d, rays.noise)
    return Hit(number, ratio, p, d, jet, normal, scaled(face.side, tilted))


@inline
def hessian_times(p, v, jet):
    """Hessian of ``|p| - rho`` times v, and the sensitivities of ``v . normal`` to the slopes of the table."""
    x, y, z = p
    vx, vy, vz = v
    rho_x, rho_y, xx, xy, yy = jet
    r = sqrt(x * x + y * y + z * z)
    ux, uy, uz = x / r, y / r, z / r
    shift = r + z
    X = x / shift
    Y = y / shift
    gx, gy, gz = ux, uy, uz + 1.0  # gradient of shift
    ax, ay, az = (1.0 - X * gx) / shift, -X * gy / shift, -X * gz / shift  # gradient of X
    bx, by, bz = -Y * gx / shift, (1.0 - Y * gy) / shift, -Y * gz / shift  # gradient of Y
    radial = ux * vx + uy * vy + uz * vz
    hx, hy, hz = (vx - ux * radial) / r, (vy - uy * radial) / r, (vz - uz * radial) / r  # Hessian of |p| times v
    av = ax * vx + ay * vy + az * vz
    bv = bx * vx + by * vy + bz * vz
    gv = gx * vx + gy * vy + gz * vz
    # Hessian of X times v = -(av g + X h + gv a) / shift, and likewise for Y.
    to_a = -(xx * av + xy * bv) + rho_x * gv / shift
    to_b = -(xy * av + yy * bv) + rho_y * gv / shift
    to_g = (rho_x * av + rho_y * bv) / shift
    to_h = 1.0 + (rho_x * X + rho_y * Y) / shift
    product = (
        to_h * hx + to_a * ax + to_b * bx + to_g * gx,
        to_h * hy + to_a * ay + to_b * by + to_g * gy,
        to_h * hz + to_a * az + to_b * bz + to_g * gz,
    )
    return product, -av, -bv


@inline
def hit_adjoint(p, d, n, e, m, jet):
    """Adjoint of a hit p and its normal n: from sensitivities to p (e) and to n (m) to those of the ray's start.

    That to the direction is the path length times it. Then come the sensitivities to the table's value and slopes at
    the hit.
    """
    h, by_slope_x, by_slope_y = hessian_times(p, m, jet)
    e = e[0] + h[0], e[1] + h[1], e[2] + h[2]
    by_radius = dot(e, d) / dot(n, d)
    return add_scaled(e, -by_radius, n), (by_radius, by_slope_x, by_slope_y)


@inline
def back_to_ray(packet, k, at, face, hit, by, rays, grid):
    """Sensitivities to start and direction of a ray before an event from those ``by`` it; fills that to the table."""
    if face.mirrored:
        f, h = reflect_adjoint(hit.d, hit.tilted, by.direction, by.cosine, by.normal)
    else:
        f, h = refract_adjoint(hit.d, hit.tilted, hit.ratio, by.direction, by.cosine, by.normal)
    f = add_scaled(f, 1.0, by.direction_before)
    h, f = facet_normal_adjoint(packet, at + FACET + k, hit.normal, hit.d, rays.noise, scaled(face.side, h), f)
    e = add_scaled(by.hit, by.path, hit.d)
    e, by_table = hit_adjoint(across(hit.p, grid.half_mm), hit.d, hit.normal, e, across(h, grid.half_mm), hit.jet)
    f = add_scaled(f, packet[at + PATH + k], e)
    smooth = packet[SMOOTH + k] == 1.0
    by_table = by_table[0] if smooth else 0.0, by_table[1] if smooth else 0.0, by_table[2] if smooth else 0.0
    write(packet, at + BY_TABLE + k, by_table)
    return add_scaled(e, -by.path, hit.d), f


@inline
def add_to_table(packet, count, at, inverse_step, gradient):
    """Add the sensitivities of all rays to those of the coefficients that acted at an event."""
    for k in range(count):
        row, column, share_x = three(packet, at + CELL + k)
        cell = row, column, share_x, packet[at + CELL + 3 * SIZE + k]
        scatter(gradient, cell, inverse_step, three(packet, at + BY_TABLE + k))
