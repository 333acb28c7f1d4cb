"""The body as designed, in plain numbers, and the distance of points from its faces.

An optical face is its radius about the origin of its lens, exact at the nodes of a grid of the chart, and a quintic
spline between them. All other faces are level, or upright over curves. No face is trimmed: a closed body whose every
piece lies on one of these is a union of the cells between them, and which of the cells shows in the faces that it
lacks, and in its volume.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.proof.optical_faces import PlateOfLenses

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, RectBivariateSpline
    from scipy.spatial import cKDTree

ABOVE_MM = 1e-4  # what is higher than z = 0 by that belongs to an optical face, or to a flange
_SMALL_MM = 5e-6  # of a distance that need not be known better than to be this small
_NEAREST = 3  # pieces of curves, by their middles, among which the nearest is found
_TINY = 1e-12  # 1/mm, and mm: no division by zero where a point is the origin, or a face is not met

_Points = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]
_Numbers = Int[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class DesignedFace:
    """An optical face: ``reciprocal`` radii (1/mm) over the chart, first index X, at the coordinates ``axis``.

    ``extent``: least and largest distance of its edges from the chart's centre; ``known``: of the region where it is
    known.
    """

    name: str
    axis: Float[np.ndarray, " k"]
    reciprocal: Float[np.ndarray, "k k"]
    extent: tuple[float, float]
    known: tuple[float, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Its single name."""
        return (self.name,)

    @cached_property
    def _spline(self) -> "RectBivariateSpline":
        from scipy.interpolate import RectBivariateSpline

        return RectBivariateSpline(self.axis, self.axis, self.reciprocal, kx=5, ky=5)

    def off_mm(self, points: _Points, small_mm: float = _SMALL_MM) -> tuple[_Values, _Numbers]:
        """Distance (mm) along the normal, to first order: the radial distance times its cosine.

        Up to ``small_mm`` the radial distance, which is no less.
        """
        radius = np.linalg.norm(points, axis=1)
        x, y = points[:, :2].T / np.maximum(radius + points[:, 2], _TINY)
        value = np.maximum(self._spline.ev(x, y), _TINY)
        off = np.abs(radius - 1.0 / value)
        rows = np.flatnonzero(off > small_mm)
        x, y = x[rows], y[rows]
        across = np.hypot(self._spline.ev(x, y, dx=1), self._spline.ev(x, y, dy=1))
        off[rows] /= np.hypot(1.0, 0.5 * (1.0 + x**2 + y**2) * across / value[rows])
        return off, np.zeros(len(points), dtype=np.int64)

    def within(self, extent: tuple[float, float], points: _Points) -> Bool[np.ndarray, " n"]:
        """True for points whose direction lies within ``extent`` of the chart's centre."""
        sine = np.hypot(points[:, 0], points[:, 1])
        cosine = np.linalg.norm(points, axis=1) + points[:, 2]
        return np.asarray((sine >= extent[0] * cosine) & (sine <= extent[1] * cosine))


@dataclass(frozen=True, eq=False)
class Levels:
    """Horizontal planes at ``heights`` (mm)."""

    names: tuple[str, ...]
    heights: Float[np.ndarray, " k"]

    def off_mm(self, points: _Points, small_mm: float = _SMALL_MM) -> tuple[_Values, _Numbers]:
        """Distance (mm) from the nearest plane, and that plane's number."""
        away = np.abs(points[:, 2, None] - self.heights)
        nearest = away.argmin(axis=1)
        return np.take_along_axis(away, nearest[:, None], axis=1)[:, 0], nearest


@dataclass(frozen=True, eq=False)
class StandingWalls:
    """Walls over closed plane curves in short pieces of start, middle and end (mm), upright or drafted.

    A piece is the parabola through the three points, or the line if they are collinear. ``owners``: wall number of each
    piece. ``drafts``: for each piece the position (mm) of its axis, the height (mm) of its curve, and its growth
    downwards (1/mm); by default all are upright.
    """

    names: tuple[str, ...]
    pieces: Float[np.ndarray, "s 3 2"]
    owners: Int[np.ndarray, " s"]
    drafts: Float[np.ndarray, "s 4"] | None = None

    @cached_property
    def _tree(self) -> "cKDTree":
        from scipy.spatial import cKDTree

        return cKDTree(self.pieces[:, 1])

    def off_mm(self, points: _Points, small_mm: float = _SMALL_MM) -> tuple[_Values, _Numbers]:
        """Distance (mm) from the nearest wall, and that wall's number."""
        flat = self._at_curve(points)
        near = self._tree.query(flat, k=min(_NEAREST, len(self.pieces)))[1].reshape(len(points), -1)
        start, middle, end = np.moveaxis(self.pieces[near], 2, 0)
        chord = end - start
        length = np.linalg.norm(chord, axis=-1)
        along = chord / length[..., None]
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        way = flat[:, None] - start
        share = np.clip(np.sum(way * along, axis=-1) / length, 0.0, 1.0)
        sag = np.sum((middle - start) * across, axis=-1)
        beside = np.sum(way * across, axis=-1) - 4.0 * sag * share * (1.0 - share)
        beyond = np.sum(way * along, axis=-1) - share * length
        away = np.hypot(beside, beyond)
        chosen = away.argmin(axis=1)[:, None]
        nearest = np.take_along_axis(near, chosen, axis=1)[:, 0]
        return np.take_along_axis(away, chosen, axis=1)[:, 0], self.owners[nearest]

    def _at_curve(self, points: _Points) -> Float[np.ndarray, "n 2"]:
        """The points in the plane, those of a drafted wall moved along it to the height of its curve."""
        flat: Float[np.ndarray, "n 2"] = points[:, :2]
        if self.drafts is None or not self.drafts[:, 3].any():
            return flat
        x, y, height, growth = self.drafts[self._tree.query(flat)[1]].T
        axis = np.column_stack([x, y])
        return axis + (flat - axis) / (1.0 + growth * (height - points[:, 2]))[:, None]


