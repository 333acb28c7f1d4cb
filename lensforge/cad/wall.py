"""Wall between cavity and envelope: their least distance, the largest thickness along rays, and the largest ball.

The least distance is what a caliper finds. Its line is normal to both faces, or ends on a rim, and it crosses nothing
but the wall: from whichever face the lines along the normal start, none that ends at its first hit is shorter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad.boundary import WHOLE, Boundary, Domain, TrimmedFace, as_pair, lens_boundaries
from lensforge.cad.face_tolerance import FaceTolerance
from lensforge.cad.facets import points_in
from lensforge.cad.form_error import fit_boundaries
from lensforge.cad.patch import Patch
from lensforge.results.refined_maximum import refined_maximum
from lensforge.scene.lens import Lens
from lensforge.surfaces import surface
from lensforge.surfaces.surface import to_sphere

_NODES = 101  # samples of each face: across the chart's square
_RIM = 512  # around the rim
_STEP = 2.0 / (_NODES - 1)  # of the chart, from one to the next
_STARTS = 12  # pairs of points to start from
_APART = 3.0  # this many steps of the samples apart
_FIRST = 16  # of the samples, every so many bound the least distance
_LEAF = 64  # points in a leaf of a tree: where all are about as far, a search takes half as long as with 16
_ROUNDING = 1e-9  # relative
_FAR = 1e9  # mm: in the directions of an opening
_PRECISION = 1e-14  # of the squared distance, relative
_SPACINGS = (0.02, 0.003)  # of the points by which a ball grows, over the width of the part
_NEAREST = 1000  # points that limit the ball in each round
_GROWTHS = 40
_GROWN_MM = 1e-6
_TRIED = 12  # sections in which a ball is looked for
_ACROSS = 48  # places along and across each
_Point = Float[np.ndarray, "3"]
_Sections = Float[np.ndarray, "a m 3"]


@dataclass(frozen=True)
class Span:
    """A straight line (mm) through the wall between a point of each boundary; negative where they cross."""

    thickness_mm: float
    cavity_mm: _Point
    envelope_mm: _Point


def thinnest(cavity: Patch | Boundary[Patch], envelope: Patch | Boundary[Patch]) -> Span:
    """The shortest line between the boundaries above z = 0; if they cross, the deepest place along a ray."""
    inwards, outwards = as_pair(cavity, envelope)
    crossing = _radial(inwards, outwards, -1.0)
    if crossing.thickness_mm <= 0.0:
        return crossing
    samples = [[_Samples.of(face) for face in boundary.faces if not face.is_open] for boundary in (inwards, outwards)]
    pairs = _nearest(*samples)
    shortest = Span(np.inf, np.zeros(3), np.zeros(3))
    for pair in sorted(pairs, key=lambda pair: float(pair[2].min())):
        shortest = _shorter(shortest, *pair)
    return shortest


def thinnest_of(lens: Lens) -> Span:
    """The shortest line through the wall of ``lens``, between splines as exported by default.

    Their form is only measured at samples: to search between these, too, takes two to three times as long.
    """
    return thinnest(*fit_boundaries(lens_boundaries(lens), {}, tolerance=FaceTolerance(), between=False))


def thickest(cavity: Patch | Boundary[Patch], envelope: Patch | Boundary[Patch]) -> Span:
    """The longest part of a ray from the origin between the boundaries."""
    return _radial(*as_pair(cavity, envelope), 1.0)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples of a face: chart points, points (mm), and the face's largest distance (mm) from the nearest."""

    face: TrimmedFace[Patch]
    places: Float[np.ndarray, "k 2"]
    points: Float[np.ndarray, "k 3"]
    reach_mm: Float[np.ndarray, " k"]

    @staticmethod
    def of(face: TrimmedFace[Patch]) -> "_Samples":
        """Samples all over a face; none is farther off than half of a cell's diagonal."""
        places = _samples(face.domain)
        points, *tangents = face.shape.tangents(places)
        return _Samples(face, places, points, _STEP * np.linalg.norm(tangents, axis=-1).max(axis=0))


_Nearest = tuple[_Samples, _Samples, Float[np.ndarray, " k"], Int[np.ndarray, " k"]]


