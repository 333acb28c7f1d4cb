"""Lenses for total internal reflection and reflectors, by docs/definitions.md alone: faces, events and losses."""

import json
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from page_tracer import (
    BACKWARD,
    BASE,
    EVENT_LIMIT,
    FLANGE,
    LANDED,
    REACH,
    TOTAL,
    Functions,
    coated,
    enter,
    first_root,
    fresnel,
    refractive_index,
    to_receiver,
    unit,
)
from scipy.interpolate import BSpline
from scipy.ndimage import map_coordinates
from scipy.special import ndtr

SIDES = {
    "cap": ("cavity", "body"), "side": ("cavity", "body"), "wall": ("body", "outside"), "flange": ("body", "outside"),
    "exit": ("body", "outside"), "cup": ("cavity", "body"), "back": ("body", "outside"), "mouth": ("cavity", "outside"),
}  # fmt: skip
STEPS = 128  # along a ray: between two of them it does not leave its medium and come back


# -- Section 4: faces by their reciprocal radius -----------------------------------------------------------------------


def plane(face, u):
    slope = np.array(face["axis"]) / (face["axis"][2] * face["height_mm"])
    return u @ slope, np.tile(slope, (len(u), 1))


def cone(face, u):
    sine = np.hypot(u[:, 0], u[:, 1])
    radial = u[:, :2] / np.where(sine > 0, sine, 1)[:, None]
    slope = np.column_stack([radial, np.full(len(u), -face["slope"])]) / face["radius_mm"]
    return (sine - face["slope"] * u[:, 2]) / face["radius_mm"], slope


def conic(face, u):
    slope = -face["eccentricity"] / face["parameter_mm"] * unit(np.array([face["axis"]]))[0]
    return 1 / face["parameter_mm"] + u @ slope, np.tile(slope, (len(u), 1))


def spline_of(profile):
    count = len(profile["coefficients"])
    knots = profile["low"] + step_of(profile) * np.arange(-5, count + 1)
    return BSpline(knots, profile["coefficients"], 5)


def step_of(profile):
    return (profile["high"] - profile["low"]) / (len(profile["coefficients"]) - 5)


def profile(face, u):
    step = step_of(face)
    inside = np.clip(u[:, 2], face["low"], face["high"])
    value, by, bend = (face["spline"](inside, k) * step**k for k in (0, 1, 2))
    s = (u[:, 2] - inside) / step
    slope = np.zeros_like(u)
    slope[:, 2] = (by + np.sign(s) * (1 - np.exp(-abs(s))) * bend) / step
    return value + by * s + (abs(s) + np.exp(-abs(s)) - 1) * bend, slope


def formed(face, u):
    (value, slope) = profile(face["profile"], u)
    (more, also) = face["sums"].mean(u)
    return value + more, slope + also


def grooved(face, u):
    (a, by_a) = profile(face["lens"], u)
    (b, by_b) = profile(face["ring"], u)
    c = face["band_per_mm"]
    x = np.clip((a - b) / c, -1, 1)
    value = (a + b) / 2 - np.where(abs(a - b) < c, c * (5 + 15 * x**2 - 5 * x**4 + x**6) / 32, abs(a - b) / 2)
    share = (1 - (15 * x - 10 * x**3 + 3 * x**5) / 8)[:, None] / 2
    return value, share * by_a + (1 - share) * by_b


KINDS = {"plane": plane, "cone": cone, "conic": conic, "profile": profile, "formed": formed, "grooved": grooved}


NODES = 385  # of a table along each axis of the chart (X, Y), up to the horizon and a little beyond
FEW = 10_000  # directions for which no table is made


