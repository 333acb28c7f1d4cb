"""Rotational bodies of four faces with closed forms: cap and side around the cavity, wall and exit around the body.

The oracle follows rays through quadrics and planes by roots, and their polarisation by coherency matrices, with the
phases of total reflection by the formula of Born and Wolf, 1.5.4.
"""

from dataclasses import dataclass

import cadquery as cq
import numpy as np
import trimesh
from lens_meshes import band, rings

from lensforge.cad.solid import Solid
from lensforge.cad.step import step_bytes
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.scene.body import Body, Face
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.surface import Surface

INDEX = 1.4936


@dataclass(frozen=True)
class Rotational(Surface):
    """The face ``a (x^2 + y^2) + b z^2 + 2 c z = d``, below 0 at the origin: its first crossing of each ray."""

    a: float
    b: float
    c: float
    d: float

    def hit(self, points, directions):
        """Distance to the first crossing beyond rounding; infinite where there is none."""
        weights = np.array([self.a, self.a, self.b])
        square = (weights * directions**2).sum(1)
        half = (weights * points * directions).sum(1) + self.c * directions[:, 2]
        rest = self.value(points)
        root = np.sqrt(np.maximum(half**2 - square * rest, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            straight = -0.5 * rest / half
            both = np.stack([(-half - root) / square, (-half + root) / square])
        both = np.where(np.abs(square) < 1e-14, straight, both)
        both = np.where((half**2 < square * rest) | ~(both > 1e-7), np.inf, both)
        return both.min(axis=0)

    def value(self, points):
        """Below 0 on the side of the origin."""
        return points**2 @ np.array([self.a, self.a, self.b]) + 2.0 * self.c * points[:, 2] - self.d

    def radius(self, u):
        return self.hit(np.zeros_like(u), u)

    @property
    def detail_rad(self):
        return 0.1

    def gradient(self, directions):
        radius = self.radius(directions)[:, None]
        n = self.normal_at(radius * directions)
        return radius * (directions - n / np.sum(n * directions, axis=1, keepdims=True))

    def normal_at(self, points):
        n = points * np.array([self.a, self.a, self.b]) + np.array([0.0, 0.0, self.c])
        return n / np.linalg.norm(n, axis=1, keepdims=True)


def sphere(radius, centre=0.0):
    return Rotational(1.0, 1.0, -centre, radius**2 - centre**2)


def plane(height):
    return Rotational(0.0, 0.0, 0.5, height)


def cone(radius, slope):
    """As wide as ``radius + slope z``."""
    return Rotational(1.0, -(slope**2), -radius * slope, radius**2)


def paraboloid(focal):
    """With its focus in the origin, open upwards: ``x^2 + y^2 = 4 f (z + f)``."""
    return Rotational(1.0, 0.0, -2.0 * focal, 4.0 * focal**2)


def body_of(cap, side, wall, exit):
    sides = (("cap", cap, CAVITY, BODY), ("side", side, CAVITY, BODY), ("wall", wall, BODY, OUTSIDE))
    return Body(tuple(Face(*fields) for fields in (*sides, ("exit", exit, BODY, OUTSIDE))))


CAP = plane(2.5)
SIDE = sphere(3.0)
EXIT = plane(10.0)
CONE = cone(6.0, 1.0)
PARABOLOID = paraboloid(3.0)
BALL = sphere(8.0, 4.0)
OF_CONE, OF_PARABOLOID, OF_BALL = (body_of(CAP, SIDE, wall, EXIT) for wall in (CONE, PARABOLOID, BALL))


def crease(inner, outer):
    """Polar angle at which the two faces have the same radius."""
    low = 1e-3
    high = 0.5 * np.pi - 1e-3

    def nearer(theta):
        u = np.array([[np.sin(theta), 0.0, np.cos(theta)]])
        return inner.radius(u)[0] < outer.radius(u)[0]

    first = nearer(low)
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if nearer(middle) == first else (low, middle)
    return 0.5 * (low + high)


def mesh_of(body, count):
    """A closed mesh, with a ring of vertices along each crease, and a flat rim at z = 0."""
    directions, dome = rings(count)
    size = len(directions)
    rim = np.arange(len(directions) - 6 * count, len(directions))
    vertices = []
    theta = np.arccos(np.clip(directions[:, 2], 0.0, 1.0))
    for boundary in (body.envelope, body.cavity):
        first, second = (face.surface for face in boundary)
        at = crease(first, second)
        ring = round(count * at / (0.5 * np.pi)) / count * 0.5 * np.pi
        bent = np.interp(theta, [0.0, ring, 0.5 * np.pi], [0.0, at, 0.5 * np.pi])
        u = directions * (np.sin(bent) / np.where(theta > 0.0, np.sin(theta), 1.0))[:, None]
        u[:, 2] = np.where(directions[:, 2] == 0.0, 0.0, np.cos(bent))
        vertices.append(u * np.minimum(first.radius(u), second.radius(u))[:, None])
    faces = [dome, dome[:, ::-1] + size, band(rim, rim + size)[:, ::-1]]
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=True)


def solid_of(body, names):
    """The bytes of its STEP file by the kernel's primitives; ``names``: of the faces, by the design's."""
    wall = body.faces[2].surface
    if wall is BALL:
        outer = cq.Workplane().sphere(8.0).translate((0.0, 0.0, 4.0))
    else:
        outer = cq.Workplane(cq.Solid.makeCone(6.0, 17.0, 11.0))
    outer = outer.intersect(cq.Workplane().box(60.0, 60.0, 10.0).translate((0.0, 0.0, 5.0)))
    cavity = cq.Workplane().sphere(3.0).intersect(cq.Workplane().box(20.0, 20.0, 5.0))
    shape = outer.cut(cavity).val()
    shape = shape.Solids()[0] if hasattr(shape, "Solids") else shape
    heights = {"cap": (0.3, 0.2, 2.5), "exit": (0.3, 0.2, 10.0)}
    faces = {}
    for face in shape.Faces():
        centre = face.Center().toTuple()
        for name, place in heights.items():
            if face.geomType() == "PLANE" and abs(centre[2] - place[2]) < 1e-6:
                faces[name] = face
        if face.geomType() == "CONE" or (face.geomType() == "SPHERE" and face.Area() > 150.0):
            faces["wall"] = face
        elif face.geomType() == "SPHERE":
            faces["side"] = face
    assert set(faces) == {"cap", "side", "wall", "exit"}
    return step_bytes(
        Solid(shape.wrapped, {names[name]: faces[name].wrapped for name in faces if name in names}), "body"
    )


OPTICAL = {name: f"OPTICAL_{name.upper()}" for name in ("cap", "side", "wall", "exit")}


def rays_from(count, side, seed=0, height=0.0):
    """Rays of 1 W in all over the hemisphere, from a square of ``side`` mm."""
    random = np.random.default_rng(seed)
    z = random.uniform(0.02, 1.0, count)
    phi = random.uniform(0.0, 2.0 * np.pi, count)
    sine = np.sqrt(1.0 - z**2)
    directions = np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=1)
    origins = np.column_stack([random.uniform(-0.5, 0.5, (count, 2)) * side, np.full(count, height)])
    return RayBundle(origins, directions, np.full(count, 1.0 / count))


