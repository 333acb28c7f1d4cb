"""The body of a lens by docs/definitions.md alone: its faces, where each bounds it, and sums over them."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from page_chain import SIDES, Face
from page_tracer import surface, unit
from scipy.fft import irfft, rfft
from scipy.interpolate import CubicSpline

TURNS = 192  # azimuths
ALONG = 48  # Gauss-Legendre angles from the axis of each face
ROUND = 2 * np.pi * np.arange(TURNS) / TURNS


def directions(theta, phi):
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], axis=-1)


HORIZON = directions(np.full(720, np.pi / 2), 2 * np.pi * np.arange(720) / 720)


@dataclass
class Part:
    """A face where it bounds the body or its cavity: ``ends(phi)``, the angles from the axis between which it lies."""

    name: str
    shape: object
    before: str
    behind: str
    low: object = None
    high: object = None

    def exact(self, u):
        flat = u.reshape(-1, 3)
        rho, n = self.shape.exact(flat)
        return rho.reshape(u.shape[:-1]), n.reshape(u.shape)

    def ends(self, phi):
        low = np.zeros_like(phi) if self.low is None else self.low(phi)
        return low, np.full_like(phi, np.pi / 2) if self.high is None else self.high(phi)

    def at(self, share, phi):
        """Points, normals away from the origin, and directions at a share of the way along each meridian."""
        low, high = self.ends(phi)
        u = directions(low + (high - low) * np.clip(share, 0, 1), phi)
        rho, n = self.exact(u)
        return rho[..., None] * u, n, u

    @cached_property
    def area(self):
        """Points, normals and areas of the pieces of a rule over the face."""
        node, weight = np.polynomial.legendre.leggauss(ALONG)
        share, phi = np.meshgrid((node + 1) / 2, ROUND, indexing="ij")
        p, n, u = self.at(share, phi)
        low, high = self.ends(phi)
        sine = np.hypot(u[..., 0], u[..., 1])
        solid = (weight / 2)[:, None] * (high - low) * sine * 2 * np.pi / TURNS
        pieces = solid * (p**2).sum(axis=-1) / (n * u).sum(axis=-1)
        return p.reshape(-1, 3), n.reshape(-1, 3), pieces.ravel()

    def curvatures(self, share, phi):
        """Least and largest principal curvature, positive where the face is convex seen from outside."""
        flat = self.at(share, phi)[2].reshape(-1, 3)
        side = unit(np.cross(flat, np.where(abs(flat[:, 2:]) < 0.9, [0.0, 0, 1], [1.0, 0, 0])))
        tangents = (side, np.cross(flat, side))
        h = 1e-4
        slopes = []
        for along in tangents:
            ends = [unit(flat + sign * h * along) for sign in (1, -1)]
            places = [self.exact(end) for end in ends]
            slopes.append([sum(s * rho[:, None] * end for s, (rho, _), end in zip((1, -1), places, ends, strict=True)),
                           places[0][1] - places[1][1]])  # fmt: skip
        first = np.array([[(a[0] * b[0]).sum(axis=1) for b in slopes] for a in slopes])
        second = np.array([[(a[0] * b[1]).sum(axis=1) for b in slopes] for a in slopes])
        curvatures = np.linalg.eigvals(np.linalg.solve(np.moveaxis(first, 2, 0), np.moveaxis(second, 2, 0))).real
        return curvatures.min(axis=1).reshape(share.shape), curvatures.max(axis=1).reshape(share.shape)

    def extreme(self, figure, sign=1.0, across=61):
        """The largest (``sign`` = -1: least) figure(share, phi) over the face, its edges included."""
        share, phi = np.meshgrid(np.linspace(0, 1, across) ** 0.7, 2 * np.pi * np.arange(3 * across) / 3 / across)
        values = sign * figure(share, phi)
        best = np.unravel_index(np.argsort(values.ravel())[-5:], values.shape)
        hole = 0.0 if self.low is None else 0.5  # in the plane in which places are sought, around the axis

        def signed(x):
            share = np.clip(np.hypot(x[..., 0], x[..., 1]) - hole, 0, 1)
            return sign * figure(share, np.arctan2(x[..., 1], x[..., 0]))

        starts = (share[best] + hole)[:, None] * np.column_stack([np.cos(phi[best]), np.sin(phi[best])])
        return sign * max(values.max(), refined(signed, starts, 0.05))


def at_angles(p):
    return np.array([np.arctan2(np.hypot(*p[:2]), p[2]), np.arctan2(p[1], p[0])])


def refined(figure, starts, step):
    """The largest figure(places) near any of the starts, by grids of 7 x 7 that shrink about their best place."""
    ticks = np.linspace(-1, 1, 7)
    around = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(1, 49, 2)
    for _ in range(12):
        places = starts[:, None] + step * around
        values = figure(places)
        starts = places[np.arange(len(starts)), values.argmax(axis=1)]
        step = step / 3
    return float(values.max())


class PageBody:
    """Faces of the cavity and of the envelope, from the axis to the rim."""

    def __init__(self, lens):
        self.lens = lens
        self.spec = lens["spec"]
        faces = lens["faces"]
        if set(faces) == {"inner", "outer"}:
            sides = {"inner": ("cavity", "body"), "outer": ("body", "outside")}
            every = {name: Part(name, surface(faces[name]), *sides[name]) for name in faces}
        else:
            every = {name: Part(name, Face(name, record), *SIDES[name]) for name, record in faces.items()}
        self.cavity = self.nested([part for part in every.values() if part.before == "cavity"])
        mouth = [replace(part, high=None) for part in every.values() if part.name == "mouth"]  # a ring
        self.envelope = self.nested([part for part in every.values() if part.before == "body"] + mouth)
        self.parts = {part.name: part for part in (*self.cavity, *self.envelope)}

    @staticmethod
    def nested(parts):
        """The parts in order from the axis, each between its creases."""
        if len(parts) == 1:
            return parts
        angles = np.linspace(1e-6, np.pi / 2, 721)
        rho = [part.exact(directions(angles, 0.3))[0] for part in parts]
        order = list(dict.fromkeys(np.argmin(rho, axis=0)))
        for number, following in pairwise(order):
            parts[number].high = parts[following].low = crease(parts[number], parts[following])
        return [parts[k] for k in order]

    @staticmethod
    def radius(parts, u):
        return np.min([part.exact(u)[0] for part in parts], axis=0)

    @cached_property
    def lens_mm3(self):
        """Volume above z = 0: by the divergence theorem, a third of p . n over all faces."""
        cones = [[(part.area[0] * part.area[1]).sum(axis=1) @ part.area[2] / 3 for part in parts]
                 for parts in (self.envelope, self.cavity)]  # fmt: skip
        return sum(cones[0]) - sum(cones[1])

    @cached_property
    def rim(self):
        """Radius of the cavity's opening in z = 0 over 720 azimuths."""
        return self.radius(self.cavity, HORIZON)

    @cached_property
    def outer_rim(self):
        """Radius of the envelope in z = 0 over 720 azimuths."""
        return self.radius(self.envelope, HORIZON)

    @property
    def opening_mm2(self):
        return np.pi * (self.rim**2).mean()

    @cached_property
    def thinnest(self):
        """The least distance between the two boundaries, both at z >= 0."""
        share, phi = np.meshgrid(np.linspace(0, 1, 25), 2 * np.pi * np.arange(90) / 90)
        inner, outer = (np.concatenate([part.at(share, phi)[0].reshape(-1, 3) for part in parts])
                        for parts in (self.material(self.cavity), self.material(self.envelope)))  # fmt: skip
        apart = np.array([np.linalg.norm(outer - p, axis=1) for p in inner])
        starts = np.argsort(apart.min(axis=1))[:60:10]
        return min(self.shortest([at_angles(inner[k]), at_angles(outer[apart[k].argmin()])]) for k in starts)

    def shortest(self, ends, step=0.1):
        """The shortest line whose ends are near two directions: grids about both, which shrink."""
        ticks = np.linspace(-1, 1, 7)
        around = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(49, 2)
        for _ in range(32):
            places = [end + step * around for end in ends]
            points = []
            for parts, place in zip((self.material(self.cavity), self.material(self.envelope)), places, strict=True):
                low = parts[0].ends(place[:, 1])[0] if len(parts) == 1 else 0.0
                u = directions(np.clip(place[:, 0], low, np.pi / 2), place[:, 1])
                points.append(self.radius(parts, u)[:, None] * u)
            apart = np.linalg.norm(points[0][:, None] - points[1][None], axis=2)
            i, j = np.unravel_index(apart.argmin(), apart.shape)
            ends = [places[0][i], places[1][j]]
            step = step / 1.7
        return apart.min()

    def material(self, parts):
        return [part for part in parts if part.name != "mouth"]

    @cached_property
    def thickest(self):
        """The largest wall in one direction from the origin."""

        def wall(x):
            u = directions(np.clip(x[..., 0], 0, np.pi / 2), x[..., 1])
            wall = self.radius(self.envelope, u) - self.radius(self.cavity, u)
            mouth = [part for part in self.cavity if part.name == "mouth"]
            return np.where(x[..., 0] < mouth[0].ends(x[..., 1])[1], -1.0, wall) if mouth else wall

        theta, phi = np.meshgrid(np.linspace(0, np.pi / 2, 91), 2 * np.pi * np.arange(120) / 120)
        places = np.stack([theta, phi], axis=-1).reshape(-1, 2)
        best = np.argsort(wall(places))[-5:]
        return refined(wall, places[best], 0.04)


def crease(one, other):
    """Angle from the axis at which two faces meet, over azimuths: by bisection."""

    def angle(phi):
        shape = np.shape(phi)
        flat = np.ravel(phi)
        places = np.linspace(1e-6, np.pi / 2, 361)
        u = directions(places[:, None], flat[None, :])
        gap = one.exact(u)[0] - other.exact(u)[0]  # below 0 on the side of the axis
        last = len(places) - 1 - np.argmax(gap[::-1] <= 0, axis=0)  # beyond their reach faces may meet again
        low = places[last]
        high = places[np.minimum(last + 1, len(places) - 1)]
        for _ in range(45):
            middle = (low + high) / 2
            u = directions(middle, flat)
            beyond = one.exact(u)[0] > other.exact(u)[0]
            low = np.where(beyond, low, middle)
            high = np.where(beyond, middle, high)
        return ((low + high) / 2).reshape(shape)

    known = angle(ROUND)
    fine = irfft(rfft(known), 16 * TURNS) * 16
    spline = CubicSpline(2 * np.pi * np.arange(16 * TURNS + 1) / 16 / TURNS, [*fine, fine[0]], bc_type="periodic")

    def quick(phi):
        return spline(np.mod(phi, 2 * np.pi))

    return quick
