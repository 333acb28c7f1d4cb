"""X, Y, Z on a square raster, for raster milling, fly-cutting and slow tools, with its measured interpolation error.

Z(x, y) has no finite slope where a face stands upright, as at the rim of a hemisphere. The raster therefore ends where
the face becomes steeper than a given angle, on the largest circle about the axis within which it does not; the polar
table has the rest.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Float

from lensforge.drawings.interpolation import BEYOND, Interpolation, halfway
from lensforge.drawings.offset_face import OffsetFace, Plane, Points
from lensforge.surfaces.srbf import fibonacci_hemisphere

_RINGS, _AZIMUTHS = 181, 120  # half a degree, 3 degrees; the slope of every node is measured, and the largest stated
_AREA_SAMPLES = 20_000


@dataclass(frozen=True)
class Extent2D:
    """Radius (mm) of the circle about the axis that the raster fills; ``steep``: it ends at the steepest slope."""

    radius_mm: float
    steep: bool


def raster_extent(face: OffsetFace, slope_deg: float) -> Extent2D:
    """The circle within which no point of ``face`` is steeper than ``slope_deg`` and none lies beyond the rim."""
    polar = np.linspace(0.0, 0.5 * np.pi, _RINGS)
    azimuth = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False)
    t, phi = (each.ravel() for each in np.meshgrid(polar, azimuth, indexing="ij"))
    directions = np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.cos(t)], axis=-1)
    centres, normals = face.at(directions)
    out = np.linalg.norm(centres[:, :2], axis=1).reshape(_RINGS, _AZIMUTHS)
    steep = (face.air * normals[:, 2] < np.cos(np.radians(slope_deg))).reshape(_RINGS, _AZIMUTHS)
    # On each meridian the last sample before the first steep one, or the rim: an overhang is not seen from above.
    last = np.where(steep.any(axis=0), np.maximum(steep.argmax(axis=0) - 1, 0), _RINGS - 1)
    ends = out[last, np.arange(_AZIMUTHS)]
    narrowest = int(ends.argmin())
    return Extent2D(float(ends[narrowest]), bool(steep[:, narrowest].any()))


@dataclass(frozen=True)
class Raster:
    """Nodes of a raster of ``spacing_mm`` inside ``extent``: [X, Y], NaN outside; the steepest has ``slope_deg``."""

    face: OffsetFace
    spacing_mm: float
    extent: Extent2D
    x_mm: Float[np.ndarray, " n"]
    z_mm: Float[np.ndarray, "n n"]
    slope_deg: float

    @property
    def rows(self) -> Points:
        """All nodes, row by row along x, from the lowest y upwards."""
        rows, columns = np.nonzero(np.isfinite(self.z_mm.T))
        return np.stack([self.x_mm[columns], self.x_mm[rows], self.z_mm.T[rows, columns]], axis=-1)

    def covered_mm(self, scheme: Interpolation) -> float:
        """Radius (mm) within which every cell has all nodes that its interpolation needs."""
        return self.extent.radius_mm - sqrt(2.0) * self.spacing_mm * (1 + BEYOND[scheme])

    def covered_share(self, scheme: Interpolation) -> float:
        """Share of the face's area whose points lie within :meth:`covered_mm`."""
        directions = fibonacci_hemisphere(_AREA_SAMPLES)
        centres, normals = self.face.at(directions)
        radius = self.face.surface.radius(directions)
        area = radius**2 / np.abs(np.sum(normals * directions, axis=1))
        inside = np.linalg.norm(centres[:, :2], axis=1) <= self.covered_mm(scheme)
        return float(area[inside].sum() / area.sum())

    def errors_nm(self, scheme: Interpolation, most: int) -> Float[np.ndarray, " k"]:
        """Error of the interpolation along the normal in the middle of cells and sides; of at most ``most`` of them."""
        middles = self._middles(scheme)
        middles = middles[:: max(1, -(-len(middles) // most))]
        centres, normals = self.face.found(middles[:, :2], _across, upward=True)
        error: Float[np.ndarray, " k"] = 1e6 * np.abs((middles[:, 2] - centres[:, 2]) * normals[:, 2])
        return error

    def _middles(self, scheme: Interpolation) -> Points:
        first = BEYOND[scheme]
        nodes, between = self.x_mm, 0.5 * (self.x_mm[:-1] + self.x_mm[1:])
        between = between[first : len(between) - first]
        values = self.z_mm[..., None]
        along_x, along_y = halfway(values, 0, scheme), halfway(values, 1, scheme)
        found = []
        for x, y, z in (
            (between, nodes, along_x),
            (nodes, between, along_y),
            (between, between, halfway(along_x, 1, scheme)),
        ):
            grid = np.concatenate([np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1), z], axis=-1).reshape(-1, 3)
            found.append(grid[np.isfinite(grid[:, 2])])
        return np.concatenate(found)


def make_raster(face: OffsetFace, extent: Extent2D, spacing_mm: float) -> Raster:
    """The raster of ``spacing_mm`` with a node on the axis."""
    reach = int(extent.radius_mm / spacing_mm)
    axis = spacing_mm * np.arange(-reach, reach + 1)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    inside = np.linalg.norm(nodes, axis=-1) <= extent.radius_mm
    z_mm = np.full(inside.shape, np.nan)
    centres, normals = face.found(nodes[inside], _across, upward=True)
    z_mm[inside] = centres[:, 2]
    slope_deg = float(np.degrees(np.arccos(np.clip(face.air * normals[:, 2], -1.0, 1.0).min())))
    return Raster(face, spacing_mm, extent, axis, z_mm, slope_deg)


def _across(points: Points) -> Plane:
    return points[:, :2]