def _nearest(inner: list[_Samples], outer: list[_Samples]) -> list[_Nearest]:
    """Every two faces; for each sample of the inner one the distance (mm) to the nearest of the outer, and that one.

    The distance is infinite where the shortest line cannot end: all around a cavity the samples of the envelope are
    about as far, and a search for the nearest would look at each.
    """
    from scipy.spatial import cKDTree

    trees = [cKDTree(samples.points, leafsize=_LEAF) for samples in outer]
    least = min(tree.query(samples.points[::_FIRST])[0].min() for samples, tree in product(inner, trees))
    pairs = []
    for inner_samples, (outer_samples, tree) in product(inner, zip(outer, trees, strict=True)):
        most = np.hypot(least, inner_samples.reach_mm.max() + outer_samples.reach_mm.max()) * (1.0 + _ROUNDING)
        distance, nearest = tree.query(inner_samples.points, distance_upper_bound=most)
        pairs.append((inner_samples, outer_samples, distance, np.minimum(nearest, len(outer_samples.points) - 1)))
    return pairs


def _shorter(
    known: Span, inner: _Samples, outer: _Samples, distance: Float[np.ndarray, " k"], nearest: Int[np.ndarray, " k"]
) -> Span:
    """The shortest line between two faces, or the ``known`` one if that is as short.

    ``distance`` (mm), ``nearest``: of each sample of ``inner`` to the nearest of ``outer``. A line has samples beside
    both of its ends, which are beside it by their reach, and across it, since the shortest is normal to both faces, or
    to the edges on which it ends: where a line would be longer than the shortest so far even so, none is sought.
    """
    best = int(distance.argmin())
    places = inner.places
    far = outer.places[nearest]
    least = distance**2 - (inner.reach_mm + outer.reach_mm[nearest]) ** 2
    shortest = min(known, Span(float(distance[best]), inner.points[best], outer.points[nearest[best]]), key=_thickness)
    for _ in range(_STARTS):
        if not (least[np.isfinite(distance)] < shortest.thickness_mm**2).any():
            break
        k = int(distance.argmin())
        if least[k] < shortest.thickness_mm**2:
            shortest = min(
                shortest, _shortest_near(inner.face, outer.face, np.concatenate([places[k], far[k]])), key=_thickness
            )
        distance[np.linalg.norm(places - places[k], axis=1) < _APART * _STEP] = np.inf
    return shortest


def _thickness(span: Span) -> float:
    return span.thickness_mm


def _samples(domain: Domain = WHOLE) -> Float[np.ndarray, "k 2"]:
    grid = surface.grid(_NODES, 1.0)
    azimuth = 2.0 * np.pi / _RIM * np.arange(_RIM)
    around = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    inside = grid[np.sum(grid**2, axis=-1) < 1.0]
    edges = [radius[:, None] * around for radius in domain.radii(azimuth)[0 if domain.inside else 1 :]]
    return np.concatenate([inside[domain.holds(inside)], *edges])


