"""Wall between two faces: the least distance between them, and the largest thickness along rays from the origin.

The least distance is what a caliper finds. Its line is normal to both faces, or ends on a rim, and it crosses nothing
but the wall: from whichever face the lines along the normal start, none that ends at its first hit is shorter.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.cad.patch import Patch
from lensforge.results.refined_maximum import refined_maximum
from lensforge.surfaces import surface

_NODES, _RIM = 101, 512  # samples of each face: across the chart's square, and around the rim
_STARTS, _APART = 12, 3.0  # pairs of points to start from, this many steps of the samples apart
_PRECISION = 1e-14  # of the squared distance, relative
_Point = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Span:
    """A straight line (mm) through the wall between a point of each face; negative where the faces cross."""

    thickness_mm: float
    inner_mm: _Point
    outer_mm: _Point


def thinnest(inner: Patch, outer: Patch) -> Span:
    """The shortest line between the faces above z = 0; where they cross, the deepest place along a ray."""
    from scipy.spatial import cKDTree

    places, step = _samples()
    crossing = _radial(inner, outer, places, step, -1.0)
    if crossing.thickness_mm <= 0.0:
        return crossing
    starts, ends = inner.points(places), outer.points(places)
    distance, nearest = cKDTree(ends).query(starts)
    best = int(distance.argmin())
    found = Span(float(distance[best]), starts[best], ends[nearest[best]])
    for _ in range(_STARTS):
        k = int(distance.argmin())
        if np.isinf(distance[k]):
            break
        line = _shortest_near(inner, outer, np.concatenate([places[k], places[nearest[k]]]))
        found = min(found, line, key=lambda each: each.thickness_mm)
        distance[np.linalg.norm(places - places[k], axis=1) < _APART * step] = np.inf
    return found


def thickest(inner: Patch, outer: Patch) -> Span:
    """The longest part of a ray from the origin between the faces."""
    return _radial(inner, outer, *_samples(), 1.0)


def _samples() -> tuple[Float[np.ndarray, "k 2"], float]:
    """Chart points of the disc and its rim, and their spacing."""
    grid = surface.grid(_NODES, 1.0)
    azimuth = 2.0 * np.pi / _RIM * np.arange(_RIM)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    return np.concatenate([grid[np.sum(grid**2, axis=-1) < 1.0], rim]), 2.0 / (_NODES - 1)


def _radial(inner: Patch, outer: Patch, places: Float[np.ndarray, "k 2"], step: float, sign: float) -> Span:
    """The ray whose ``sign`` times thickness is the largest."""

    def figure(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        radii = (np.linalg.norm(face.points(points), axis=1) for face in (outer, inner))
        signed: Float[np.ndarray, " m"] = sign * np.subtract(*radii)
        return signed

    place, most = refined_maximum(figure, places, figure(places), step)
    return Span(sign * most, inner.points(place), outer.points(place))


def _shortest_near(inner: Patch, outer: Patch, start: Float[np.ndarray, "4"]) -> Span:
    """The shortest line near that between chart points ``start`` of both faces."""
    from scipy.optimize import minimize

    size = float(np.sum((outer.points(start[2:]) - inner.points(start[:2])) ** 2))

    def squared(at: Float[np.ndarray, "4"]) -> tuple[float, Float[np.ndarray, "4"]]:
        one, other = inner.jet(at[None, :2]), outer.jet(at[None, 2:])
        line = (other.point - one.point)[0]
        along = np.stack([-one.x[0], -one.y[0], other.x[0], other.y[0]])
        return float(line @ line) / size, 2.0 * along @ line / size

    of_face = np.repeat(np.eye(2), 2, axis=1)  # 1 - X^2 - Y^2 of each face is at least 0 within its rim
    within = {"type": "ineq", "fun": lambda at: 1.0 - of_face @ at**2, "jac": lambda at: -2.0 * of_face * at}
    options = {"ftol": _PRECISION, "maxiter": 100}
    best = minimize(squared, start, jac=True, bounds=[(-1.0, 1.0)] * 4, constraints=within, options=options).x
    ends = [at / max(1.0, float(np.linalg.norm(at))) for at in (best[:2], best[2:])]
    one, other = inner.points(ends[0]), outer.points(ends[1])
    return Span(float(np.linalg.norm(other - one)), one, other)
