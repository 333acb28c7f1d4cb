"""Wall thickness: radial, which the design constrains, and along the normal, which is the actual thickness.

The thickness along the normal is cast from the cavity outwards. At the thinnest place the shortest line between the
faces is perpendicular to both, so starting from the outer face would give the same minimum. Lines that leave the
hemisphere below z = 0 run into the base and are not counted, so at the rim the radial wall may be the thinner one.
"""

import numpy as np
from jaxtyping import Float

from lensforge.geometry.acceptance import FORM_LIMIT_NM
from lensforge.manufacturing.face import FaceSamples, OpticalFace
from lensforge.manufacturing.result import Wall
from lensforge.surfaces import chart

_TOLERANCE_MM = 1e-10
_STEPS = 40
_RIM_MM = 1e-6 * FORM_LIMIT_NM  # below z = 0: the rim of an exported face is as close to it


def radial_wall_mm(inner: FaceSamples, outer: OpticalFace) -> Float[np.ndarray, " k"]:
    """Thickness (mm) along the ray from the origin through each sample; negative where the faces intersect."""
    wall: Float[np.ndarray, " k"] = outer.radius(inner.chart) - np.linalg.norm(inner.points, axis=1)
    return wall


def normal_wall_mm(inner: FaceSamples, outer: OpticalFace) -> Float[np.ndarray, " k"]:
    """Thickness (mm) along the cavity's normal at each sample, NaN where that line ends below z = 0.

    Secant steps on ``|x| - rho(x)`` along the line, started with the radial thickness.
    """
    start, direction = inner.points, inner.outward

    def outside(t: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        x = start + t[:, None] * direction
        height: Float[np.ndarray, " k"] = np.linalg.norm(x, axis=1) - outer.radius(chart.to_chart(x))
        return height

    before = np.zeros(len(start))
    value_before = outside(before)
    t = -value_before
    for _ in range(_STEPS):
        value = outside(t)
        open_ = np.abs(value) > _TOLERANCE_MM
        if not open_.any():
            break
        rise = value - value_before
        step = np.where(open_ & (rise != 0.0), -value * (t - before) / np.where(rise != 0.0, rise, 1.0), 0.0)
        before, value_before, t = np.where(open_, t, before), np.where(open_, value, value_before), t + step
    end = start + t[:, None] * direction
    found = (np.abs(outside(t)) < 1e3 * _TOLERANCE_MM) & (end[:, 2] >= -_RIM_MM)
    return np.where(found, t, np.nan)


def thinnest(inner: FaceSamples, wall_mm: Float[np.ndarray, " k"], along: Float[np.ndarray, "k 3"]) -> Wall:
    """The smallest of ``wall_mm``, which runs from the samples of ``inner`` along the unit vectors ``along``."""
    return _place(inner, wall_mm, along, int(np.nanargmin(wall_mm)))


def thickest(inner: FaceSamples, wall_mm: Float[np.ndarray, " k"], along: Float[np.ndarray, "k 3"]) -> Wall:
    """The largest of ``wall_mm``, as :func:`thinnest` finds the smallest."""
    return _place(inner, wall_mm, along, int(np.nanargmax(wall_mm)))


def _place(inner: FaceSamples, wall_mm: Float[np.ndarray, " k"], along: Float[np.ndarray, "k 3"], index: int) -> Wall:
    start = inner.points[index]
    end = start + wall_mm[index] * along[index]
    return Wall(
        thickness_mm=float(wall_mm[index]), inner_point_mm=tuple(start.tolist()), outer_point_mm=tuple(end.tolist())
    )