class Face:
    """A face; far from it, its radius is that of a table, whose error is measured at random directions."""

    def __init__(self, name, record):
        self.name = name
        (self.before, self.behind) = SIDES[name]
        if record["kind"] == "formed":
            sums = Functions(record["functions"], record["functions"]["weights"])
            rotational = record["profile"] | {"spline": spline_of(record["profile"])}
            record = record | {"reach_mm": rotational["reach_mm"], "profile": rotational, "sums": sums}
        if record["kind"] == "grooved":
            record = record | {zone: record[zone] | {"spline": spline_of(record[zone])} for zone in ("lens", "ring")}
        if record["kind"] == "profile":
            record = record | {"spline": spline_of(record)}
        self.record = record
        self.reach = record["reach_mm"]
        self.kind = KINDS[record["kind"]]

    def exact(self, u):
        """Radius (mm) and normal of the directions."""
        value, slope = self.kind(self.record, u)
        x = np.clip(2 * value * self.reach - 1, 0, 1)
        beyond = (3 / 4 + x**4 * (5 - 6 * x + 2 * x**2) / 4) / self.reach
        bent = np.where(value * self.reach >= 1, value, beyond)
        by_value = np.where(value * self.reach >= 1, 1, x**3 * (10 - 15 * x + 6 * x**2))
        along = slope - (slope * u).sum(axis=1)[:, None] * u
        return 1 / bent, unit(u + (by_value / bent)[:, None] * along)  # grad rho / rho = - grad(1/rho) rho

    @cached_property
    def table(self):
        """Radii on the chart, and four times the largest error between the nodes."""
        axis = np.linspace(-REACH, REACH, NODES)
        table = self.exact(from_chart(*(a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))))[0]
        table = table.reshape(NODES, NODES)
        (x, y) = np.random.default_rng(0).uniform(-1, 1, (2, 20_000))
        u = from_chart(x, y)
        return table, 4 * abs(self.exact(u)[0] - map_coordinates(table, to_chart(u), order=1)).max()

    def room(self, u, far):
        """rho - |p| of points by direction and distance: above 0 on the side of the origin; exact near the face."""
        if len(u) < FEW and "table" not in self.__dict__:
            return self.exact(u)[0] - far
        table, error = self.table
        room = map_coordinates(table, to_chart(u), order=1) - far
        near = (abs(room) < error) | (u[:, 2] < 0)
        room[near] = self.exact(u[near])[0] - far[near]
        return room


def from_chart(x, y):
    return np.column_stack([2 * x, 2 * y, 1 - x**2 - y**2]) / (1 + x**2 + y**2)[:, None]


def to_chart(u):
    return (u[:, :2].T / np.maximum(1 + u[:, 2], 1e-3) + REACH) * (NODES - 1) / (2 * REACH)


# -- Section 7: bodies of more than two faces --------------------------------------------------------------------------


def room_in(faces, medium, p):
    """Above 0 in a medium: within all faces that it has outside of it; in the body not within the cavity."""
    place = polar(p)
    held = np.min([face.room(*place) for face in faces if face.before == medium], axis=0)
    if medium == "cavity":
        return held
    return np.minimum(held, -np.min([face.room(*place) for face in faces if face.before == "cavity"], axis=0))


def polar(p):
    """Direction and distance from the origin."""
    return unit(p), np.linalg.norm(p, axis=1)


def way_out(faces, medium, p, d):
    """Path to where a ray leaves its medium, and the number of the face there; nan where it falls to z = 0 before."""
    reach = max(face.reach for face in faces if face.before == medium)
    start = 1e-9 * reach  # off the face that was met last
    p = p + start * d
    along = (p * d).sum(axis=1)
    ends = np.sqrt(along**2 - (p**2).sum(axis=1) + reach**2) - along
    down = d[:, 2] < 0
    ends[down] = np.minimum(ends[down], -p[down, 2] / d[down, 2])
    t = first_root(lambda t, rows=slice(None): room_in(faces, medium, p[rows] + t[:, None] * d[rows]), ends, STEPS)
    at = p + np.where(np.isnan(t), 0, t)[:, None] * d
    place = polar(at)
    rooms = [abs(f.room(*place)) if medium in (f.before, f.behind) else np.full(len(p), np.inf) for f in faces]
    return t + start, np.argmin(rooms, axis=0)


@dataclass
class Light:
    """All rays, and what their events have made of them; both fields of each, complex."""

    p: np.ndarray
    d: np.ndarray
    fields: np.ndarray
    clear: np.ndarray
    absorbed: np.ndarray
    fate: np.ndarray
    turns: dict  # by the name of a rough face the slopes of its facets, (rays, times met, 2), and their rms
    times: dict  # by the name of a face, how often each ray has met it

    def flux(self, rows):
        return self.clear[rows] * (abs(self.fields[rows]) ** 2).sum(axis=(1, 2)) / 2


def refracting(section, name, medium, before, behind, c, nm, total):
    """Amplitudes of s and p at a face: of the light that passes, or of the light that is reflected totally."""
    ratio = before / behind
    evanescent = np.sqrt(np.where(total, ratio**2 * (1 - c**2) - 1, 0))
    back_s = (ratio * c - 1j * evanescent) / (ratio * c + 1j * evanescent)
    back_p = -(c - 1j * ratio * evanescent) / (c + 1j * ratio * evanescent)
    t = fresnel(c, np.sqrt(np.where(total, 0, 1 - ratio**2 * (1 - c**2))), ratio)
    coating = section[name].get("coating") if name in section else None
    if coating is not None:
        partial = ~total
        t[:, partial] = coated(
            coating, nm[partial], before[partial], behind[partial], np.minimum(c[partial], 1), medium == "body"
        )
    return np.where(total, back_s, np.sqrt(np.where(total, 0, t[0]))), np.where(
        total, back_p, np.sqrt(np.where(total, 0, t[1]))
    )


