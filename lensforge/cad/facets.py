"""Flat facets against the surface that they stand for: their distance, and their refinement to a tolerance.

The distance has its maxima at the middle of an edge or inside the facet: looked at above the facets' centres alone, it
is up to 30 % too small. A few points of each facet show which facets are worst; on these the maximum is sought.

The distance varies by a factor of 20 over a freeform face: equal rings that are fine enough for its steepest place need
five times the triangles (3.2 million instead of 0.68 million on the design for two distances). Facets are therefore
split where they are too far from the surface, and left alone elsewhere.

An edge that is too far from the surface gets a vertex in its middle, on the surface, and both of its facets are split
there, so no gap opens. A facet that is split anywhere is also split at its longest edge, which keeps its angles from
becoming ever smaller (M. C. Rivara, Int. J. Numer. Meth. Eng. 20, 745 (1984)). Edges on rim and creases stay: base and
neighbours share them; the azimuths of these curves are chosen for the same tolerance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.cad.boundary import StarShaped
from lensforge.cad.outline import FULL_TURN
from lensforge.cad.patch import Patch
from lensforge.errors import InputError
from lensforge.results.refined_maximum import Places, refined_maximum
from lensforge.surfaces.surface import to_chart

_WORST = 64  # facets on which the maximum is sought
# Search about the middle of an edge or the centre of a facet.
_REACH = 0.25
_SEARCH_ROUNDS = 6
MIDDLES = (np.eye(3) + np.roll(np.eye(3), -1, axis=0)) / 2.0  # of the edges, each from a corner to the next
INSIDE = np.concatenate([MIDDLES, np.full((1, 3), 1.0 / 3.0)])  # where a facet is far from its surface


def facet_error(patch: Patch, vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> float:
    """Largest distance (mm) of facets with corners among ``vertices`` (mm) from ``patch``, anywhere on the facets."""
    corners = vertices[triangles]
    return largest_distance(patch, corners, _away(patch, corners))


def largest_distance(patch: Patch, corners: Float[np.ndarray, "t 3 3"], away: Float[np.ndarray, "t 4"]) -> float:
    """Largest distance (mm) of any facet, refined on the worst; ``away``: distances at points ``INSIDE`` of each."""
    worst = np.argsort(-away.max(axis=1), kind="stable")[:_WORST]

    def distance(places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        points = places.reshape(len(worst), -1, 2)
        barycentric = np.concatenate([points, 1.0 - points.sum(axis=2, keepdims=True)], axis=2)
        return distances(patch, corners[worst], barycentric).ravel()

    starts = INSIDE[away[worst].argmax(axis=1), :2]
    known = away[worst].max(axis=1)
    return refined_maximum(distance, starts, known, _REACH, starts=_WORST, rounds=_SEARCH_ROUNDS, within=_in_triangle)[
        1
    ]


def _in_triangle(places: Places) -> Places:
    """Places by their first two barycentric coordinates, moved into the triangle."""
    inside = np.maximum(places, 0.0)
    return inside / np.maximum(1.0, inside.sum(axis=-1, keepdims=True))


def distances(
    patch: Patch, corners: Float[np.ndarray, "t 3 3"], barycentric: Float[np.ndarray, "t m 3"]
) -> Float[np.ndarray, "t m"]:
    """Distance (mm) from the facet's plane of the surface above points of the facet."""
    from_corner = patch.points(to_chart(barycentric @ corners)) - corners[:, :1]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    return np.abs(from_corner @ normals[:, :, None])[..., 0]


CHORD_MM = 2e-3  # of any face that is milled or moulded a fifth of the form; light sees the normals between vertices
MOST_TRIANGLES = 1_400_000  # of one face: files of up to 3 million are read; the shipped designs take up to 0.4 million
_AIM = 0.9  # of the tolerance, at the points that are looked at; the largest distance of a facet may be between them
_SPLIT_ROUNDS = 16


@dataclass(frozen=True)
class Facets:
    """Vertices (mm) and triangles of an open face, and the distance (mm) of each facet at its middles and centre."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    away: Float[np.ndarray, "t 4"]

    def far(self, aim_mm: float, chord_mm: float) -> Bool[np.ndarray, "t 4"]:
        """Mask of the places beyond ``aim_mm``; on edges that are not split, those of the face, beyond ``chord_mm``.

        The facet beside such an edge would be split without end: the nearer its third corner comes, the more the edge
        tilts it by the height of its own chord.
        """
        far = self.away > aim_mm
        if far[:, :3].any():
            far[:, :3] &= self.edges.free[self.edges.numbers] | (self.away[:, :3] > chord_mm)
        return far

    @cached_property
    def edges(self) -> "_Edges":
        """The edges of the facets."""
        starts = self.triangles
        ends = np.roll(self.triangles, -1, axis=1)
        keys = np.minimum(starts, ends) * len(self.vertices) + np.maximum(starts, ends)
        _, first, numbers, uses = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
        length = np.linalg.norm(self.vertices[ends] - self.vertices[starts], axis=2)
        return _Edges(numbers.reshape(-1, 3), length, uses > 1, starts.ravel()[first], ends.ravel()[first])


class _Edges(NamedTuple):
    """Edges of facets: their ``numbers`` and ``length`` (mm), from each corner of each facet to the next.

    ``free``: of those that two facets share; others lie on the edge of the face. ``starts``, ``ends``: their vertices.
    """

    numbers: Int[np.ndarray, "t 3"]
    length: Float[np.ndarray, "t 3"]
    free: Bool[np.ndarray, " e"]
    starts: Int[np.ndarray, " e"]
    ends: Int[np.ndarray, " e"]


Curve = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n 3"]]  # points (mm) over azimuth (rad)


def refined_azimuths(
    curves: tuple[Curve, ...], azimuths: Float[np.ndarray, " n"], chord_mm: float
) -> Float[np.ndarray, " m"]:
    """``azimuths``, with more in between until the chords of every closed curve are within ``chord_mm``."""
    for _ in range(_SPLIT_ROUNDS):
        ahead = np.append(azimuths[1:], azimuths[0] + FULL_TURN)
        middle = (azimuths + ahead) / 2.0
        far = np.zeros(len(azimuths), dtype=bool)
        for curve in curves:
            start, end, between = (curve(turn) for turn in (azimuths, ahead, middle))
            chord = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
            far |= np.linalg.norm(np.cross(between - start, chord), axis=1) > _AIM * chord_mm
        if not far.any():
            return azimuths
        azimuths = np.sort(np.concatenate([azimuths, middle[far]]))
    return azimuths


def points_in(shape: StarShaped, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Points (mm) of a surface in unit ``directions``."""
    return shape.radius(directions)[:, None] * directions


