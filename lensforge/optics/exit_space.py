"""The space that all light of a lens leaves, and the étendue from it to parts of a surface or to directions.

No optics raises radiance: light that leaves a space and reaches a part of a surface has at most the étendue of all
lines through both (Winston, Minano and Benitez, Nonimaging Optics, 2005, chapter 2), however the space is filled. From
a point of a surface of normal n, lines to directions w count with ``|n w| dw``, at most pi. A plane lands a ray by its
line (``kernels.landing``), so that lines count on both sides of it: a bound holds for a lens that pierces the plane.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from math import pi
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lensforge.optics.fundamental_limits import cell_solid_angles, etendue_from_ball

_AZIMUTHS = 24  # over which lines are summed: 5e-4 of the étendue of a region
_FEW = 12  # and from far beside the axis
_BESIDE = 3.0  # radii of a column: that far
_NEAR = 257  # radii of a level plane up to twice that of a column
_FAR = 1200  # radii beyond
_FARTHEST = 1e6  # relative to the radius of a column
_FINEST = 8  # sub-cells along a side of a cell, as long as there are few cells
_MOST_CELLS = 128
_TINY = np.finfo(float).tiny

Corners = Float[np.ndarray, "m n 3"]
Images = Float[np.ndarray, "k h w"]
_Points = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, "*n"]


@runtime_checkable
class ExitSpace(Protocol):
    """A space that all light leaves, or several alternatives of which a lens has one."""

    @property
    def radius_mm(self) -> float:
        """Largest distance of its points from the axis."""
        ...

    @property
    def flux_upwards_mm2_sr(self) -> Float[np.ndarray, " k"]:
        """Étendue of all its lines, each counted once: that of an endless level plane, for each of the spaces."""
        ...

    def grown(self, by_mm: float) -> "ExitSpace":
        """The space, grown by ``by_mm`` on all sides."""
        ...

    def finer(self, cells: int) -> int:
        """Number of sub-cells along a cell's side at which sums are accurate, for ``cells`` cells along a surface."""
        ...

    def etendues(self, corners: Corners, *, far: bool) -> Images:
        """Étendue (mm^2 sr) to the cells [row, column] between ``corners``, for each of the spaces.

        ``far``: corners are directions; else points (mm) of a surface whose normal, from x towards y, leads away.
        """
        ...


@dataclass(frozen=True)
class ExitBall:
    """The ball about the origin."""

    radius_mm: float

    @property
    def flux_upwards_mm2_sr(self) -> Float[np.ndarray, " k"]:
        """Étendue of all its lines, each counted once."""
        return np.array([etendue_from_ball(self.radius_mm, 2.0 * pi)])

    def grown(self, by_mm: float) -> "ExitBall":
        """A larger ball."""
        return ExitBall(self.radius_mm + by_mm)

    def finer(self, cells: int) -> int:
        """One: solid angles of cells are exact."""
        return 1

    def etendues(self, corners: Corners, *, far: bool) -> Images:
        """Étendue (mm^2 sr) to each cell."""
        return etendue_from_ball(self.radius_mm, 1.0) * cell_solid_angles(corners)[None]


@dataclass(frozen=True)
class DrawnBall(ExitBall):
    """The ball about a lens that is drawn along y, whose section lies within ``section_mm`` of the y axis.

    Such a lens keeps the part of a direction along y.
    """

    section_mm: float

    def grown(self, by_mm: float) -> "DrawnBall":
        """A larger ball, and a larger section."""
        return DrawnBall(self.radius_mm + by_mm, self.section_mm + by_mm)