def fields_behind(fields, d, on, n, a_s, a_p, reflected):
    """Both fields by their parts across the plane of incidence and in it, and the turn of that to the new direction."""
    s = np.cross(n, d)
    flat = np.linalg.norm(s, axis=1) < 1e-9
    s = unit(np.where(flat[:, None], np.cross(d, [1.0, 0.2, 0.1]), s))
    p_before = np.cross(d, s)
    p_behind = np.where(reflected[:, None], p_before - 2 * (p_before * n).sum(axis=1)[:, None] * n, np.cross(on, s))
    outgoing = np.empty_like(fields)
    for k in (0, 1):
        in_s = (fields[:, k] * s).sum(axis=1)
        in_p = (fields[:, k] * p_before).sum(axis=1)
        outgoing[:, k] = (a_s * in_s)[:, None] * s + (a_p * in_p)[:, None] * p_behind
    return outgoing


def meet(light, face, medium, rows, t, media, section, nm, event):
    """Light at one face; returns the medium of those that go on, and their numbers."""
    back = face.before != medium
    beyond = face.before if back else face.behind
    d = light.d[rows]
    at = light.p[rows] + t[:, None] * light.d[rows]
    if face.name == "flange":
        light.fate[rows] = FLANGE
        return []
    if medium == "body":
        left = np.exp(-section["absorption_per_mm"] * t)
        light.absorbed[rows] += light.flux(rows) * (1 - left)
        light.clear[rows] *= left
    n = face.exact(unit(at))[1]
    if face.name in light.turns:
        slopes, rms = light.turns[face.name]
        n = facet(n, d, slopes[rows, light.times[face.name][rows]], rms)
        light.times[face.name][rows] += 1
    n = n * (-1 if back else 1)
    c = (d * n).sum(axis=1)
    mirror = section[face.name].get("mirror") if face.name in section else None
    before = media[medium][rows]
    behind = media[beyond][rows]
    q2 = 1 - (before / behind) ** 2 * (1 - c**2)
    reflected = np.full(len(rows), True) if mirror is not None else q2 <= 0
    q = np.sqrt(np.where(reflected, 0, q2))
    on = (before / behind)[:, None] * d + (q - before / behind * c)[:, None] * n
    on = np.where(reflected[:, None], d - 2 * c[:, None] * n, on)
    if mirror is not None:
        light.absorbed[rows] += light.flux(rows) * (1 - mirror)
        amplitudes = np.full((2, len(rows)), np.sqrt(mirror))
    else:
        amplitudes = refracting(section, face.name, medium, before, behind, c, nm[rows], reflected)
    light.fields[rows] = fields_behind(light.fields[rows], d, on, n, *amplitudes, reflected)
    light.p[rows] = at
    light.d[rows] = on
    if event + 1 == section["events"]:
        inside = reflected if beyond == "outside" else np.full(len(rows), True)
        total = reflected & (mirror is None)
        light.fate[rows[inside]] = np.where(total, TOTAL, EVENT_LIMIT)[inside]
    return [(medium, rows[reflected]), (beyond, rows[~reflected])]


def trace_chain(lens, faces, p, d, nm=None):
    """As :func:`page_tracer.trace`, of a lens of more than two faces."""
    left, p, d, fate, flux, absorbed, nm, stokes = leave_chain(lens, faces, p, d, nm)[:8]
    flux, place, in_glass = to_receiver(lens, left, p, d, fate, flux, nm, stokes)
    return fate, place, flux, absorbed, in_glass