def _radial(cavity: Boundary[Patch], envelope: Boundary[Patch], sign: float) -> Span:
    """The ray whose ``sign`` times thickness is the largest."""

    def figure(places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        directions = to_sphere(places)
        thickness = envelope.radius(directions) - cavity.radius(directions)
        return np.where(cavity.closed(directions), sign * thickness, -_FAR)

    turn = np.linspace(0.0, 2.0 * np.pi, _RIM, endpoint=False)
    creases = [crease for side in (cavity, envelope) for crease in side.creases if crease is not side.opening]
    domain = Domain(section=cavity.section)
    places = np.concatenate([_samples(domain), *(crease.chart(turn) for crease in creases)])
    place, most = refined_maximum(figure, places, figure(places), _STEP, within=domain.within)
    return Span(sign * most, *(points_in(boundary, to_sphere(place[None]))[0] for boundary in (cavity, envelope)))


def _shortest_near(inner: TrimmedFace[Patch], outer: TrimmedFace[Patch], start: Float[np.ndarray, "4"]) -> Span:
    from scipy.optimize import minimize

    size = float(np.sum((outer.shape.points(start[2:]) - inner.shape.points(start[:2])) ** 2))

    def squared(at: Float[np.ndarray, "4"]) -> tuple[float, Float[np.ndarray, "4"]]:
        (near, *back) = inner.shape.tangents(at[:2])
        (far, *ahead) = outer.shape.tangents(at[2:])
        line = far - near
        along = np.stack([-back[0], -back[1], *ahead])
        return float(line @ line) / size, 2.0 * along @ line / size

    options = {"ftol": _PRECISION, "maxiter": 100}
    within = {"type": "ineq", **_inside(inner.domain, outer.domain)}
    best = minimize(squared, start, jac=True, bounds=[(-1.0, 1.0)] * 4, constraints=within, options=options).x
    near = inner.shape.points(inner.domain.within(best[:2]))
    far = outer.shape.points(outer.domain.within(best[2:]))
    return Span(float(np.linalg.norm(far - near)), near, far)


def _inside(inner: Domain, outer: Domain) -> dict[str, Callable[[Float[np.ndarray, "4"]], Any]]:
    """Numbers at least 0 where both chart points lie in the domains of their faces; slopes where they are known."""
    if not (inner.edges or outer.edges):
        of_face = np.repeat(np.eye(2), 2, axis=1)  # 1 - X^2 - Y^2 of each face is at least 0 within its rim
        return {"fun": lambda at: 1.0 - of_face @ at**2, "jac": lambda at: -2.0 * of_face * at}

    def room(at: Float[np.ndarray, "4"]) -> Float[np.ndarray, " k"]:
        margins = []
        for domain, place in ((inner, at[:2]), (outer, at[2:])):
            azimuth = np.arctan2(place[1:], place[:1])
            squared = place @ place
            margins.append((domain.outer_edge.tabulated(azimuth) ** 2 if domain.outer_edge else 1.0) - squared)
            margins.append(squared - (domain.inside.tabulated(azimuth) ** 2 if domain.inside else 0.0))
        return np.concatenate([np.atleast_1d(margin) for margin in margins])

    return {"fun": room}


def largest_ball(sections: _Sections) -> tuple[float, _Point]:
    """Diameter (mm) and centre of the largest ball within the body, to 0.2 %: what a moulder calls its thickness.

    ``sections``: points all around the body's outline on one side of the axis, at even azimuths. The distance of a
    point is a convex function of the centre: its tangent plane never overestimates the room.
    """
    from scipy.spatial import cKDTree

    points = sections.reshape(-1, 3)
    starts = _places_within(sections)
    trees = [cKDTree(_thinned(points, share * np.ptp(points[:, 0]))) for share in _SPACINGS]
    centre = starts[np.argmax(trees[0].query(starts)[0])]
    for tree in trees:
        centre = _grown(tree, centre)
    return 2.0 * float(trees[-1].query(centre)[0]), centre


def _thinned(points: Float[np.ndarray, "n 3"], spacing_mm: float) -> Float[np.ndarray, "k 3"]:
    """One point of each cell of a cubic grid."""
    cells = np.round(points / spacing_mm).astype(int)
    cells -= cells.min(axis=0)
    numbers = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    return np.asarray(points[np.unique(numbers, return_index=True)[1]])


def _places_within(sections: _Sections) -> Float[np.ndarray, "n 3"]:
    places = []
    for section in sections[:: max(len(sections) // _TRIED, 1)]:
        across = np.hypot(section[:, 0], section[:, 1])
        height = section[:, 2]
        around = section[np.argmax(across)] / across.max()
        r, z = np.meshgrid(*(np.linspace(line.min(), line.max(), _ACROSS) for line in (across, height)))
        level = z[:, :1]
        crossed = (height[:-1] > level) != (height[1:] > level)
        rise = np.where(height[1:] == height[:-1], 1.0, height[1:] - height[:-1])
        crossing_mm = np.where(crossed, across[:-1] + (level - height[:-1]) / rise * np.diff(across), -np.inf)
        inside = np.sum(crossing_mm[:, None] > r[..., None], axis=-1) % 2 == 1
        places.append(np.column_stack([r[inside, None] * around[:2], z[inside]]))
    return np.concatenate(places)


def _grown(tree: Any, centre: _Point) -> _Point:
    """The centre of the largest ball near one about ``centre`` with no point of ``tree`` in it.

    It moves by at most half of the distance that the nearest points leave to all others.
    """
    from scipy.optimize import linprog

    for _ in range(_GROWTHS):
        distance, nearest = tree.query(centre, k=min(_NEAREST, tree.n))
        away = centre - tree.data[nearest]
        reach = 0.5 / 3.0**0.5 * (distance[-1] - distance[0])
        rows = np.column_stack([-away / distance[:, None], np.ones(len(away))])
        best = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=distance, bounds=[(-reach, reach)] * 3 + [(0.0, None)])
        if best.x is None or best.x[3] < distance[0] + _GROWN_MM:
            break
        centre = centre + best.x[:3]
    return centre