@dataclass(frozen=True)
class ExitColumn:
    """The part of a cylinder about the axis between the heights of one of its ``slabs_mm``, which may be a disc.

    ``upward``: light leaves it upwards alone.
    """

    radius_mm: float
    slabs_mm: tuple[tuple[float, float], ...]
    upward: bool = False

    @staticmethod
    def of_mouth(radius_mm: float, most_height_mm: float, slabs: int = 12) -> "ExitColumn":
        """A disc of unknown height: slabs of equal height, one of which contains it."""
        edges = np.linspace(0.0, most_height_mm, slabs + 1).tolist()
        return ExitColumn(radius_mm, tuple(pairwise(edges)), upward=True)

    @property
    def flux_upwards_mm2_sr(self) -> Float[np.ndarray, " k"]:
        """Étendue of all its lines, each counted once: of both its ends, and of its side."""
        return np.asarray(pi**2 * self.radius_mm * (self.radius_mm + self._thick_mm))

    @property
    def _thick_mm(self) -> Float[np.ndarray, " k"]:
        return np.asarray(np.ptp(np.array(self.slabs_mm), axis=1))

    def grown(self, by_mm: float) -> "ExitColumn":
        """A column of a larger radius, whose slabs end higher."""
        slabs = tuple((low, high + by_mm) for low, high in self.slabs_mm)
        return replace(self, radius_mm=self.radius_mm + by_mm, slabs_mm=slabs)

    def finer(self, cells: int) -> int:
        """Sub-cells, at whose middles étendue is taken."""
        return max(1, min(_FINEST, _MOST_CELLS // cells))

    def etendues(self, corners: Corners, *, far: bool) -> Images:
        """Étendue (mm^2 sr) to each cell."""
        middles = 0.25 * (corners[:-1, :-1] + corners[:-1, 1:] + corners[1:, 1:] + corners[1:, :-1])
        if far:
            return np.asarray(self._shown(middles) * cell_solid_angles(corners))
        across = np.cross(corners[1:, 1:] - corners[:-1, :-1], corners[1:, :-1] - corners[:-1, 1:])
        areas = 0.5 * np.linalg.norm(across, axis=-1)
        normals = 0.5 * across / np.maximum(areas, _TINY)[..., None]
        height = float(middles[0, 0, 2])
        if np.allclose(normals[..., 2], 1.0, atol=1e-9) and np.allclose(middles[..., 2], height, atol=1e-9):
            radii, known = _on_level(self, height)
            away = np.hypot(middles[..., 0], middles[..., 1])
            return np.asarray([np.interp(away, radii, known_row) * areas for known_row in known])
        projected = self.projected_sr(middles.reshape(-1, 3), normals.reshape(-1, 3))
        return np.asarray(projected.reshape(-1, *areas.shape) * areas)

    def _shown(self, directions: Float[np.ndarray, "h w 3"]) -> Images:
        """Area (mm^2) across each direction; for light leaving a disc independent of its height."""
        units = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        ends = pi * self.radius_mm**2 * units[..., 2]
        across = np.hypot(units[..., 0], units[..., 1])
        if self.upward:
            return np.asarray(np.maximum(ends, 0.0)[None])
        return np.asarray(np.abs(ends) + 2.0 * self.radius_mm * self._thick_mm[:, None, None] * across)

    def projected_sr(self, points: _Points, normals: _Points) -> Float[np.ndarray, "k n"]:
        """Projected solid angle (sr) of each slab, from ``points`` (mm) of surfaces with these ``normals``."""
        projected = np.empty((len(self.slabs_mm), len(points)))
        beside = np.hypot(points[:, 0], points[:, 1]) > _BESIDE * self.radius_mm
        for rows, azimuths in ((beside, _FEW), (~beside, _AZIMUTHS)):
            projected[:, rows] = self._summed(points[rows], normals[rows], azimuths)
        return np.minimum(projected, pi)

    def _summed(self, points: _Points, normals: _Points, azimuths: int) -> Float[np.ndarray, "k n"]:
        """Integrate over the azimuth: in each half-plane a slab is a rectangle, bound by angles of its corners."""
        turns, weights, near, beyond = self._half_planes(np.hypot(points[:, 0], points[:, 1]), azimuths)
        towards = np.arctan2(-points[:, 1], -points[:, 0])[:, None] + turns
        slope = normals[:, :1] * np.cos(towards) + normals[:, 1:2] * np.sin(towards)
        rise = np.broadcast_to(np.where(normals[:, 2:] == 0.0, _TINY, normals[:, 2:]), slope.shape)
        etendue = np.empty((len(self.slabs_mm), len(points)))
        for number, slab in enumerate(self.slabs_mm):
            low, high = (height - points[:, 2:] for height in slab)
            polar = [np.arctan2(away, height) for away in (near, beyond) for height in (low, high)]
            sums = _lines(slope, rise, np.minimum.reduce(polar), np.maximum.reduce(polar), upward=self.upward)
            etendue[number] = (weights * sums).sum(axis=1)
        return etendue

    def _half_planes(
        self, axis_mm: Float[np.ndarray, " n"], azimuths: int
    ) -> tuple[_Values, _Values, _Values, _Values]:
        """Azimuths relative to the axis, their weights, and distances (mm) at which they enter and leave the cylinder.

        From points at ``axis_mm`` from the axis. Outside, sines of the azimuths go as those of equal steps.
        """
        steps = (np.arange(azimuths) + 0.5) / azimuths - 0.5
        away = axis_mm[:, None]
        outside = away > self.radius_mm
        ratio = self.radius_mm / np.maximum(away, self.radius_mm)
        sine = ratio * np.sin(pi * steps)
        cosine = np.sqrt(1.0 - sine**2)
        turns = np.where(outside, np.arcsin(sine), 2.0 * pi * steps)
        weights = np.where(outside, ratio * np.cos(pi * steps) / np.maximum(cosine, _TINY) * pi, 2.0 * pi) / azimuths
        middle = away * np.cos(turns)
        half = np.sqrt(np.maximum(self.radius_mm**2 - (away * np.sin(turns)) ** 2, 0.0))
        return turns, weights, np.where(outside, middle - half, 0.0), np.maximum(middle + half, 0.0)


def _lines(slope: _Values, rise: _Values, first: _Values, last: _Values, *, upward: bool) -> _Values:
    """Integral of ``|slope sin + rise cos| sin`` over polar angles; ``upward``: only over rising lines."""

    def up_to(polar: _Values) -> _Values:
        return np.asarray(slope * (0.5 * polar - 0.25 * np.sin(2.0 * polar)) + 0.5 * rise * np.sin(polar) ** 2)

    turned = np.clip(np.mod(np.arctan2(-rise, slope), pi), first, last)  # where lines lie in the surface
    ends = up_to(first), up_to(last)
    if not upward:
        middle = up_to(turned)
        return np.asarray(np.abs(middle - ends[0]) + np.abs(ends[1] - middle))
    level = np.clip(0.5 * pi, first, last)
    middles = up_to(np.minimum(turned, level)), up_to(np.maximum(turned, level))
    outer = np.abs(middles[0] - ends[0]) + np.abs(ends[1] - middles[1])
    return np.asarray(np.where(rise > 0.0, outer, np.abs(middles[1] - middles[0])))


@lru_cache(maxsize=64)  # cells of a lattice see the same plane from many places
def _on_level(column: ExitColumn, height_mm: float) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, "k r"]]:
    """Radii (mm) on a level plane, and the projected solid angle (sr) of the slabs of ``column`` from there."""
    reach = _FARTHEST * (column.radius_mm + abs(height_mm) + max(map(max, column.slabs_mm)))
    near = np.linspace(0.0, 2.0 * column.radius_mm, _NEAR)
    radii = np.concatenate([near, np.geomspace(near[-1], reach, _FAR)[1:]])
    points = np.column_stack([radii, np.zeros_like(radii), np.full_like(radii, height_mm)])
    return radii, column.projected_sr(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape))
