"""Apparent emitting surface of rays, on which edges of chips and windows are sharp.

It is a plane, or lies at another height for every angle, as behind a window, or it is a plane in a dome of glass: rays
are traced back into it. Étendue is kept, so that a density of rays by place and projected solid angle within is that
outside times the square of the index. Light that mirrors leave as it is falls onto one of its images.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.mirror_group import generators

LEAST_RISE = 0.02  # flatter rays are no light of the surface, but stray light
_BEYOND = 0.002  # of the flux, beyond each of the four sides of the surface
_RINGS_OF_HEIGHT = 8
_STEEP = 0.15  # rays less flat than this tell the heights
_CORE = 0.97  # of the rays of a ring, by their distance from its middle
_FIRST = np.array([2.0, 1.0])  # of its images the one farthest along this is kept
# A dome is known by the rays in these cells.
_CELLS = 24
_RINGS = 6
_AZIMUTHS = 12
_TELLING = 20_000  # rays that suffice
_MOST_LOST = 0.03  # share of the rays that may miss the dome
_MOST_RADIUS = 4.0  # of half the width of the light
_INDICES = (1.41, 1.53)  # of silicones, with which a search begins

Traced = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]  # points (mm) and directions


@dataclass(frozen=True)
class GlassDome:
    """Sphere of glass of ``radius`` (mm) and ``index``, its centre on the axis at ``height`` (mm)."""

    radius: float
    height: float
    index: float

    def inward(self, rays: RayBundle) -> Traced:
        """Points (mm) where rays traced back meet it, and their directions within; a miss has direction -z."""
        starts = rays.origins - (0.0, 0.0, self.height)
        along = rays.directions
        middle = np.sum(starts * along, axis=1)
        square = middle**2 - np.sum(starts**2, axis=1) + self.radius**2
        points = starts + (np.sqrt(np.maximum(square, 0.0)) - middle)[:, None] * along
        within, _ = _refracted(along, points / self.radius, 1.0 / self.index)
        return np.add(points, (0.0, 0.0, self.height)), np.where(square[:, None] > 0.0, within, (0.0, 0.0, -1.0))

    def outward(self, points: Float[np.ndarray, "n 3"], within: Float[np.ndarray, "n 3"]) -> Traced:
        """Points (mm) where rays from within leave it, and directions outside; tangential for total reflection."""
        starts = points - (0.0, 0.0, self.height)
        middle = np.sum(starts * within, axis=1)
        square = np.maximum(middle**2 - np.sum(starts**2, axis=1) + self.radius**2, 0.0)
        ends = starts + (np.sqrt(square) - middle)[:, None] * within
        return np.add(ends, (0.0, 0.0, self.height)), _refracted(within, ends / self.radius, self.index)[0]


def _refracted(
    along: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"], ratio: float
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Directions behind a surface with the normal ahead, and the square of their cosine, below 0 where none leaves."""
    cosine = np.sum(along * normal, axis=1)
    square = 1.0 - ratio**2 * (1.0 - cosine**2)
    refracted = ratio * along + (np.sqrt(np.maximum(square, 0.0)) - ratio * cosine)[:, None] * normal
    return refracted / np.linalg.norm(refracted, axis=1, keepdims=True), square


