"""Lenses with closed forms, as meshes: what the tests cast rays into, and what they compare with."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import trimesh

from lensforge.sources.ray_bundle import RayBundle

Radius = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Quadric:
    """An ellipsoid, as a star-shaped surface about the origin, with exact hits and normals."""

    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    semi_axes: tuple[float, float, float] = (1.0, 1.0, 1.0)
    inverse: np.ndarray = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "inverse", 1.0 / np.array(self.semi_axes))

    def far_hit(self, origins, directions):
        """Distance to the far side: the one that a ray from inside meets."""
        p = (origins - np.array(self.centre)) * self.inverse
        d = directions * self.inverse
        a = (d * d).sum(1)
        b = (p * d).sum(1)
        c = (p * p).sum(1) - 1.0
        return (-b + np.sqrt(b * b - a * c)) / a

    def radius(self, u):
        return self.far_hit(np.zeros_like(u), u)

    def normal(self, points):
        n = (points - np.array(self.centre)) * self.inverse**2
        return n / np.linalg.norm(n, axis=1, keepdims=True)


@dataclass(frozen=True)
class Rippled:
    """A sphere under waves in the direction, ``1 + sum a sin(k . u)``: as rough as a small lens, exact normals."""

    size: float
    waves: np.ndarray  # [w, 3], the wave numbers k in 1/rad
    amplitude: float

    def radius(self, u):
        return self.size * (1.0 + self.amplitude * np.sin(u @ self.waves.T).sum(1))

    def normal(self, u):
        """Unit normals at the directions ``u``: u less the tangential gradient of the radius over the radius."""
        gradient = self.size * self.amplitude * np.cos(u @ self.waves.T) @ self.waves
        tangential = gradient - (gradient * u).sum(1, keepdims=True) * u
        n = u - tangential / self.radius(u)[:, None]
        return n / np.linalg.norm(n, axis=1, keepdims=True)


def sphere(radius, centre=(0.0, 0.0, 0.0)):
    return Quadric(centre, (radius,) * 3)


@cache
def rings(count):
    """Directions on the hemisphere in ``count`` rings of 6, 12, 18 ... points, and their triangles."""
    points = [np.array([[0.0, 0.0, 1.0]])]
    first = [0, 1]
    for ring in range(1, count + 1):
        theta = 0.5 * np.pi * ring / count
        phi = np.arange(6 * ring) * np.pi / (3 * ring)
        z = 0.0 if ring == count else np.cos(theta)
        points.append(np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), 0 * phi + z], axis=1))
        first.append(first[-1] + 6 * ring)
    triangles = []
    for ring in range(1, count + 1):
        for sector in range(6):
            for j in range(ring):
                here = [first[ring] + (sector * ring + j + k) % (6 * ring) for k in (0, 1)]
                below = [first[ring - 1] + (sector * (ring - 1) + j + k) % max(6 * (ring - 1), 1) for k in (0, 1)]
                triangles.append([below[0], *here])
                if j < ring - 1:
                    triangles.append([below[0], here[1], below[1]])
    return np.concatenate(points), np.array(triangles)


def band(lower, upper):
    """Triangles between two loops of equally many vertices, outside to the right of lower to upper, anticlockwise."""
    after_lower = np.roll(lower, -1)
    after_upper = np.roll(upper, -1)
    return np.concatenate([np.stack([lower, after_lower, upper], 1), np.stack([after_lower, after_upper, upper], 1)])


def lens_mesh(inner: Radius, outer: Radius, count: int, base=None) -> trimesh.Trimesh:
    """A closed lens; ``base`` = (radius, height) of a cylinder below z = 0 with the cavity's opening through it."""
    directions, dome = rings(count)
    size = len(directions)
    rim = np.arange(len(directions) - 6 * count, len(directions))
    vertices = [directions * outer(directions)[:, None], directions * inner(directions)[:, None]]
    faces = [dome, dome[:, ::-1] + size]
    outer_rim = rim
    inner_rim = rim + size
    if base is None:
        faces.append(band(outer_rim, inner_rim)[:, ::-1])
    else:
        radius, height = base
        circle = directions[rim] * radius
        loops = 2 * size + np.arange(3 * len(rim)).reshape(3, -1)
        drop = np.array([0.0, 0.0, height])
        vertices += [circle, circle - drop, vertices[1][rim] - drop]
        faces += [band(loops[0], outer_rim), band(loops[1], loops[0]), band(loops[2], loops[1])]
        faces.append(band(inner_rim, loops[2]))
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=True)


