"""Light that a face spreads by wide angles: the direction behind it is shifted along the face, and turns its fields.

With t the part of the direction along the face, or 0 where scattered light forgets whence it came, and s the shift that
each ray has there, light goes on along t + s; what would go beyond grazing, |t + s| > 1, comes back by as much, along
(t + s) / |t + s|^2. Nothing is lost, and nothing jumps. The lines of a shift are those of a facet's slope.
"""

from math import cos, pi, sin, sqrt
from typing import NamedTuple

from lensforge.kernels.compiled import inline
from lensforge.kernels.facet_normals import on_face
from lensforge.kernels.fields import FieldTurn, turn_vector
from lensforge.kernels.nearest_face import FIELDS, SIDE
from lensforge.kernels.ray_draws import drawn
from lensforge.kernels.ray_packet import COSINE, DX, MX, RAY, SIZE, three, write
from lensforge.kernels.vectors import add_scaled, dot, linear_combination, scaled

_GRAZING = 1e-18  # squared cosine below which the slope of its root no longer counts


class Shift(NamedTuple):
    """Shift of a ray at a face: along two lines, share of its own direction that it keeps, unit vector along the shift
    and the derivative of its amount by the cosine of incidence."""

    x: float
    y: float
    keep: float
    along: tuple[float, float]
    by_cosine: float


class Bounce(NamedTuple):
    """A face behind which light is spread: unit normals away from the origin and to the side of the light; 1 where both
    are the same, else -1."""

    outward: tuple[float, float, float]
    ahead: tuple[float, float, float]
    side: float


@inline
def amount_of(number, shares, squares, last):
    """Amount of the shift for a number in [0, 1) at one incidence; 0 for light that is not scattered, the first."""
    share = number - (1.0 - shares[last])
    if share <= 0.0:
        return 0.0
    low = 0
    high = last
    while high - low > 1:
        middle = (low + high) // 2
        if shares[middle] <= share:
            low = middle
        else:
            high = middle
    width = shares[high] - shares[low]
    part = min((share - shares[low]) / width, 1.0) if width > 0.0 else 0.0
    return sqrt(squares[low] + part * (squares[high] - squares[low]))


@inline
def amount_at(number, face, c, shifts):
    """Amount of a shift at a cosine of incidence, linear between the given ones, and its derivative."""
    cosines = shifts.cosines[face]
    shares = shifts.shares[face]
    squares = shifts.squares[face]
    last = shifts.sizes[face, 0] - 1
    outermost = shifts.sizes[face, 1] - 1
    if last == 0 or c <= cosines[0]:
        return amount_of(number, shares[0], squares, outermost), 0.0
    if c >= cosines[last]:
        return amount_of(number, shares[last], squares, outermost), 0.0
    k = 0
    while c > cosines[k + 1]:
        k += 1
    low = amount_of(number, shares[k], squares, outermost)
    slope = (amount_of(number, shares[k + 1], squares, outermost) - low) / (cosines[k + 1] - cosines[k])
    return low + slope * (c - cosines[k]), slope


@inline
def numbers_at(k, face, times, shifts, keys):
    """Two numbers of ray k for the rings of a face after ``times`` earlier hits."""
    if times == 0:
        return shifts.numbers[k, 2 * face], shifts.numbers[k, 2 * face + 1]
    return drawn(keys[k], face, times)


@inline
def shift_at(k, face, times, c, shifts, keys):
    """The shift of ray k at a face after ``times`` earlier hits; and whether it is shifted."""
    if shifts.sizes[face, 0] == 0:
        return Shift(0.0, 0.0, 1.0, (1.0, 0.0), 0.0), False
    uniform, second_uniform = numbers_at(k, face, times, shifts, keys)
    amount, slope = amount_at(uniform, face, c, shifts)
    x, y = cos(2.0 * pi * second_uniform), sin(2.0 * pi * second_uniform)
    keep = shifts.follows[face] if amount > 0.0 else 1.0
    return Shift(amount * x, amount * y, keep, (x, y), slope), amount > 0.0


