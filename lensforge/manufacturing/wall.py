"""Wall thickness: radial, which the design constrains, and along the normal, which is the actual thickness.

The thickness along the normal is cast from the cavity outwards. At the thinnest place the shortest line between the
faces is perpendicular to both, so starting from the outer face would give the same minimum. Lines that leave the
hemisphere below z = 0 run into the base and are not counted, so at the rim the radial wall may be the thinner one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.geometry.acceptance import FORM_LIMIT_NM
from lensforge.geometry.patch import Patch
from lensforge.manufacturing.face import FaceSamples, OpticalFace
from lensforge.manufacturing.result import Wall
from lensforge.surfaces import chart

_TOLERANCE_MM = 1e-10
_STEPS = 40
_RIM_MM = 1e-6 * FORM_LIMIT_NM  # below z = 0: the rim of an exported face is as close to it


@dataclass(frozen=True)
class WallLines:
    """Lines through the wall: starts on the cavity (mm), unit directions, and thickness of the wall along them (mm)."""

    start: Float[np.ndarray, "k 3"]
    direction: Float[np.ndarray, "k 3"]
    thickness_mm: Float[np.ndarray, " k"]


Lines = Callable[[Patch, OpticalFace, Float[np.ndarray, "k 2"]], WallLines]


def radial_lines(inner: Patch, outer: OpticalFace, points: Float[np.ndarray, "k 2"]) -> WallLines:
    """Rays from the origin through the cavity at chart ``points``; negative thickness where the faces intersect."""
    start = inner.points(points)
    radius = np.linalg.norm(start, axis=1)
    return WallLines(start, start / radius[:, None], outer.radius(points) - radius)


def normal_lines(inner: Patch, outer: OpticalFace, points: Float[np.ndarray, "k 2"]) -> WallLines:
    """Normals of the cavity at chart ``points``; NaN thickness where the line ends below z = 0.

    Secant steps on ``|x| - rho(x)`` along the line, started with the radial thickness.
    """
    start, direction = inner.points(points), inner.normals(points)

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
    return WallLines(start, direction, np.where(found, t, np.nan))


def thinnest(inner: FaceSamples, outer: OpticalFace, lines: Lines) -> Wall:
    """The thinnest wall along ``lines`` from the cavity, searched for between its samples too."""
    return _extreme(inner, outer, lines, -1.0)


def thickest(inner: FaceSamples, outer: OpticalFace, lines: Lines) -> Wall:
    """The thickest wall along ``lines``, searched for as the thinnest one is."""
    return _extreme(inner, outer, lines, 1.0)


def _extreme(inner: FaceSamples, outer: OpticalFace, lines: Lines, sign: float) -> Wall:
    patch = inner.face.patch
    sampled = lines(patch, outer, inner.chart).thickness_mm
    place, _ = inner.largest(lambda points: sign * lines(patch, outer, points).thickness_mm, sign * sampled)
    line = lines(patch, outer, place[None])
    start, thickness = line.start[0], float(line.thickness_mm[0])
    end = start + thickness * line.direction[0]
    return Wall(thickness_mm=thickness, inner_point_mm=tuple(start.tolist()), outer_point_mm=tuple(end.tolist()))
