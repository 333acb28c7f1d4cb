"""An optical face with its derivatives: position over the chart as a quintic spline of the radius.

A shop's questions (curvature, cutter, wall) need second derivatives at many points. The radius is sampled once from
the exact surface; between the nodes an interpolating quintic carries it, so curvature is continuous and its error
falls as the fourth power of the node spacing.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RectBivariateSpline

from lensforge.surfaces import chart
from lensforge.surfaces.srbf import SrbfSurface
from lensforge.surfaces.surface import Surface

NODES_PER_SIGMA = 4.5  # apex nodes for each shape parameter of the narrowest function
_MIN_NODES = 64


@runtime_checkable
class StarShaped(Protocol):
    """A surface given by its distance from the origin in every direction of the hemisphere and a little below."""

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the origin along unit ``directions``."""
        ...


class AirSide(IntEnum):
    """Where the air, and with it the cutter, is: the sign that turns an outward normal into the air-side one."""

    OUTSIDE = 1  # the outer face
    INSIDE = -1  # the cavity


@dataclass(frozen=True)
class Jet:
    """Position (mm) over the chart and its first and second derivatives by the chart coordinates X and Y."""

    point: Float[np.ndarray, "n 3"]
    x: Float[np.ndarray, "n 3"]
    y: Float[np.ndarray, "n 3"]
    xx: Float[np.ndarray, "n 3"]
    xy: Float[np.ndarray, "n 3"]
    yy: Float[np.ndarray, "n 3"]

    @property
    def area_element(self) -> Float[np.ndarray, " n"]:
        """Area (mm^2) of the face for each unit of chart area."""
        area: Float[np.ndarray, " n"] = np.linalg.norm(np.cross(self.x, self.y), axis=1)
        return area


@dataclass(frozen=True)
class OpticalFace:
    """A tabulated optical face; ``chart`` arguments are points of the stereographic chart, rim on the unit circle."""

    spline: RectBivariateSpline
    air: AirSide

    def radius(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the origin at chart ``points``."""
        radius: Float[np.ndarray, " n"] = self.spline.ev(points[:, 0], points[:, 1])
        return radius

    def jet(self, points: Float[np.ndarray, "n 2"]) -> Jet:
        """Position and derivatives at chart ``points``, by the product rule on ``rho u``."""
        X, Y = points.T
        rho, rho_x, rho_y, rho_xx, rho_xy, rho_yy = (
            self.spline.ev(X, Y, dx, dy)[:, None] for dx, dy in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        )
        u, u_x, u_y, u_xx, u_xy, u_yy = _direction_jet(X, Y)
        return Jet(
            point=rho * u,
            x=rho_x * u + rho * u_x,
            y=rho_y * u + rho * u_y,
            xx=rho_xx * u + 2.0 * rho_x * u_x + rho * u_xx,
            xy=rho_xy * u + rho_x * u_y + rho_y * u_x + rho * u_xy,
            yy=rho_yy * u + 2.0 * rho_y * u_y + rho * u_yy,
        )

    def air_normal(self, jet: Jet) -> Float[np.ndarray, "n 3"]:
        """Unit normals that point from the material into the air."""
        outward = np.cross(jet.x, jet.y)
        normal: Float[np.ndarray, "n 3"] = float(self.air) * outward / np.linalg.norm(outward, axis=1, keepdims=True)
        return normal


def _direction_jet(X: Float[np.ndarray, " n"], Y: Float[np.ndarray, " n"]) -> list[Float[np.ndarray, "n 3"]]:
    """``u``, its two first and three second derivatives: ``u = (qX, qY, q - 1)`` with ``q = 2/(1 + X^2 + Y^2)``."""
    q = 2.0 / (1.0 + X * X + Y * Y)
    q_x, q_y = -q * q * X, -q * q * Y
    q_xx, q_xy, q_yy = -q * q * (1.0 - 2.0 * q * X * X), 2.0 * q**3 * X * Y, -q * q * (1.0 - 2.0 * q * Y * Y)
    columns = (
        (q * X, q * Y, q - 1.0),
        (q_x * X + q, q_x * Y, q_x),
        (q_y * X, q_y * Y + q, q_y),
        (q_xx * X + 2.0 * q_x, q_xx * Y, q_xx),
        (q_xy * X + q_y, q_xy * Y + q_x, q_xy),
        (q_yy * X, q_yy * Y + 2.0 * q_y, q_yy),
    )
    return [np.stack(column, axis=-1) for column in columns]


def tabulate_face(surface: StarShaped, air: AirSide, nodes: int) -> OpticalFace:
    """Sample ``surface`` on ``nodes`` x ``nodes`` chart points and interpolate by a quintic spline."""
    grid = chart.grid(nodes)
    directions, axis = chart.to_sphere(grid), grid[:, 0, 0]
    if isinstance(surface, SrbfSurface):
        values = surface.radius_on_grid(directions)
    else:
        values = surface.radius(directions.reshape(-1, 3)).reshape(nodes, nodes)
    return OpticalFace(RectBivariateSpline(axis, axis, values, kx=5, ky=5, s=0), air)


def nodes_for(surface: Surface) -> int:
    """Table size whose apex step is the narrowest feature over ``NODES_PER_SIGMA``."""
    apex_span = 4.0 * chart.HALF_WIDTH  # rad: one chart unit is 2 rad at the apex
    needed = apex_span * NODES_PER_SIGMA / surface.detail_rad
    return max(_MIN_NODES, int(np.ceil(needed)) + 1)
