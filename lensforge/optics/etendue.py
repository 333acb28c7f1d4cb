"""Étendue in air (mm^2 sr), which lenses conserve: what a ball of given radius can send into a part of a receiver.

Sources: Winston, Minano and Benitez, *Nonimaging Optics* (2005), chapter 2, for conservation; the projected solid angle
of a sphere seen from a small area is ``pi (r/D)^2 cos(angle)``, Howell's catalogue of view factors, B-42.
"""

from math import pi

import numpy as np
from jaxtyping import Bool, Float


def cell_solid_angles(corners: Float[np.ndarray, "m n 3"]) -> Float[np.ndarray, "k l"]:
    """Solid angles (sr), from the origin, of the cells [row, column] between ``corners``: points or directions.

    Each cell counts as two flat triangles, whose solid angle is exact (Van Oosterom and Strackee, IEEE Trans. Biomed.
    Eng. 30 (1983) 125): exact on a plane, right to the square of a cell's angle elsewhere.
    """
    units = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    a, b, c, d = units[:-1, :-1], units[:-1, 1:], units[1:, 1:], units[1:, :-1]
    cells: Float[np.ndarray, "k l"] = _triangles(a, b, c) + _triangles(a, c, d)
    return cells


def _triangles(
    a: Float[np.ndarray, "k l 3"], b: Float[np.ndarray, "k l 3"], c: Float[np.ndarray, "k l 3"]
) -> Float[np.ndarray, "k l"]:
    """Solid angles of triangles of unit vectors; the volume from differences keeps the digits of small ones."""
    volume = np.abs(np.sum(a * np.cross(b - a, c - a), axis=-1))
    cosines = 1.0 + np.sum(a * b, axis=-1) + np.sum(b * c, axis=-1) + np.sum(c * a, axis=-1)
    angles: Float[np.ndarray, "k l"] = 2.0 * np.arctan2(volume, cosines)
    return angles


def etendue_from_ball(radius_mm: float, solid_angle_sr: float) -> float:
    """Étendue (mm^2 sr) of all light from a ball about the origin to a part of a surface that lies outside the ball.

    From a point of the surface at distance D, seen at the angle t from its normal, the ball fills the projected solid
    angle ``pi (r/D)^2 cos t``. Over an area dA that is ``pi r^2 dA cos t / D^2``, and ``dA cos t / D^2`` is the solid
    angle of dA from the ball's centre: the integral is ``pi r^2`` times the solid angle of the part. In the far field
    ``pi r^2`` is what the ball shows to each direction.
    """
    return pi * radius_mm**2 * solid_angle_sr


def cone_around(
    corners: Float[np.ndarray, "m n 3"], cells: Bool[np.ndarray, "k l"]
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Axis (unit vector) and half angle (rad) of a cone from the origin that holds all chosen ``cells``."""
    units = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    found = np.concatenate([units[:-1, :-1][cells], units[:-1, 1:][cells], units[1:, 1:][cells], units[1:, :-1][cells]])
    axis = found.mean(axis=0)
    axis /= np.linalg.norm(axis)
    return axis, float(np.arccos(np.clip(found @ axis, -1.0, 1.0)).max())
