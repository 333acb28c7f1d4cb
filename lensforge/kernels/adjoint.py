"""Adjoint of ``trace``: a packet of rays again, forward by the paths that were kept, and backward event by event.

Rays of a double lens in unpolarised light all meet the inner face and then the outer one. Of other bodies those that
have taken the same way go together in a packet, so that here too each step is one of vectors. A ray that would meet
another face, were a face moved, has no derivative: light that so crosses a crease is left out. A ray that ends at a
tangent adds nothing: its squared sine is at its largest there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.adjoint_packet import (
    ABSORPTION,
    BY_AXIAL,
    BY_FLUX,
    BY_SIN2,
    CELL,
    EMITTED,
    EX,
    FIRST_EVENT,
    FX,
    INDEX_RATIO,
    LEFT,
    OF_POLARISATION,
    PATH,
    RAY,
    SECOND_EVENT,
    SMOOTH,
    D,
    MetFace,
    P,
    add_to_table,
    fetch_facets,
    move_to_face,
    take_jets,
)
from lensforge.kernels.compiled import NONE_YET, inline, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.fields_adjoint import (
    BY_E,
    FIELD,
    OF_FIELDS,
    E,
    absorb_on_way,
    all_amplitudes,
    back_through,
    begin_back,
    begin_forward,
    forward_at,
    from_next_frame,
    refract_all_at,
    to_next_frame,
)
from lensforge.kernels.frames import INTO, into_faces, turned_back
from lensforge.kernels.pair_adjoint import (
    back_behind_outer,
    back_through_inner,
    forward_at_inner,
    inner_face,
    outer_face,
)
from lensforge.kernels.precision import DOUBLE_PRECISION, Precision
from lensforge.kernels.ray_packet import SIZE, fetch_table, in_whole_vectors, three, write
from lensforge.kernels.traced_body import BODY, FROM_BEHIND, REFLECTED, index_in, own_or_shared, some_of

LANES = 64  # rays that go together where their events are kept: with more, these do not fit into the cache
_OF_EVENT = 17  # numbers of an event's block that are kept: all but the sensitivities
ADJOINT_NUMBERS = (OF_POLARISATION + OF_FIELDS) * SIZE


class SameWay(NamedTuple):
    """Rays sorted by their ways: their numbers, and the limits of each way among them."""

    numbers: Int[np.ndarray, " n"]
    starts: Int[np.ndarray, " w"]


class ByRaysIn(NamedTuple):
    """Sensitivities to the points, directions and fields of incoming rays, in their frame."""

    by_points: Float[np.ndarray, "n 3"]
    by_directions: Float[np.ndarray, "n 3"]
    by_fields: Float[np.ndarray, "n 12"]

    @staticmethod
    def none_of(rays: int) -> "ByRaysIn":
        """Zero sensitivities to ``rays`` rays."""
        return ByRaysIn(np.zeros((rays, 3)), np.zeros((rays, 3)), np.zeros((rays, 12)))

    def part(self, part: slice) -> "ByRaysIn":
        """Sensitivities to some of the rays."""
        return some_of(self, part)


class BodyGradients(NamedTuple):
    """Sensitivities to a body's tables, added to, and to the incoming rays; empty if not wanted."""

    by_tables: Float[np.ndarray, "f side side"]
    by_rays: ByRaysIn


class AdjointMemory(NamedTuple):
    """Memory for a packet of the adjoint, and for its events, for one thread."""

    packet: Float[np.ndarray, " k"]
    events: Float[np.ndarray, "e m"]


def adjoint_memory(events: int, precision: Precision = DOUBLE_PRECISION) -> AdjointMemory:
    """Memory for bodies of ``events`` events."""
    return AdjointMemory(np.zeros(ADJOINT_NUMBERS, precision.kind), np.zeros((events, (_OF_EVENT + 12) * LANES)))


def same_way(met: Int[np.ndarray, "n e"]) -> SameWay:
    """Rays grouped by the faces ``met``."""
    numbers = np.lexsort(met.T[::-1])
    differs = (met[numbers[1:]] != met[numbers[:-1]]).any(axis=1)
    first = [0] if len(met) else []  # no rays, no group
    return SameWay(numbers, np.concatenate([np.array(first, dtype=np.intp), np.flatnonzero(differs) + 1, [len(met)]]))


@inline
def add_gradients(packet, count, at, face, inverse_step, gradients):
    """Add the sensitivities of an event to those by the table of its face, if wanted."""
    if len(gradients) > 0:
        add_to_table(packet, count, at, inverse_step, gradients[face])


@inline
def load_axial(packet, lane, k, left, by_axial):
    """Sensitivity of a ray to its flux along z; 0 without a cover glass."""
    packet[BY_AXIAL + lane] = 0.0
    if by_axial is not None:
        packet[BY_AXIAL + lane] = by_axial[k] if left else 0.0


@inline
def asks(by_fields):
    """True if there are sensitivities to the fields."""
    return len(by_fields) > 0