def facet(n, d, slopes, s):
    """Normals of facets of rms slope s on a face with normals n away from the origin.

    Slopes are along x and y, turned as z is turned to n. Along the light a slope y becomes the slope w: the share above
    w of the facets that the light sees is the share above y of all facets.
    """
    axis = np.stack([-n[:, 1], n[:, 0], np.zeros(len(n))], axis=1)
    flat = np.column_stack([slopes, np.zeros(len(n))])
    v = n[:, 2:] * flat + np.cross(axis, flat) + (axis * flat).sum(axis=1)[:, None] * axis / (1.0 + n[:, 2:])
    c = (d * n).sum(axis=1)
    t = np.cross(n, np.cross(d, n))
    sine = np.linalg.norm(t, axis=1)
    e = np.sign(c)[:, None] * t / np.where(sine > 0, sine, 1)[:, None]
    y = (v * e).sum(axis=1) / s
    k = np.minimum(abs(c) / np.maximum(s * sine, 1e-300), 1e8)
    low = np.maximum(y, -k)
    high = np.maximum(y, 0) + 1.2
    for _ in range(60):
        w = (low + high) / 2
        above = (k * ndtr(-w) + bell(w)) / (k * ndtr(k) + bell(k)) > ndtr(-y)
        low = np.where(above, w, low)
        high = np.where(above, high, w)
    return unit(n + v + s * (w - y)[:, None] * e)


def bell(x):
    return np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)


def mix(q):
    q = (q ^ q >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    q = (q ^ q >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return q ^ q >> np.uint64(31)


G = np.uint64(0x9E3779B97F4A7C15)


def keys_of(p, d):
    """A hash of the bits with which each ray begins."""
    key = np.zeros(len(p), np.uint64)
    for axis in range(3):
        for numbers in (p, d):
            key = mix(key + G ^ np.ascontiguousarray(numbers[:, axis]).view(np.uint64))
    return key


def drawn(keys, i):
    """Two numbers of each ray in [0, 1)."""
    h = mix(keys + G ^ np.uint64(i))
    return [(mix(state) >> np.uint64(11)) / 2.0**53 for state in (h + G, h + G + G)]


def leave_chain(lens, faces, p, d, nm=None, turns=None):
    """As :func:`page_tracer.leave`, of a lens of more than two faces; and the faces that each ray met, in order."""
    section = lens["spec"]["lens"]
    d = unit(d)
    count = len(p)
    media = {"body": refractive_index(lens, nm, count)}
    media |= {medium: np.full(count, section[f"{medium}_index"]) for medium in ("cavity", "outside")}
    nm = np.full(count, section["design_wavelength_nm"]) if nm is None else nm
    fate, p = enter(p, d, lambda points: room_in(faces, "cavity", points) > 0)
    side = unit(np.cross(d, np.where(abs(d[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])))
    fields = np.stack([side, np.cross(d, side)], axis=1).astype(complex)
    times = {name: np.zeros(count, int) for name in turns or {}}
    light = Light(p, d.copy(), fields, np.ones(count), np.zeros(count), fate, turns or {}, times)
    ways = [()] * count
    going = {"cavity": np.flatnonzero(fate == LANDED)}
    out = []
    for event in range(section["events"]):
        onward = {"cavity": [], "body": [], "outside": out}
        for medium, rows in going.items():
            t, met = way_out(faces, medium, light.p[rows], light.d[rows])
            lost = np.isnan(t)
            falls = light.d[rows[lost], 2] <= 0
            light.fate[rows[lost]] = np.where((medium == "cavity") & falls, BACKWARD, BASE)
            for number in np.unique(met[~lost]):
                some = np.flatnonzero(~lost & (met == number))
                for row in rows[some]:
                    ways[row] = (*ways[row], faces[number].name)
                for behind, others in meet(
                    light, faces[number], medium, rows[some], t[some], media, section, nm, event
                ):
                    onward[behind].append(others)
        going = {medium: np.concatenate([[], *onward[medium]]).astype(int) for medium in ("cavity", "body")}
    left = np.concatenate([[], *out]).astype(int)
    flux = light.flux(slice(None))
    return left, light.p, light.d, light.fate, flux, light.absorbed, nm, as_stokes(light, left), ways


def as_stokes(light, rows):
    """Q and U of a flux of 1, and the direction to which they refer."""
    d = light.d[rows]
    fields = light.fields[rows]
    s = unit(np.cross(d, np.where(abs(d[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])))
    a_s, a_p = ((fields * axis[:, None]).sum(axis=2) for axis in (s, np.cross(d, s)))
    i = (abs(a_s) ** 2 + abs(a_p) ** 2).sum(axis=1)
    q = (abs(a_s) ** 2 - abs(a_p) ** 2).sum(axis=1) / i
    u = 2 * (a_s * a_p.conj()).real.sum(axis=1) / i
    return [q, u, s]


def chain_faces(lens):
    return [face_of(name, json.dumps(record)) for name, record in lens["faces"].items()]


@cache
def face_of(name, record):
    return Face(name, json.loads(record))