@inline
def bounce(n, side, mirrored):
    """The face of a ray that met it with the normal n along its way, from before (1) or behind (-1)."""
    ahead = -1.0 if mirrored else 1.0
    return Bounce(scaled(side, n), scaled(ahead, n), side * ahead)


@inline
def _unfolded(b, shift, face):
    """Direction along the face before folding, and the factors that make the shift a vector there."""
    n = face.ahead
    m, tilt = on_face(shift.x, shift.y, face.outward)
    return add_scaled(m, shift.keep, add_scaled(b, -dot(b, n), n)), tilt


@inline
def spread(b, shift, face):
    """Unit direction of light that a polished face would send along b."""
    t, _ = _unfolded(b, shift, face)
    squared = dot(t, t)
    if squared > 1.0:
        t = scaled(1.0 / squared, t)
    return add_scaled(t, sqrt(max(1.0 - dot(t, t), _GRAZING)), face.ahead)


@inline
def spread_adjoint(b, shift, face, g):
    """Adjoint of :func:`spread`: from the sensitivity g to those to b, to the normal ahead, and to the amount."""
    o = face.outward
    n = face.ahead
    t, tilt = _unfolded(b, shift, face)
    squared = dot(t, t)
    s = scaled(1.0 / squared, t) if squared > 1.0 else t
    q = sqrt(max(1.0 - dot(s, s), _GRAZING))
    h = add_scaled(g, -dot(g, n) / q, s)
    if squared > 1.0:
        h = scaled(1.0 / squared, add_scaled(h, -2.0 * dot(h, t) / squared, t))
    by_b = scaled(shift.keep, add_scaled(h, -dot(h, n), n))
    by_n = add_scaled(scaled(q, g), -shift.keep, linear_combination(dot(b, n), h, dot(h, n), b))
    onto = (h[0] * o[0] + h[1] * o[1] + h[2] * (o[2] + 1.0)) / (1.0 + o[2])
    by_o = add_scaled(scaled(-tilt, h), -onto, (shift.x, shift.y, -tilt))
    by_x, by_y = h[0] - onto * o[0], h[1] - onto * o[1]
    return by_b, add_scaled(by_n, face.side, by_o), by_x * shift.along[0] + by_y * shift.along[1]


@inline
def turn_between(before, behind):
    """The turn of fields from one direction to another, about their common normal."""
    none = (0.0, 0.0)
    return FieldTurn(none, none, before, before, before, behind, False)


@inline
def spread_behind(packet, lane, face, mirrored, times, shifts, keys, sides):
    """Spread a ray that a face let pass, or whose mirror reflected it, with its fields where it carries them.

    ``times``: how often it has met that face before.
    """
    if shifts is not None:  # known to the compiler
        shift, spreads = shift_at(int(packet[RAY + lane]), face, times, packet[COSINE + lane], shifts, keys)
        if spreads:
            b = three(packet, DX + lane)
            side = 1.0 if sides is None else packet[SIDE + lane]
            to = spread(b, shift, bounce(three(packet, MX + lane), side, mirrored))
            if sides is not None:
                turn = turn_between(b, to)
                for first in range(FIELDS + lane, FIELDS + 12 * SIZE + lane, 3 * SIZE):
                    write(packet, first, turn_vector(three(packet, first), turn))
            write(packet, DX + lane, to)


@inline
def before_last_spread(k, n, b, c, shifts, keys, f, by_n, by_c):
    """Direction of ray k behind the outer face of a double lens, which would send it along b; and sensitivities before.

    f is that to the direction, and becomes that to b; by_n, that to the normal n, and by_c, to the cosine c before the
    face, have what the spread adds.
    """
    if shifts is None:
        return b, f, by_n, by_c
    shift, spreads = shift_at(k, 1, 0, c, shifts, keys)
    if not spreads:
        return b, f, by_n, by_c
    at = bounce(n, 1.0, False)
    to_b, to_n, by_amount = spread_adjoint(b, shift, at, f)
    return spread(b, shift, at), to_b, add_scaled(by_n, 1.0, to_n), by_c + shift.by_cosine * by_amount