@dataclass(frozen=True, eq=False)
class DrawnProfile:
    """An optical face that is drawn along y: ``reciprocal`` distances (1/mm) from the y axis at ``angles`` from z."""

    name: str
    angles: _Values
    reciprocal: _Values

    @property
    def names(self) -> tuple[str, ...]:
        """Its single name."""
        return (self.name,)

    @cached_property
    def _spline(self) -> "BSpline":
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.angles, self.reciprocal, k=5)

    def off_mm(self, points: _Points, small_mm: float = _SMALL_MM) -> tuple[_Values, _Numbers]:
        """Distance (mm) along the normal, to first order."""
        angles = np.arctan2(points[:, 0], points[:, 2])
        value = np.maximum(self._spline(angles), _TINY)
        slant = np.hypot(1.0, self._spline(angles, 1) / value)
        off = np.abs(np.hypot(points[:, 0], points[:, 2]) - 1.0 / value) / slant
        return off, np.zeros(len(points), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Ends:
    """Planes across y at both ends of a body, ``half_mm`` from its middle."""

    names: tuple[str, str]
    half_mm: float

    def off_mm(self, points: _Points, small_mm: float = _SMALL_MM) -> tuple[_Values, _Numbers]:
        """Distance (mm) from the nearer plane, and that plane's number."""
        return np.abs(np.abs(points[:, 1]) - self.half_mm), (points[:, 1] > 0.0).astype(np.int64)


@dataclass(frozen=True, eq=False)
class PlacedFace:
    """The same optical face of all ``lenses`` of a plate; a point belongs to the lens with the nearest axis.

    ``faces``: one for each kind of lens.
    """

    faces: Sequence[DesignedFace]
    lenses: PlateOfLenses

    @property
    def names(self) -> tuple[str, ...]:
        """Its name, with the number of each lens if there are several."""
        count = len(self.lenses.places)
        name = self.faces[0].name
        return tuple(f"{name}_{k + 1}" for k in range(count)) if count > 1 else (name,)

    def of_lens(self, number: int) -> DesignedFace:
        """The face of lens ``number``."""
        ((kind, _),) = self.lenses.of_kinds(np.array([number]))
        return self.faces[kind]

    def off_mm(self, points: _Points, small_mm: float = _SMALL_MM) -> tuple[_Values, _Numbers]:
        """Distance (mm) from the face, in the local coordinates of the nearest lens, and that lens's number."""
        local, numbers = self.lenses.at_local(points)
        off = np.zeros(len(points))
        for kind, rows in self.lenses.of_kinds(numbers):
            off[rows] = self.faces[kind].off_mm(local[rows], small_mm)[0]
        return off, numbers

    def known(self, points: _Points) -> Bool[np.ndarray, " n"]:
        """True for points in a direction in which the face of the nearest lens is known."""
        local, numbers = self.lenses.at_local(points)
        is_known = np.zeros(len(points), dtype=bool)
        for kind, rows in self.lenses.of_kinds(numbers):
            is_known[rows] = self.faces[kind].within(self.faces[kind].known, local[rows])
        return is_known

    def to_local(self, points: _Points, lens: int | None = None) -> _Points:
        """Points in the local coordinates of a lens, by its number, or of the nearest one."""
        return self.lenses.at_local(points, None if lens is None else np.full(len(points), lens))[0]


# One face, or several of a kind that do not meet: their ``names``, and how far off the nearest of them points are.
Designed = DesignedFace | DrawnProfile | PlacedFace | Levels | StandingWalls | Ends


@dataclass(frozen=True, eq=False)
class DesignedBody:
    """Faces ``above`` z = 0 with a flange's, and those ``below``, at and under it; None if a base's are not known."""

    above: Sequence[Designed]
    below: Sequence[Designed] | None

    @property
    def wanted(self) -> set[str]:
        """Names of all faces that a file should have."""
        return {name for face in (*self.above, *(self.below or ())) for name in face.names}
