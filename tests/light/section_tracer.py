"""A tracer of the section of a linear lens that knows nothing of lensforge: polygons, and Snell's law in the plane.

A ray keeps its direction p along y. Its shadow is one in the plane, where a medium of index n has ``sqrt(n^2 - p^2)``.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

SIDES = 60_001


class Ended(NamedTuple):
    """A ray that left, by its point and direction; or one that ended otherwise, with no place. ``met``: its faces."""

    met: tuple[str, ...]
    point: np.ndarray | None
    direction: np.ndarray | None


def reciprocal(coefficients: Sequence[float], angles: np.ndarray) -> np.ndarray:
    """1/r of a profile at angles from z, by the formula of docs/definitions.md."""
    high = 0.5 + 0.15 / np.pi
    step = 2.0 * high / (len(coefficients) - 5)
    knots = -high + step * np.arange(-5.0, len(coefficients) + 1.0)
    return BSpline(knots, coefficients, 5)(angles / np.pi)


class Section:
    """Polygons of the cavity and of the body, each side by the name of its face."""

    def __init__(self, profiles: Mapping[str, Sequence[float]], index: float) -> None:
        self.index = index
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, SIDES)
        self.polygons, self.names = [], []
        for faces in (("cap", "side"), ("wall", "exit")):
            values = np.stack([reciprocal(profiles[face], angles) for face in faces])
            points = np.column_stack([np.sin(angles), np.cos(angles)]) / values.max(axis=0)[:, None]
            self.polygons.append(points)
            self.names.append(np.array(faces)[values[:, :-1].argmax(axis=0)])

    def nearest(self, polygon: int, start: np.ndarray, way: np.ndarray) -> tuple[float, int]:
        """Path to the nearest side of a polygon, and its number."""
        points = self.polygons[polygon]
        sides = np.diff(points, axis=0)
        across = sides[:, 0] * way[1] - sides[:, 1] * way[0]
        away = points[:-1] - start
        with np.errstate(divide="ignore", invalid="ignore"):
            path = (sides[:, 0] * away[:, 1] - sides[:, 1] * away[:, 0]) / across
            share = (way[0] * away[:, 1] - way[1] * away[:, 0]) / across
        path[~((path > 1e-6) & (share >= 0.0) & (share <= 1.0))] = np.inf
        k = int(path.argmin())
        return float(path[k]), k

    def trace(self, origin: np.ndarray, direction: np.ndarray, events: int) -> Ended:
        """Follow a ray from the cavity."""
        along = direction[1]
        outside = np.sqrt(1.0 - along**2)
        inside = np.sqrt(self.index**2 - along**2)
        point = origin[[0, 2]]
        y = origin[1]
        way = direction[[0, 2]] / outside
        in_body = False
        met = list[str]()
        for _ in range(events):
            hits = [self.nearest(polygon, point, way) for polygon in ((0, 1) if in_body else (0,))]
            polygon = int(np.argmin([path for path, _ in hits]))
            path, side = hits[polygon]
            if not np.isfinite(path):
                break
            before, behind = (inside, outside) if in_body else (outside, inside)
            point = point + path * way
            y += path * along / before
            met.append(str(self.names[polygon][side]))
            edge = np.diff(self.polygons[polygon][side : side + 2], axis=0)[0]
            normal = np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
            normal *= np.sign(normal @ way)
            cosine, ratio = float(normal @ way), before / behind
            squared = 1.0 - ratio**2 * (1.0 - cosine**2)
            if squared <= 0.0:
                way = way - 2.0 * cosine * normal
                continue
            way = ratio * way + (np.sqrt(squared) - ratio * cosine) * normal
            if polygon == 1:
                return Ended(tuple(met), np.array([point[0], y, point[1]]), np.insert(outside * way, 1, along))
            in_body = not in_body
        return Ended(tuple(met), None, None)