@dataclass
class Followed:
    """What the oracle says: exit points and directions (NaN: lost), flux left, what mirrors took, events, last face."""

    points: np.ndarray
    directions: np.ndarray
    flux: np.ndarray
    in_mirrors: np.ndarray
    inside: np.ndarray
    chains: list[str]


def follow_exactly(body, rays, events, index=INDEX, mirrors=None, absorption=0.0):
    """Rays followed one by one, by closed forms; ``mirrors``: reflectances by the names of the faces."""
    count = len(rays)
    mirrors = mirrors or {}
    result = Followed(*np.full((2, count, 3), np.nan), *np.zeros((2, count)), np.zeros(count, dtype=bool), [])
    for k in range(count):
        p = rays.origins[k]
        d = rays.directions[k]
        coherency = 0.5 * (np.eye(3) - np.outer(d, d)).astype(complex)
        medium = CAVITY
        chain = ""
        for _ in range(events):
            faces = body.cavity if medium == CAVITY else body.envelope
            lengths = [face.surface.hit(p[None], d[None])[0] for face in faces]
            face = faces[int(np.argmin(lengths))]
            length = min(lengths)
            hit = p + length * d
            above = min(length, -p[2] / d[2] if d[2] < 0.0 else np.inf)  # as far as the base
            if medium == BODY and np.isfinite(above) and _meets_cavity(body, p, d, above):
                chain += "c"
                break
            if not np.isfinite(length) or hit[2] <= 0.0:
                chain += "x"
                break
            p = hit
            if medium == BODY:
                coherency = coherency * np.exp(-absorption * length)
            n = face.surface.normal_at(p[None])[0]
            ratio = index if medium == BODY else 1.0 / index
            d, coherency, passes, lost = _at(d, n, ratio, coherency, mirrors.get(face.name))
            result.in_mirrors[k] += rays.flux[k] * lost
            chain += face.name[0].upper() if passes else face.name[0]
            if passes:
                medium = OUTSIDE if medium == BODY else BODY
            if medium == OUTSIDE:
                result.points[k] = p
                result.directions[k] = d
                break
        result.inside[k] = medium != OUTSIDE and chain[-1:] not in ("x", "c")
        result.flux[k] = rays.flux[k] * np.trace(coherency).real
        result.chains.append(chain)
    return result