@inline
def load(packet, lane, k, fate, rays, body, by):
    """Put ray k into a packet, at its start. Returns True if it contributes to any gradient."""
    left = fate == Fate.LEFT_LENS
    matters = by.by_sin2[k] != 0.0 or (left and (by.by_flux[k] != 0.0 or asks(by.by_fields)))
    for axis in range(3):
        e, f = (by.by_points[k, axis], by.by_directions[k, axis]) if left else (0.0, 0.0)
        packet[EX + axis * SIZE + lane] = e
        packet[FX + axis * SIZE + lane] = f
        matters = matters or e != 0.0 or f != 0.0
    if not matters:
        return False
    p = rays.origins[k, 0], rays.origins[k, 1], rays.origins[k, 2]
    d = rays.directions[k, 0], rays.directions[k, 1], rays.directions[k, 2]
    p, d = into_faces(body.placement, p, d)
    write(packet, FIRST_EVENT + P + lane, p)
    write(packet, FIRST_EVENT + D + lane, d)
    packet[RAY + lane] = float(k)
    packet[LEFT + lane] = 1.0 if left else 0.0
    packet[EMITTED + lane] = rays.emitted[k]
    packet[BY_FLUX + lane] = by.by_flux[k] if left else 0.0
    packet[BY_SIN2 + lane] = by.by_sin2[k]
    load_axial(packet, lane, k, left, by.by_axial)
    packet[ABSORPTION + lane] = own_or_shared(rays.absorptions, k) if len(rays.absorptions) > 0 else 0.0
    return True


@inline
def load_pairs(packet, first, last, rays, body, ways, fates, by):
    """Put the contributing rays among ``first`` to ``last`` of a double lens into a packet. Returns their number."""
    count = NONE_YET
    for k in range(first, last):
        left = fates[k] == Fate.LEFT_LENS
        if not left and not (fates[k] == Fate.TOTAL_REFLECTION and ways.lengths[k, 1] > 0.0):
            continue
        if load(packet, count, k, fates[k], rays, body, by):
            index = own_or_shared(rays.indices, k)
            packet[FIRST_EVENT + PATH + count] = ways.lengths[k, 0]
            packet[SECOND_EVENT + PATH + count] = ways.lengths[k, 1]
            packet[FIRST_EVENT + INDEX_RATIO + count] = body.cavity_index / index
            packet[SECOND_EVENT + INDEX_RATIO + count] = index / body.outside_index
            count += 1
    return count


@kernel
def adjoint_of_pairs(rays, body, ways, fates, by, gradients, packet):
    """Add every ray's contribution to the ``gradients`` by the tables of a double-freeform lens in unpolarised light.

    Arguments as in :func:`adjoint_of_ways`.
    """
    inverse_step = body.grid.inverse_step
    for first in range(0, len(rays.emitted), SIZE):
        count = load_pairs(packet, first, min(first + SIZE, len(rays.emitted)), rays, body, ways, fates, by)
        whole = in_whole_vectors(count)
        move_to_face(packet, whole, FIRST_EVENT, body.tables[0], body.grid)
        fetch_table(packet, count, body.tables[0], FIRST_EVENT + CELL)
        take_jets(packet, whole, FIRST_EVENT, body.grid)
        fetch_facets(packet, count, FIRST_EVENT, inner_face(), rays.noise, rays.keys, body)
        forward_at_inner(packet, whole, rays, body, body.films)
        move_to_face(packet, whole, SECOND_EVENT, body.tables[1], body.grid)
        fetch_table(packet, count, body.tables[1], SECOND_EVENT + CELL)
        take_jets(packet, whole, SECOND_EVENT, body.grid)
        fetch_facets(packet, count, SECOND_EVENT, outer_face(), rays.noise, rays.keys, body)
        back_behind_outer(packet, whole, rays, body, by.by_axial)
        back_through_inner(packet, whole, rays, body)
        add_to_table(packet, count, FIRST_EVENT, inverse_step, gradients[0])
        add_to_table(packet, count, SECOND_EVENT, inverse_step, gradients[1])


@inline
def met_face(event, met, sides):
    """An event of rays that have all ``met`` the same faces."""
    code = met[event]
    times = 0
    face = code // 4
    from_behind = code % 2 == FROM_BEHIND
    mirrored = code % 4 >= REFLECTED
    for earlier in range(event):
        times += 1 if met[earlier] // 4 == face else 0
    before = int(sides.before[face])
    behind = int(sides.behind[face])
    if from_behind:
        return MetFace(event, face, times, -1.0, mirrored, behind, before)
    return MetFace(event, face, times, 1.0, mirrored, before, behind)


@inline
def load_way(packet, numbers, fates, events, rays, body, ways, by):
    """Put the contributing rays among ``numbers`` into a packet: they left, or ended at their last event.

    Returns their number.
    """
    count = NONE_YET
    for k in numbers:
        ended = fates[k] == Fate.TOTAL_REFLECTION and events == ways.lengths.shape[1]
        if (fates[k] == Fate.LEFT_LENS or ended) and load(packet, count, k, fates[k], rays, body, by):
            count += 1
    return count