@dataclass(frozen=True, eq=False)
class LightSurface:
    """Apparent emitting surface: a rectangle (mm), its ``heights`` by the ``squares`` of sin gamma.

    ``dome``: the glass around it. ``mirrors``: mirror group about its middle that leaves its light unchanged.
    """

    low: Float[np.ndarray, " 2"]
    high: Float[np.ndarray, " 2"]
    squares: Float[np.ndarray, " k"]
    heights: Float[np.ndarray, " k"]
    dome: GlassDome | None = None
    mirrors: str = "none"

    @staticmethod
    def of(rays: RayBundle, *, curved: bool) -> "LightSurface":
        """The surface on which the rays of each angle are closest together, or the plane nearest to all rays."""
        rise = rays.directions[:, 2]
        steep = rise > _STEEP
        square = 1.0 - rise**2
        edges = np.quantile(square[steep], np.linspace(0.0, 1.0, _RINGS_OF_HEIGHT + 1 if curved else 2))
        rings = [steep & (square >= low) & (square <= high) for low, high in pairwise(edges)]
        heights = np.array([_waist(rays.take(ring)) for ring in rings])
        squares = np.array([square[ring].mean() for ring in rings])
        return LightSurface(np.zeros(2), np.zeros(2), squares, heights)._around(rays)

    @staticmethod
    def in_dome(rays: RayBundle, plane: "LightSurface") -> "LightSurface | None":
        """The plane in a dome on which light is nearest to a product of place and angle; from a plane without dome.

        None if no dome that was tried brings it nearer.
        """
        from scipy.optimize import minimize

        random = np.random.default_rng(0)
        shares = rays.flux / rays.flux.sum()
        some = rays.take(random.choice(len(rays), min(_TELLING, len(rays)), p=shares))
        some = replace(some, flux=np.ones(len(some)))
        size = 0.5 * float((plane.high - plane.low).max())

        def dome(radius: float, middle: float, height: float, index: float) -> LightSurface:
            none = np.zeros(2)
            heights = np.array([height * size])
            return LightSurface(none, none, np.zeros(1), heights, GlassDome(radius * size, middle * size, index))

        def spread(numbers: Float[np.ndarray, " n"], *index: float) -> float:
            allowed = numbers[0] < _MOST_RADIUS and 1.3 < (*numbers, *index)[3] < 1.7
            return dome(*numbers, *index)._spread(some) if allowed else np.inf

        def nearest(start: list[float], steps: list[float], *index: float) -> Any:
            simplex = np.vstack([start, start + np.diag(steps)])
            options = {"initial_simplex": simplex, "maxfev": 30 * len(start), "xatol": 1e-3, "fatol": 1e-4}
            return minimize(spread, start, index, "Nelder-Mead", options=options)

        height = float(plane.heights[0]) / size
        firsts = [(nearest([1.6, height, height], [0.5, 0.2, 0.2], index), index) for index in _INDICES]
        first, index = min(firsts, key=lambda hit: float(hit[0].fun))
        best = nearest([*first.x, index], [0.1, 0.05, 0.05, 0.05])
        return dome(*best.x.tolist())._around(rays) if best.fun < plane._spread(some) else None

    def mirrored(self, rays: RayBundle, mirrors: str) -> "LightSurface":
        """The surface with ``mirrors`` about the middle of its light, of which one part then stands for all images."""
        places = self.inward(rays.take(self.holds(rays)))[0][:, :2]
        middle = np.average(places, axis=0, weights=rays.flux[self.holds(rays)])
        half = np.maximum(self.high - middle, middle - self.low)
        half = np.full(2, half.max()) if any(generator[0, 0] == 0.0 for generator in generators(mirrors)) else half
        return replace(self, low=middle - half, high=middle + half, mirrors=mirrors)

    @property
    def corner(self) -> Float[np.ndarray, " 2"]:
        """Lower corner (mm) of the part that stands for all images; its upper corner is ``high``."""
        halved = [any(generator[axis, axis] == -1.0 for generator in generators(self.mirrors)) for axis in (0, 1)]
        return np.where(halved, 0.5 * (self.low + self.high), self.low)

    @property
    def square_index(self) -> float:
        """Squared index of the glass: phase-space density of rays within over that outside."""
        return 1.0 if self.dome is None else self.dome.index**2

    def inward(self, rays: RayBundle) -> Traced:
        """Points (mm) where rays traced back cross the surface, and their directions there."""
        points, along = (rays.origins, rays.directions) if self.dome is None else self.dome.inward(rays)
        rise = along[:, 2]
        steps = (self.height(along) - points[:, 2]) / np.where(rise > LEAST_RISE, rise, np.inf)
        return points + steps[:, None] * along, along

    def outward(self, places: Float[np.ndarray, "n _"], along: Float[np.ndarray, "n 3"]) -> Traced:
        """Points (mm) where rays from places on the surface leave it or the dome, and their directions outside."""
        points = np.column_stack([places[:, :2], self.height(along)])
        return (points, along) if self.dome is None else self.dome.outward(points, along)

    def folded(self, rays: RayBundle) -> Traced:
        """Points (mm) and directions on the surface, each replaced by the image that stands for all."""
        points, along = self.inward(rays)
        middle = np.append(0.5 * (self.low + self.high), 0.0)
        local = points - middle
        for mirror in generators(self.mirrors):
            beyond = ((local @ mirror - local)[:, :2] @ _FIRST > 0.0)[:, None]
            local = np.where(beyond, local @ mirror, local)
            along = np.where(beyond, along @ mirror, along)
        return local + middle, along

    def height(self, along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Height (mm) of the surface for light in each direction."""
        return np.interp(1.0 - along[:, 2] ** 2, self.squares, self.heights)

    def holds(self, rays: RayBundle) -> Bool[np.ndarray, " n"]:
        """True for rays that leave the surface upwards."""
        points, along = self.inward(rays)
        inside = ((points[:, :2] >= self.low) & (points[:, :2] < self.high)).all(axis=1)
        return inside & (along[:, 2] > LEAST_RISE) & (rays.directions[:, 2] > LEAST_RISE)

    def blocks(
        self, points: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"], sides: tuple[int, int, int]
    ) -> Int[np.ndarray, " n"]:
        """Number of each ray's block of place and angle; blocks are equal in area and in projected solid angle.

        ``sides``: numbers on a side in place, in sin^2 gamma and in azimuth.
        """
        cells, rings, azimuths = sides
        inside = (points[:, :2] - self.low) / (self.high - self.low)
        column, row = np.clip(inside * cells, 0, cells - 1).astype(np.int64).T
        x, y, _ = along.T
        ring = np.minimum((x**2 + y**2) * rings, rings - 1).astype(np.int64)
        azimuth = np.minimum(np.arctan2(y, x) / (2.0 * np.pi) % 1.0 * azimuths, azimuths - 1).astype(np.int64)
        return ((row * cells + column) * rings + ring) * azimuths + azimuth

    def _around(self, rays: RayBundle) -> "LightSurface":
        """The surface with the rectangle of its light."""
        points, along = self.inward(rays)
        upwards = along[:, 2] > LEAST_RISE
        ends = (_BEYOND, 1.0 - _BEYOND)
        low, high = np.quantile(points[upwards, :2], ends, axis=0, weights=rays.flux[upwards], method="inverted_cdf")
        return replace(self, low=low, high=high)

    def _spread(self, rays: RayBundle) -> float:
        """Mean logarithm of 1 over the density of rays of equal flux, as if place and angle were independent."""
        points, along = self.inward(rays)
        upwards = (along[:, 2] > LEAST_RISE) & (rays.directions[:, 2] > LEAST_RISE)
        if upwards.mean() < 0.5:
            return np.inf
        points = points[upwards]
        along = along[upwards]
        low, high = np.quantile(points[:, :2], (_BEYOND, 1.0 - _BEYOND), axis=0)
        if (high <= low).any():
            return np.inf
        fitted = replace(self, low=low, high=high)
        entropy = np.log(float(np.prod(high - low)) * np.pi * self.square_index)
        for sides in ((_CELLS, 1, 1), (1, _RINGS, _AZIMUTHS)):
            share = np.bincount(fitted.blocks(points, along, sides)) / len(points)
            lit = share[share > 0.0]
            entropy -= float(np.sum(lit * np.log(lit))) + np.log(np.prod(sides) * sides[0])
        return float(entropy + 10.0 * max(1.0 - upwards.mean() - _MOST_LOST, 0.0))


def _waist(rays: RayBundle) -> float:
    """Height (mm) at which rays are closest together, outliers left out."""
    slope = rays.directions[:, :2] / rays.directions[:, 2:]
    place = rays.origins[:, :2] - rays.origins[:, 2:] * slope
    weight = rays.flux
    height = 0.0
    for _ in range(3):
        centred = place - np.average(place, axis=0, weights=weight), slope - np.average(slope, axis=0, weights=weight)
        spread = float(np.sum(weight[:, None] * centred[1] ** 2))
        height = -float(np.sum(weight[:, None] * centred[0] * centred[1])) / spread if spread > 0.0 else 0.0
        at_waist = place + height * slope
        distance = np.linalg.norm(at_waist - np.median(at_waist, axis=0), axis=1)
        near = distance <= np.quantile(distance, _CORE)
        place = place[near]
        slope = slope[near]
        weight = weight[near]
    return height
