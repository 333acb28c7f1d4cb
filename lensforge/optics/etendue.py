"""Étendue in air (mm^2 sr), which lenses conserve: what a ball of given radius can send into a part of a plane.

Sources: Winston, Minano and Benitez, *Nonimaging Optics* (2005), chapter 2, for conservation; the projected solid angle
of a sphere seen from a small area is ``pi (r/D)^2 cos(angle)``, Howell's catalogue of view factors, B-42.
"""

from math import acos, pi

import numpy as np
from jaxtyping import Bool, Float


def cell_solid_angles(
    x_mm: Float[np.ndarray, " m"], y_mm: Float[np.ndarray, " n"], distance_mm: float
) -> Float[np.ndarray, "k l"]:
    """Solid angles (sr), from the origin, of the cells between the edges ``y_mm``, ``x_mm`` in z = ``distance_mm``.

    Exact, indexed [row y, column x]: the solid angle of a rectangle with one corner on the axis is
    ``atan(x y / (d sqrt(x^2 + y^2 + d^2)))``. In units of the distance, so that a square does not overflow.
    """
    x, y = x_mm[None, :] / distance_mm, y_mm[:, None] / distance_mm
    corner = np.arctan2(x * y, np.sqrt(1.0 + x**2 + y**2))
    cells: Float[np.ndarray, "k l"] = np.diff(np.diff(corner, axis=0), axis=1)
    return cells


def etendue_from_ball(radius_mm: float, solid_angle_sr: float) -> float:
    """Étendue (mm^2 sr) of all light from a ball about the origin to a part of a plane that lies outside the ball.

    From a point of the plane at distance D, seen at the angle t from the plane's normal, the ball fills the projected
    solid angle ``pi (r/D)^2 cos t``. Over an area dA that is ``pi r^2 dA cos t / D^2``, and ``dA cos t / D^2`` is the
    solid angle of dA from the ball's centre: the integral is ``pi r^2`` times the solid angle of the part.
    """
    return pi * radius_mm**2 * solid_angle_sr


def largest_deviation_rad(refractive_index: float) -> float:
    """Largest angle by which two refractions turn a ray, into a body and out of it: twice ``acos(1/n)``.

    Each turns it by at most the difference between grazing incidence and the critical angle.
    """
    return 2.0 * acos(1.0 / refractive_index)


def cone_around(
    x_mm: Float[np.ndarray, " m"], y_mm: Float[np.ndarray, " n"], distance_mm: float, cells: Bool[np.ndarray, "k l"]
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Axis (unit vector) and half angle (rad) of a cone from the origin that holds all chosen ``cells``."""
    rows, columns = np.nonzero(cells)
    corners = np.concatenate(
        [
            np.stack([x_mm[columns + right], y_mm[rows + up], np.full(len(rows), distance_mm)], axis=1)
            for right in (0, 1)
            for up in (0, 1)
        ]
    )
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    axis = corners.mean(axis=0)
    axis /= np.linalg.norm(axis)
    return axis, float(np.arccos(np.clip(corners @ axis, -1.0, 1.0)).max())
