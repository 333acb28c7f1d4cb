"""Two profiles that send light of a point from each angle in the plane y = 0 to a wanted one: where a search begins.

With t(a) the unit vector at the angle a from z, a ray leaves the point along t(theta), goes on in the body along t(psi)
and leaves along t(phi). The inner face does a share of the turn: psi = theta - share (theta - phi). By Snell's law the
faces are normal to n t(psi) - t(theta) and to n t(psi) - t(phi): both profiles follow from their points on the axis.
How much of the light can be turned, and by which face, is found by a scan.
"""

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.surfaces.drawn_profile import DrawnFace, profile_basis

_STEPS = 240  # on each side of the axis
_WIDEST_RAD = np.radians(85.0)  # of the light that is sent somewhere; beyond, the faces are upright
_TURNS_RAD = np.radians(np.arange(16.0, 61.0, 4.0))  # most by both faces together
_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)  # of the turn, by the inner face
_WALLS = tuple(np.geomspace(0.15, 12.0, 14).tolist())  # over the distance of the inner face on the axis
_WITHIN = 0.97  # of the largest radius
_SPARE = 1.3  # distance along rays over the least wall
_UPRIGHT_RAD = 0.02  # least turn of a profile from one ray to the next, over that of the rays
_SIDES = 60  # angles of an upright side

_Angles = Float[np.ndarray, " n"]
_Points = Float[np.ndarray, "c n 2"]
_EachAngles = Float[np.ndarray, "c n"]


class Room(NamedTuple):
    """Lengths (mm) that profiles are to keep: largest distance from the source, least one, and least wall."""

    largest_mm: float
    clear_mm: float
    wall_mm: float


def tailored_profiles(
    index: float, turned: Callable[[_Angles], _Angles], room: Room, reach_mm: float, count: int
) -> tuple[DrawnFace, DrawnFace] | None:
    """Inner and outer profile, of ``count`` coefficients, that turn most of the light; None if none has ``room``.

    ``index``: of the body over that around. ``turned``: wanted angle (rad) by the angle at which light leaves.
    """
    angles = np.linspace(-_WIDEST_RAD, _WIDEST_RAD, 2 * _STEPS + 1)
    wanted = turned(angles)
    turns, shares, walls = np.array(list(product(_TURNS_RAD, _SHARES, _WALLS))).T
    reached = np.clip(wanted, angles - turns[:, None], angles + turns[:, None])
    inner, outer = _followed(index, angles, reached, shares, walls)
    scale = _WITHIN * room.largest_mm / np.linalg.norm(outer, axis=-1).max(axis=1)
    least_mm = scale * np.linalg.norm(inner, axis=-1).min(axis=1)
    steps = np.diff(angles)
    fits = (scale * _apart(inner, outer, angles, reached, shares) >= _SPARE * room.wall_mm) & (
        least_mm >= room.clear_mm
    )
    for points in (inner, outer):
        fits &= (np.diff(np.arctan2(points[..., 0], points[..., 1]), axis=1) > _UPRIGHT_RAD * steps).all(axis=1)
    light = (np.cos(angles) * (np.abs(reached - wanted) < 1e-9)).sum(axis=1) / np.cos(angles).sum()
    if not fits.any():
        return None
    best = int(np.argmax(np.where(fits, light + 0.1 * least_mm / room.largest_mm, -1.0)))
    return tuple(_fitted(scale[best] * points[best], reach_mm, count) for points in (inner, outer))  # type: ignore[return-value]


def _ways(angles: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    return np.stack([np.sin(angles), np.cos(angles)], axis=-1)


def _apart(
    inner: _Points, outer: _Points, angles: _Angles, reached: _EachAngles, shares: Float[np.ndarray, " c"]
) -> Float[np.ndarray, " c"]:
    """Least path of light in the body; negative where the profiles cross."""
    in_body = _ways(angles - shares[:, None] * (angles - reached))
    return ((outer - inner) * in_body).sum(axis=-1).min(axis=1)


def _followed(
    index: float, angles: _Angles, reached: _EachAngles, shares: Float[np.ndarray, " c"], walls: Float[np.ndarray, " c"]
) -> tuple[_Points, _Points]:
    """Both profiles from the axis outwards, the inner one at 1 on the axis, the outer one a wall above."""
    within = angles - shares[:, None] * (angles - reached)
    ways = np.broadcast_to(_ways(angles), (*reached.shape, 2))
    in_body = _ways(within)
    facing_in = index * in_body - ways
    facing_out = index * in_body - _ways(reached)
    inner, outer = np.empty((2, *ways.shape))
    inner[:, _STEPS] = ways[:, _STEPS]
    outer[:, _STEPS] = ways[:, _STEPS] + walls[:, None] * in_body[:, _STEPS]
    for side in (1, -1):
        for k in range(_STEPS, _STEPS + side * _STEPS, side):
            after = k + side
            inner[:, after] = _met(inner[:, k], facing_in[:, k] + facing_in[:, after], 0.0 * ways[:, k], ways[:, after])
            outer[:, after] = _met(
                outer[:, k], facing_out[:, k] + facing_out[:, after], inner[:, after], in_body[:, after]
            )
    return inner, outer


def _met(
    before: Float[np.ndarray, "c 2"],
    normal: Float[np.ndarray, "c 2"],
    start: Float[np.ndarray, "c 2"],
    way: Float[np.ndarray, "c 2"],
) -> Float[np.ndarray, "c 2"]:
    """Points of rays on the lines across ``normal`` through the points ``before``."""
    path = np.sum((before - start) * normal, axis=1) / np.sum(way * normal, axis=1)
    return start + path[:, None] * way


def _fitted(points: Float[np.ndarray, "n 2"], reach_mm: float, count: int) -> DrawnFace:
    """The profile through ``points`` (x, z), with upright sides below the outermost ones."""
    angles = np.arctan2(points[:, 0], points[:, 1])
    basis = profile_basis(count)
    ends = (basis.low, angles[0]), (basis.high, angles[-1])
    below = [np.linspace(np.pi * end, outermost, _SIDES, endpoint=False) for end, outermost in ends]
    upright = [np.sin(sides) / points[row, 0] for sides, row in zip(below, (0, -1), strict=True)]
    reciprocals = np.concatenate([*upright, 1.0 / np.linalg.norm(points, axis=1)])
    return DrawnFace(reach_mm, basis.nearest(np.concatenate([*below, angles]) / np.pi, reciprocals))
