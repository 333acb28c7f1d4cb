"""Concentric rings of points over a dome, the strips of triangles between them, and the count to begin with."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.geometry.outline import FULL_TURN
from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan, rim_directions

_CROSSING_REPLACES = 0.1  # of an azimuth step: a crossing this close to a grid azimuth replaces it
# With 96 rings the verification's cast uses less than half of its deviation limit on the roughest shipped lens, a 7 mm
# one; but the pi of 1,493 functions, whose faces take splines of 214 nodes, uses 1.6 of the limit with 128 rings and
# 0.56 with 160, and the lens for two distances, with 226 nodes and a valley of 0.1 mm in 40 mm, 1.14 with 181 and 0.72
# with 208.
MIN_RINGS, MOST_RINGS = 96, 1000  # 1000 are 12 million triangles
_RINGS_PER_NODE = 0.92  # of the finer face's spline


@dataclass(frozen=True)
class Ring:
    """A closed ring of points (mm) at ascending azimuths (rad); a single point is an apex."""

    azimuths: Float[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    strip: str  # the face between this ring and the next one of the stack


def dome_rings(patch: Patch, rings: int, rim: Float[np.ndarray, " n"], name: str) -> list[Ring]:
    """Rings from the apex to the rim, equally spaced in angle from the axis."""
    azimuths: list[Float[np.ndarray, " _"]] = [np.zeros(1)]
    azimuths += [np.arange(6 * k) * (FULL_TURN / (6 * k)) for k in range(1, rings)]
    directions = [_cone(k * np.pi / (2 * rings), ring) for k, ring in enumerate(azimuths)]
    azimuths.append(rim)
    directions.append(rim_directions(rim))
    together = np.concatenate(directions)
    points = patch.radius(together)[:, None] * together
    parts = np.split(points, np.cumsum([len(ring) for ring in azimuths])[:-1])
    return [Ring(ring, part, name) for ring, part in zip(azimuths, parts, strict=True)]


def rim_azimuths(count: int, crossings: Float[np.ndarray, " k"]) -> Float[np.ndarray, " n"]:
    """``count`` equally spaced azimuths and the crossings, ascending over one turn; no two almost equal."""
    step = FULL_TURN / count
    nearest = np.rint(crossings / step).astype(int)
    close = np.abs(crossings - nearest * step) < _CROSSING_REPLACES * step
    kept = np.setdiff1d(np.arange(count), nearest[close] % count) * step
    wrapped = np.where(close & (nearest == count), crossings - FULL_TURN, crossings)
    return np.sort(np.concatenate([kept, wrapped]))


def zip_rings(
    upper: Ring, lower: Ring, upper_ids: Int[np.ndarray, " n"], lower_ids: Int[np.ndarray, " m"]
) -> Int[np.ndarray, "t 3"]:
    """Triangles between two closed rings, counter-clockwise when seen with ``upper`` as the inner one.

    Edges of both rings are taken in the order of their midpoints, which keeps the diagonals short whatever the two
    vertex counts are. Triangles that a shared vertex makes degenerate are left out.
    """
    n, m = len(upper_ids), len(lower_ids)
    if n == 1:
        around = np.roll(lower_ids, -1)
        return np.stack([np.full(m, upper_ids[0]), lower_ids, around], axis=1)
    if m == 1:
        return np.stack([upper_ids, np.full(n, lower_ids[0]), np.roll(upper_ids, -1)], axis=1)
    order = np.argsort(np.concatenate([_midpoints(upper.azimuths), _midpoints(lower.azimuths)]), kind="stable")
    on_upper = order < n
    i = np.concatenate([[0], np.cumsum(on_upper)])[:-1]
    j = np.arange(n + m) - i
    advanced = np.where(on_upper, upper_ids[(i + 1) % n], lower_ids[(j + 1) % m])
    triangles = np.stack([upper_ids[i % n], lower_ids[j % m], advanced], axis=1)
    distinct = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return triangles[distinct]


def number_rings(stack: list[Ring]) -> list[Int[np.ndarray, " _"]]:
    """Vertex numbers of each ring, counted through the stack."""
    counts = [len(ring.azimuths) for ring in stack]
    return np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])


def _midpoints(azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    midpoints: Float[np.ndarray, " n"] = (azimuths + np.append(azimuths[1:], azimuths[0] + FULL_TURN)) / 2.0
    return midpoints


def _cone(polar: float, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    plane: Float[np.ndarray, "n 3"] = np.sin(polar) * rim_directions(azimuths)
    plane[:, 2] = np.cos(polar)
    return plane


def rings_for(plan: Plan[Patch], chord_mm: float) -> int:
    """Rings to begin with: for the detail of the faces, and for the base's cylinder to be within ``chord_mm``."""
    of_detail = int(np.ceil(_RINGS_PER_NODE * max(plan.inner.nodes, plan.outer.nodes)))
    return min(MOST_RINGS, max(MIN_RINGS, of_detail, _rings_of_base(plan, chord_mm)))


def _rings_of_base(plan: Plan[Patch], chord_mm: float) -> int:
    """Rings for the widest cylinder, from which a polygon of 6 n corners is R (pi / 6n)^2 / 2 away."""
    if not plan.has_base:
        return 0
    radius = (plan.base.flange_diameter_mm or plan.base.widest_mm) / 2.0
    return int(np.ceil(np.pi / 6.0 * np.sqrt(radius / (2.0 * chord_mm))))
