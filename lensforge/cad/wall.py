"""Wall between cavity and envelope: their least distance, and the largest thickness along rays from the origin.

The least distance is what a caliper finds. Its line is normal to both faces, or ends on a rim, and it crosses nothing
but the wall: from whichever face the lines along the normal start, none that ends at its first hit is shorter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import WHOLE, Boundary, Domain, TrimmedFace, as_pair, lens_boundaries, of_shapes
from lensforge.cad.patch import Patch, fit_patch
from lensforge.results.refined_maximum import refined_maximum
from lensforge.scene.lens import Lens
from lensforge.surfaces import surface
from lensforge.surfaces.surface import to_sphere

_NODES, _RIM = 101, 512  # samples of each face: across the chart's square, and around the rim
_STARTS, _APART = 12, 3.0  # pairs of points to start from, this many steps of the samples apart
_SAME = 1e-12  # of the chart
_FAR = 1e9  # mm: in the directions of an opening
_PRECISION = 1e-14  # of the squared distance, relative
_Point = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Span:
    """A straight line (mm) through the wall between a point of each boundary; negative where they cross."""

    thickness_mm: float
    cavity_mm: _Point
    envelope_mm: _Point


def thinnest(cavity: Patch | Boundary[Patch], envelope: Patch | Boundary[Patch]) -> Span:
    """The shortest line between the boundaries above z = 0; where they cross, the deepest place along a ray."""
    inwards, outwards = as_pair(cavity, envelope)
    crossing = _radial(inwards, outwards, -1.0)
    if crossing.thickness_mm <= 0.0:
        return crossing
    pairs = product(*([face for face in each.faces if not face.is_open] for each in (inwards, outwards)))
    return min((_between(*pair) for pair in pairs), key=lambda each: each.thickness_mm)


def thinnest_of(lens: Lens) -> Span:
    """The shortest line through the wall of ``lens``, between the splines that an export would write."""
    pair = lens_boundaries(lens)
    fits = {face.name: fit_patch(face.shape, extent=face.domain.extent) for each in pair for face in each.of_material}
    return thinnest(*of_shapes(pair, fits))


def thickest(cavity: Patch | Boundary[Patch], envelope: Patch | Boundary[Patch]) -> Span:
    """The longest part of a ray from the origin between the boundaries."""
    return _radial(*as_pair(cavity, envelope), 1.0)


def _between(one: TrimmedFace[Patch], other: TrimmedFace[Patch]) -> Span:
    """The shortest line between two faces."""
    from scipy.spatial import cKDTree

    (places, step), (far_places, _) = _samples(one.domain), _samples(other.domain)
    starts, ends = one.shape.points(places), other.shape.points(far_places)
    distance, nearest = cKDTree(ends).query(starts)
    best = int(distance.argmin())
    found = Span(float(distance[best]), starts[best], ends[nearest[best]])
    for _ in range(_STARTS):
        k = int(distance.argmin())
        if np.isinf(distance[k]):
            break
        line = _shortest_near(one, other, np.concatenate([places[k], far_places[nearest[k]]]))
        found = min(found, line, key=lambda each: each.thickness_mm)
        distance[np.linalg.norm(places - places[k], axis=1) < _APART * step] = np.inf
    return found


def _samples(domain: Domain = WHOLE) -> tuple[Float[np.ndarray, "k 2"], float]:
    """Chart points of a domain and its edges, and their spacing."""
    grid = surface.grid(_NODES, 1.0)
    azimuth = 2.0 * np.pi / _RIM * np.arange(_RIM)
    around = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    inside = grid[np.sum(grid**2, axis=-1) < 1.0]
    edges = [radius[:, None] * around for radius in domain.radii(azimuth)[0 if domain.inside else 1 :]]
    own = np.abs(domain.within(inside) - inside).max(axis=1) < _SAME
    return np.concatenate([inside[own], *edges]), 2.0 / (_NODES - 1)


def _radial(cavity: Boundary[Patch], envelope: Boundary[Patch], sign: float) -> Span:
    """The ray whose ``sign`` times thickness is the largest."""

    def points(boundary: Boundary[Patch], places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 3"]:
        return boundary.by_face(places, lambda face, chosen: face.shape.points(places[chosen]))

    def figure(places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        radii = (np.linalg.norm(points(each, places), axis=1) for each in (envelope, cavity))
        signed: Float[np.ndarray, " m"] = np.where(cavity.closed(to_sphere(places)), sign * np.subtract(*radii), -_FAR)
        return signed

    places, step = _samples()
    place, most = refined_maximum(figure, places, figure(places), step)
    return Span(sign * most, *(points(each, place[None])[0] for each in (cavity, envelope)))


def _shortest_near(one: TrimmedFace[Patch], other: TrimmedFace[Patch], start: Float[np.ndarray, "4"]) -> Span:
    """The shortest line near that between chart points ``start`` of both faces."""
    from scipy.optimize import minimize

    size = float(np.sum((other.shape.points(start[2:]) - one.shape.points(start[:2])) ** 2))

    def squared(at: Float[np.ndarray, "4"]) -> tuple[float, Float[np.ndarray, "4"]]:
        near, far = one.shape.jet(at[None, :2]), other.shape.jet(at[None, 2:])
        line = (far.point - near.point)[0]
        along = np.stack([-near.x[0], -near.y[0], far.x[0], far.y[0]])
        return float(line @ line) / size, 2.0 * along @ line / size

    options = {"ftol": _PRECISION, "maxiter": 100}
    within = {"type": "ineq", **_inside(one.domain, other.domain)}
    best = minimize(squared, start, jac=True, bounds=[(-1.0, 1.0)] * 4, constraints=within, options=options).x
    near, far = one.shape.points(one.domain.within(best[:2])), other.shape.points(other.domain.within(best[2:]))
    return Span(float(np.linalg.norm(far - near)), near, far)


def _inside(one: Domain, other: Domain) -> dict[str, Callable[[Float[np.ndarray, "4"]], Any]]:
    """Numbers at least 0 where both chart points lie in the domains of their faces; slopes where they are known."""
    if not (one.edges or other.edges):
        of_face = np.repeat(np.eye(2), 2, axis=1)  # 1 - X^2 - Y^2 of each face is at least 0 within its rim
        return {"fun": lambda at: 1.0 - of_face @ at**2, "jac": lambda at: -2.0 * of_face * at}

    def room(at: Float[np.ndarray, "4"]) -> Float[np.ndarray, " k"]:
        found = []
        for domain, place in ((one, at[:2]), (other, at[2:])):
            azimuth, squared = np.arctan2(place[1:], place[:1]), place @ place
            found.append((domain.outside.tabulated(azimuth) ** 2 if domain.outside else 1.0) - squared)
            found.append(squared - (domain.inside.tabulated(azimuth) ** 2 if domain.inside else 0.0))
        return np.concatenate([np.atleast_1d(each) for each in found])

    return {"fun": room}