def refined_dome(
    patch: Patch, vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"], chord_mm: float
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "u 3"]]:
    """Vertices and triangles of an open dome whose facets are all within ``chord_mm`` of ``patch``.

    The given vertices come first. Raises :class:`InputError` if that takes too many triangles, or more rounds of
    splitting than a smooth face needs.
    """
    facets = Facets(vertices, triangles, _away(patch, vertices[triangles]))
    aim = _AIM
    for _ in range(_SPLIT_ROUNDS):
        far = facets.far(aim * chord_mm, chord_mm)
        if not far.any():
            if largest_distance(patch, facets.vertices[facets.triangles], facets.away) <= chord_mm:
                return facets.vertices, facets.triangles
            aim *= _AIM  # the largest distance lies between the points that are looked at
            continue
        facets = _split(patch, facets, far)
        if len(facets.triangles) > MOST_TRIANGLES:
            raise _not_within(chord_mm, f"with {MOST_TRIANGLES} triangles, the most that are made")
    raise _not_within(chord_mm, f"after {_SPLIT_ROUNDS} rounds of splitting")


def _not_within(chord_mm: float, why: str) -> InputError:
    return InputError(
        f"the facets of a face are not all within {1e3 * chord_mm:g} um of it {why}; export with a number of rings, "
        "--rings 300: their distance is stated"
    )


def _away(patch: Patch, corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 4"]:
    return distances(patch, corners, np.broadcast_to(INSIDE, (len(corners), *INSIDE.shape)))


def _split(patch: Patch, facets: Facets, far: Bool[np.ndarray, "t 4"]) -> Facets:
    """The facets with a vertex in the middle of each ``far`` edge, and of the edges that must follow."""
    edges = facets.edges
    marked = _marked(edges, far)
    middle = (facets.vertices[edges.starts[marked]] + facets.vertices[edges.ends[marked]]) / 2.0
    direction = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    vertices = np.concatenate([facets.vertices, points_in(patch, direction)])
    new = np.full(len(edges.free), -1)
    new[marked] = len(facets.vertices) + np.arange(len(middle))
    edge = edges.numbers
    cut = (new[edge] >= 0).any(axis=1)
    children = _children(facets.triangles[cut], new[edge[cut]], edges.length[cut])
    return Facets(
        vertices,
        np.concatenate([facets.triangles[~cut], children]),
        np.concatenate([facets.away[~cut], _away(patch, vertices[children])]),
    )


def _marked(edges: _Edges, far: Bool[np.ndarray, "t 4"]) -> Bool[np.ndarray, " e"]:
    """Edges to split: those that are far, the longest free one of a far facet without any, and of every split facet."""
    edge = edges.numbers
    longest = edge[np.arange(len(edge)), np.argmax(np.where(edges.free[edge], edges.length, 0.0), axis=1)]
    marked = np.zeros(len(edges.free), dtype=bool)
    marked[edge[far[:, :3]]] = True
    marked[longest[far.any(axis=1)]] = True
    while True:
        marked &= edges.free
        follow = longest[marked[edge].any(axis=1)]
        if marked[follow].all():
            return marked
        marked[follow] = True


def _children(
    triangles: Int[np.ndarray, "t 3"], new: Int[np.ndarray, "t 3"], length: Float[np.ndarray, "t 3"]
) -> Int[np.ndarray, "c 3"]:
    """Halves of each triangle at its longest split edge, and halves of those at the others; ``new``: -1 for none."""
    rows = np.arange(len(triangles))[:, None]
    turn = (np.argmax(np.where(new >= 0, length, -1.0), axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = triangles[rows, turn].T
    middle, right, left = new[rows, turn].T
    parts = []
    for first, two, between in ((b, c, right), (c, a, left)):
        whole = between < 0
        parts.append(np.stack([middle, first, np.where(whole, two, between)], axis=1))
        parts.append(np.stack([middle, between, two], axis=1)[~whole])
    return np.concatenate(parts)