def lambertian(count, side, seed=0, height=0.0):
    """Rays of 1 W in all from a square of ``side`` mm at z = ``height``."""
    u = np.random.default_rng(seed).random((4, count))
    sine = np.sqrt(u[2])
    phi = 2 * np.pi * u[3]
    directions = np.stack([sine * np.cos(phi), sine * np.sin(phi), np.sqrt(1.0 - u[2])], axis=1)
    origins = np.stack([(u[0] - 0.5) * side, (u[1] - 0.5) * side, np.full(count, height)], axis=1)
    return RayBundle(origins, directions, np.full(count, 1.0 / count))


def snell(directions, normals, ratio):
    """The oracle's own refraction: directions, and the share of unpolarised light."""
    bent, across, within = s_and_p(directions, normals, ratio)
    return bent, 0.5 * (across + within)


def s_and_p(directions, normals, ratio):
    """The tangential part scaled, then Fresnel's sine and tangent laws: directions, and the shares of both."""
    normals = normals * np.sign((directions * normals).sum(1, keepdims=True))
    cosine = (directions * normals).sum(1)
    tangent = ratio * (directions - cosine[:, None] * normals)
    sine = np.linalg.norm(tangent, axis=1)
    lost = sine >= 1.0
    after = np.arcsin(np.where(lost, 0.0, sine))
    before = np.arccos(np.clip(cosine, -1, 1))
    bent = tangent + np.cos(after)[:, None] * normals
    slanted = before > 1e-6
    safe = np.where(slanted, before, 0.5), np.where(slanted, after, 0.3)
    across = (np.sin(safe[0] - safe[1]) / np.sin(safe[0] + safe[1])) ** 2
    within = (np.tan(safe[0] - safe[1]) / np.tan(safe[0] + safe[1])) ** 2
    shares = (1.0 - np.where(slanted, amplitude, ((1 - ratio) / (1 + ratio)) ** 2) for amplitude in (across, within))
    return np.where(lost[:, None], np.nan, bent), *(np.where(lost, 0.0, share) for share in shares)


def oracle(inner: Quadric, outer: Quadric, rays: RayBundle, index: float, distance: float):
    """Landings (NaN where lost), flux, and exit directions by closed forms."""
    points = rays.origins + inner.far_hit(rays.origins, rays.directions)[:, None] * rays.directions
    first, *one = s_and_p(rays.directions, inner.normal(points), 1.0 / index)
    ends = points + outer.far_hit(points, first)[:, None] * first
    second, *other = s_and_p(first, outer.normal(ends), index)
    planes = [np.cross(first, face.normal(place)) for face, place in ((inner, points), (outer, ends))]
    product = np.linalg.norm(planes[0], axis=1) * np.linalg.norm(planes[1], axis=1)
    cosine = np.sum(planes[0] * planes[1], axis=1) / np.where(product > 0.0, product, 1.0)
    # of what s and p carry, the part that stays s and p
    (one_s, one_p) = one
    (other_s, other_p) = other
    differ = 0.25 * (2.0 * cosine**2 - 1.0) * (one_s - one_p) * (other_s - other_p)
    share = 0.25 * (one_s + one_p) * (other_s + other_p) + differ
    lost = (other_s == 0.0) | (points[:, 2] <= 0.0) | (ends[:, 2] <= 0.0) | ~(second[:, 2] > 0.0)
    second = np.where(lost[:, None], np.nan, second)
    landings = ends[:, :2] + (distance - ends[:, 2:]) / second[:, 2:] * second[:, :2]
    return landings, np.where(lost, 0.0, rays.flux * share), second


# Two ellipsoids off the axis on a cylindrical base, which most of these tests cast rays through.
INDEX = 1.4936
DISTANCE = 150.0
BASE = (16.0, 2.0)
INNER = Quadric((0.3, -0.2, 0.1), (6.0, 6.5, 5.5))
OUTER = Quadric((-0.4, 0.3, -0.5), (13.7, 13.0, 14.0))


def right(rings=36, inner=INNER, outer=OUTER, base=BASE):
    """Mesh of the right lens, if no argument changes it."""
    return lens_mesh(inner.radius, outer.radius, rings, base)
