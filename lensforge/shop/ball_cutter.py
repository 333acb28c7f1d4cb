"""The ball cutter: the largest ball that touches a face without gouging, and the height left uncut.

A ball of radius R cuts the point P when its centre ``P + R n`` (n: the air-side normal) is at least R from all of the
part: ``kappa_min >= -1/R``, and no other point Q is inside the ball. The ball through P that also touches Q has the
radius ``|Q - P|^2 / (2 n . (Q - P))``. Shrinking a ball from the local limit, with the nearest neighbour of its centre
as the next Q, finds the largest in a few iterations (J. Ma, S. W. Bae, S. Choi, The Visual Computer 28, 7 (2012)).

The air that a ball sweeps is the union of the balls whose centres are at least R from the part: the uncut height over
an unreached point is its distance to the nearest such centre, minus R.

Q ranges over the samples, so a ball is never too small, and too large by a term that falls with the square of their
spacing: on random cavities, 161 nodes against 321, the reachable fraction changes by 0.1 %, the height by 0.05 um.
"""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from lensforge.cad.part_limits import FIT_TOLERANCE
from lensforge.cad.patch import PrincipalCurvatures
from lensforge.kernels.parallel import in_parallel_map
from lensforge.shop.face_samples import FaceSamples

_GOUGE_MM = 1e-6  # a ball that is this deep in the part still counts as touching
_ROUNDS = 60
# Balls in a cavity are close to very many points at once: scanning large leaves is faster than descending a deep tree.
LEAF = 256
_QUERIES = 1024  # in one part: some milliseconds, against which the start of a part counts nothing
_COARSE = 8  # every eighth obstacle is tested first, which brings the balls close to their final size
# A ball of this many face radii is as good as a plane.
_UNLIMITED = 20.0


@runtime_checkable
class TouchedFace(Protocol):
    """Points (mm) of a face with their unit normals into the air, and curvatures seen from there."""

    @property
    def points(self) -> Float[np.ndarray, "k 3"]: ...  # noqa: D102

    @property
    def normals(self) -> Float[np.ndarray, "k 3"]: ...  # noqa: D102

    @property
    def curvatures(self) -> PrincipalCurvatures: ...  # noqa: D102


def largest_ball_mm(samples: TouchedFace, part: Float[np.ndarray, "m 3"] | None = None) -> Float[np.ndarray, " k"]:
    """Radius (mm) of the largest ball that touches the face at each sample only; infinite if any ball does.

    ``part``: points that must stay outside the ball, by default the samples themselves.
    """
    part = samples.points if part is None else part
    cap = _UNLIMITED * float(np.linalg.norm(samples.points, axis=1).max())
    radius = np.minimum(_local_limit(samples), cap)
    for obstacles in (part[::_COARSE], part):
        _shrink(radius, samples, obstacles)
    return np.where(radius < cap, radius, np.inf)


def _shrink(radius: Float[np.ndarray, " k"], samples: TouchedFace, obstacles: Float[np.ndarray, "m 3"]) -> None:
    """Shrink the balls in place until no obstacle is deeper inside than the tolerance."""
    points = samples.points
    normals = samples.normals
    tree = cKDTree(obstacles, leafsize=LEAF)
    active = np.arange(len(points))
    for _ in range(_ROUNDS):
        centres = points[active] + radius[active, None] * normals[active]
        distance, nearest = nearest_points(tree, centres)
        gouging = distance < radius[active] - _GOUGE_MM
        active = active[gouging]
        nearest = nearest[gouging]
        if not len(active):
            return
        chord = obstacles[nearest] - points[active]
        radius[active] = np.sum(chord * chord, axis=1) / (2.0 * np.sum(normals[active] * chord, axis=1))


def nearest_points(
    tree: cKDTree, points: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Distance (mm) and index of the nearest point of ``tree`` for each of ``points``.

    As ``tree.query(points, workers=-1)``, whose daemon threads run on after an interrupt while the interpreter takes
    their memory away (scipy 1.17: a segmentation fault). Here an interrupt waits for the parts that are being searched.
    """
    parts = [points[start : start + _QUERIES] for start in range(0, len(points), _QUERIES)]
    if len(parts) < 2:
        return tree.query(points)
    answers = in_parallel_map(tree.query, parts)
    return np.concatenate([distance for distance, _ in answers]), np.concatenate([index for _, index in answers])


def reachable(ball_mm: Float[np.ndarray, " k"], cutter_radius_mm: float) -> Bool[np.ndarray, " k"]:
    """True where a cutter touches the face without gouging it elsewhere; ``ball_mm`` as of :func:`largest_ball_mm`."""
    return ball_mm >= cutter_radius_mm * (1.0 - FIT_TOLERANCE)


def _local_limit(samples: TouchedFace) -> Float[np.ndarray, " k"]:
    kappa = samples.curvatures.minimum
    concave = kappa < 0.0
    return np.where(concave, -1.0 / np.where(concave, kappa, -1.0), np.inf)


def residual_height_mm(
    samples: FaceSamples, ball_mm: Float[np.ndarray, " k"], cutter_radius_mm: float
) -> Float[np.ndarray, " k"]:
    """Uncut height (mm) over each sample, 0 where the cutter reaches; all NaN when it reaches nothing.

    ``ball_mm`` is the map of :func:`largest_ball_mm`. The error is of second order in the sample spacing: the
    edge of the reached area, where balls rest on two points at once, is located between the samples.
    """
    reached = reachable(ball_mm, cutter_radius_mm)
    height = np.zeros(len(reached))
    if reached.all():
        return height
    if not reached.any():
        return np.full(len(reached), np.nan)
    centres = samples.points[reached] + cutter_radius_mm * samples.normals[reached]
    centres = np.concatenate([centres, _edge_centres(samples, ball_mm, cutter_radius_mm)])
    distance, _ = cKDTree(centres).query(samples.points[~reached])
    height[~reached] = np.maximum(distance - cutter_radius_mm, 0.0)
    return height


def _edge_centres(
    samples: FaceSamples, ball_mm: Float[np.ndarray, " k"], cutter_radius_mm: float
) -> Float[np.ndarray, "e 3"]:
    """Ball centres over the edge of the reached area: where a grid line's largest ball passes the cutter's radius."""
    tightness = samples.grid.to_map(1.0 / ball_mm - 1.0 / cutter_radius_mm)  # finite where a ball is unlimited
    nodes = samples.grid.to_map(samples.chart)
    crossings = []
    for field, chart in ((tightness, nodes), (tightness.T, nodes.transpose(1, 0, 2))):
        before = field[:-1]
        after = field[1:]
        crossed = before * after < 0.0
        part = (before[crossed] / (before[crossed] - after[crossed]))[:, None]
        crossings.append((1.0 - part) * chart[:-1][crossed] + part * chart[1:][crossed])
    jet = samples.face.patch.jet(np.concatenate(crossings))
    return jet.point + cutter_radius_mm * samples.face.air_normal(jet)