def _meets_cavity(body, p, d, length):
    """True where the way to the wall leads through the cavity, an intersection of two bodies that are convex."""
    places = p + np.linspace(0.0, length, 2001)[2:-1, None] * d
    return bool((np.max([face.surface.value(places) for face in body.cavity], axis=0) < -1e-9).any())


def _at(d, n, ratio, coherency, mirror):
    """Direction and coherency behind a face, True where the ray passes, and the share that a mirror takes."""
    cosine = float(d @ n)
    s = np.cross(d, n)
    s = s / np.linalg.norm(s) if np.linalg.norm(s) > 1e-12 else np.linalg.svd(d[None])[2][1]
    sine = min(np.sqrt(max(1.0 - cosine**2, 0.0)), 1.0)
    back = d - 2.0 * cosine * n
    if mirror is not None:
        ways = back
        parts = (np.sqrt(mirror), -np.sqrt(mirror))
        ahead = False
    elif ratio * sine >= 1.0:  # (60) of Born and Wolf, 1.5.4
        ratio = 1.0 / ratio
        phase = 2.0 * np.arctan2(cosine * np.sqrt(sine**2 - ratio**2), sine**2)
        ways = back
        parts = (1.0, np.exp(1j * phase))
        ahead = False
    else:
        before = np.arcsin(sine)
        after = np.arcsin(ratio * sine)
        tangent = (d - cosine * n) * ratio
        ways = tangent + np.cos(after) * n
        ahead = True
        if before < 1e-6:
            parts = (np.sqrt(4.0 * ratio / (1.0 + ratio) ** 2),) * 2
        else:
            r_s = np.sin(before - after) / np.sin(before + after)
            r_p = np.tan(before - after) / np.tan(before + after)
            parts = np.sqrt(1.0 - r_s**2), np.sqrt(1.0 - r_p**2)
    turn = parts[0] * np.outer(s, s) + parts[1] * np.outer(np.cross(ways, s), np.cross(d, s))
    behind = turn @ coherency @ turn.conj().T
    return ways, behind, ahead, float((np.trace(coherency) - np.trace(behind)).real) if mirror is not None else 0.0