@inline
def on_to_event(packet, count, face, rays, body, ways):
    """Move all rays to the face of their next event."""
    at = FIRST_EVENT
    table = body.tables[face.face]
    for lane in range(count):
        k = int(packet[RAY + lane])
        packet[at + PATH + lane] = ways.lengths[k, face.event]
        packet[at + INDEX_RATIO + lane] = index_in(face.medium, k, rays, body) / index_in(face.behind, k, rays, body)
    whole = in_whole_vectors(count)
    if face.medium == BODY and len(rays.absorptions) > 0:
        absorb_on_way(packet, count)
    move_to_face(packet, whole, at, table, body.grid)
    fetch_table(packet, count, table, at + CELL)
    take_jets(packet, whole, at, body.grid)
    fetch_facets(packet, count, at, face, rays.noise, rays.keys, body)


@inline
def keep_event(packet, count, event):
    """Store the state before an event."""
    for number in range(_OF_EVENT):
        for k in range(count):
            event[number * LANES + k] = packet[FIRST_EVENT + number * SIZE + k]
    for number in range(12):
        for k in range(count):
            event[(_OF_EVENT + number) * LANES + k] = packet[E + number * SIZE + k]


@inline
def recall_event(packet, count, event):
    """Restore the state before an event."""
    for number in range(_OF_EVENT):
        for k in range(count):
            packet[FIRST_EVENT + number * SIZE + k] = event[number * LANES + k]
    for number in range(12):
        for k in range(count):
            packet[E + number * SIZE + k] = event[(_OF_EVENT + number) * LANES + k]


@inline
def store_by_rays(packet, count, placement, by_rays):
    """Sensitivities to the incoming rays, if wanted; 0 for rays without a derivative."""
    if len(by_rays.by_points) > 0:
        for lane in range(count):
            k = int(packet[RAY + lane])
            smooth = packet[SMOOTH + lane] == 1.0
            e = turned_back(placement, INTO, three(packet, EX + lane))
            f = turned_back(placement, INTO, three(packet, FX + lane))
            for axis in range(3):
                by_rays.by_points[k, axis] = e[axis] if smooth else 0.0
                by_rays.by_directions[k, axis] = f[axis] if smooth else 0.0
            for part in range(4):
                local = turned_back(placement, INTO, three(packet, BY_E + part * FIELD + lane))
                for axis in range(3):
                    by_rays.by_fields[k, 3 * part + axis] = local[axis] if smooth else 0.0


@inline
def adjoint_of_way(memory, count, met, rays, body, ways, by_fields, by_tables):
    """The adjoint of rays in a packet that have all ``met`` the same."""
    packet = memory.packet
    stored_events = memory.events
    events = len(met)
    whole = in_whole_vectors(count)
    begin_forward(packet, whole, rays.fields, body.placement)
    for event in range(events):
        face = met_face(event, met, body.sides)
        if event > 0:
            to_next_frame(packet, whole, body.placement)
        on_to_event(packet, count, face, rays, body, ways)
        keep_event(packet, whole, stored_events[event])
        forward_at(packet, whole, face, rays, body)
    begin_back(packet, whole, body.placement, by_fields)
    for event in range(events - 1, -1, -1):
        face = met_face(event, met, body.sides)
        recall_event(packet, whole, stored_events[event])
        if event + 1 < events:  # of the last one all else is there
            fetch_facets(packet, count, FIRST_EVENT, face, rays.noise, rays.keys, body)
            refract_all_at(packet, whole, face, rays, body.grid)
            all_amplitudes(packet, whole, face, rays, body)
        back_through(packet, whole, face, event + 1 == events, rays, body)
        add_gradients(packet, count, FIRST_EVENT, face.face, body.grid.inverse_step, by_tables)
        if event > 0:
            from_next_frame(packet, whole, body.placement)


@kernel
def adjoint_of_ways(rays, body, ways, fates, by, groups, gradients, memory):
    """Add every ray's contribution to the ``gradients`` (``BodyGradients``), way by way.

    ``rays``, ``body`` and ``ways`` as ``kernels.trace`` took and filled them, with the ``fates`` that it found. ``by``
    (``ByRaysOut``): sensitivities to a ray that left, and of one that the last face reflected totally that to its exit
    sine. ``groups``: of :func:`same_way`. ``memory``: of :func:`adjoint_memory`.
    """
    most = ways.lengths.shape[1]
    for group in range(len(groups.starts) - 1):
        met = ways.met[groups.numbers[groups.starts[group]]]
        events = 0
        while events < most and met[events] >= 0:
            events += 1
        for first in range(groups.starts[group], groups.starts[group + 1], LANES):
            numbers = groups.numbers[first : min(first + LANES, groups.starts[group + 1])]
            count = load_way(memory.packet, numbers, fates, events, rays, body, ways, by)
            if count > 0:
                adjoint_of_way(memory, count, met[:events], rays, body, ways, by.by_fields, gradients.by_tables)
                store_by_rays(memory.packet, count, body.placement, gradients.by_rays)
