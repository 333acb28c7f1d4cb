"""A radiance fitted to rays: light by place on an emitting surface and by direction.

The light of an LED is nearly the same pattern of angles at each of its places, or a mixture of a few, so its radiance
is a sum of products of a place and an angle, none of them negative: far fewer numbers than a table of both, and each is
found from many rays. Place is the crossing of a ray with the surface from which the light of its angle seems to come:
behind a window or in a dome that lies at another height for every angle. There edges are sharp.

Rays that are held back choose how much detail there is: the likelihood of these decides on factors, cells and angles.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter

from lensforge.kernels.mixture import SeenRays, blur, densities, expect
from lensforge.kernels.parallel import CHUNKS, in_chunks, in_parallel
from lensforge.sources.light_surface import LightSurface
from lensforge.sources.radiance_emitter import RadianceTable
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.mirror_group import generators, group

_UNIFORM = 0.01  # share of an even light in likelihoods, so that one ray in a dark cell does not decide
STEPS = 120  # of a fit
_LEAST_GAIN = 2e-5  # of the log-likelihood per ray, over ten steps
_SEED = 7
_DARK = 1e-30  # a density that no ray has, so that what it is divided by stays finite
_WORTH = 10_000  # rays for which two threads are quicker than one


@dataclass(frozen=True)
class Detail:
    """Fineness of a model: ``cells`` on the longer side, ``rings`` of sin gamma, ``azimuths``, ``factors``.

    ``blur``: cells over which the mixture of factors, not the light itself, is smoothed.
    """

    cells: int = 16
    rings: int = 8
    azimuths: int = 12
    factors: int = 1
    blur: float = 1.0


@dataclass(frozen=True)
class Angles:
    """Functions linear in azimuth and sin^2 gamma: ``rings`` equal in sin gamma, fewer azimuths on the inner ones."""

    rings: int
    azimuths: int

    @cached_property
    def squares(self) -> Float[np.ndarray, " r"]:
        """Squared sines of gamma of the rings, the axis among them."""
        return (np.arange(self.rings + 1) / self.rings) ** 2

    @cached_property
    def counts(self) -> Int[np.ndarray, " r"]:
        """Number of functions on each ring."""
        wanted = [6 * 2 ** int(np.ceil(np.log2(ring))) for ring in range(1, self.rings + 1)]
        return np.array([1, *np.minimum(wanted, self.azimuths)])

    @cached_property
    def starts(self) -> Int[np.ndarray, " r"]:
        """Index of the first function of each ring, and the total number."""
        return np.concatenate([[0], np.cumsum(self.counts)])

    @cached_property
    def measures(self) -> Float[np.ndarray, " j"]:
        """Integral of each function over the projected solid angle (sr)."""
        widths = np.diff(self.squares, prepend=0.0, append=1.0)
        by_ring = 0.25 * (widths[:-1] + widths[1:]) * 2.0 * np.pi / self.counts
        return np.repeat(by_ring, self.counts)

    def at(self, directions: Float[np.ndarray, "n 3"]) -> tuple[Int[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
        """Numbers of the four functions at each direction, and the density (1/sr projected) of each there."""
        square = np.minimum(np.sum(directions[:, :2] ** 2, axis=1), 1.0)
        turn = np.arctan2(directions[:, 1], directions[:, 0]) / (2.0 * np.pi) % 1.0
        inner = np.clip(np.searchsorted(self.squares, square, side="right") - 1, 0, self.rings - 1)
        outward = (square - self.squares[inner]) / (self.squares[inner + 1] - self.squares[inner])
        nodes = np.empty((len(square), 4), dtype=np.int32)
        shares = np.empty((len(square), 4))
        for place, (ring, share) in enumerate(((inner, 1.0 - outward), (inner + 1, outward))):
            around = turn * self.counts[ring]
            before = np.floor(around)
            for step, by_turn in enumerate((1.0 - (around - before), around - before)):
                node = self.starts[ring] + (before.astype(np.int64) + step) % self.counts[ring]
                nodes[:, 2 * place + step] = node
                shares[:, 2 * place + step] = share * by_turn / self.measures[node]
        return nodes, shares

    def on_grid(self, weights: Float[np.ndarray, "j k"]) -> Float[np.ndarray, "c r k"]:
        """Density (1/sr projected) by azimuth, 0 and 360 degrees included, and ring, for weights of functions."""
        turns = np.arange(self.azimuths + 1) / self.azimuths
        values = weights / self.measures[:, None]
        rings = []
        for start, count in zip(self.starts, self.counts, strict=False):
            around = turns * count
            before = np.floor(around).astype(np.int64)
            second = (around - before)[:, None]
            cell_values = values[start : start + count]
            rings.append((1.0 - second) * cell_values[before % count] + second * cell_values[(before + 1) % count])
        return np.stack(rings, axis=1)


@dataclass(frozen=True, eq=False)
class FittedRadiance:
    """Light of a ``surface``: weights of its factors by cell, ``place`` (sum 1), and by function, ``angle``."""

    surface: LightSurface
    detail: Detail
    place: Float[np.ndarray, "c k"]
    angle: Float[np.ndarray, "j k"]

    @property
    def angles(self) -> Angles:
        """Functions of the angle."""
        return Angles(self.detail.rings, self.detail.azimuths)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return _shape(self.surface, self.detail)

    @staticmethod
    def of(rays: RayBundle, surface: LightSurface, detail: Detail, steps: int = STEPS) -> "FittedRadiance":
        """Fit to ``rays`` that all leave the surface, in at most ``steps`` steps."""
        return _start(rays, surface, detail).fitted(rays, steps)

    def fitted(self, rays: RayBundle, steps: int = STEPS) -> "FittedRadiance":
        """Fit to other ``rays``, starting from this model."""
        model = self
        seen = _seen(rays, self)
        logarithm = -np.inf
        seen = seen.take(np.argsort(seen.cells, kind="stable"))
        light = np.bincount(seen.cells, seen.weights, len(model.place))
        for step in range(steps):
            density = _densities(model, seen)
            if step % 10 == 0:
                before = logarithm
                logarithm = float(seen.weights @ np.log(density, dtype=float))
                if logarithm - before < _LEAST_GAIN:
                    break
            model = _stepped(model, seen, density, light)
        return model

    def logarithms(self, rays: RayBundle) -> Float[np.ndarray, " n"]:
        """Logarithm of the radiance (1/mm^2/sr of all the light) of each ray, of which a hundredth is uniform light."""
        surface = self.surface
        seen = _seen(rays, self)
        area, cell = (float(np.prod(surface.high - low)) for low in (surface.low, surface.corner))
        density = _densities(self, seen).astype(float) * (len(self.place) / cell / len(group(surface.mirrors)))
        return np.log(((1.0 - _UNIFORM) * density + _UNIFORM / (np.pi * area)) / surface.square_index)

    def table(self) -> RadianceTable:
        """The model as a table of radiance on its surface, of 1 W, with all images."""
        surface = self.surface
        rows, columns = self.shape
        azimuths = self.detail.azimuths
        area_m2 = float(np.prod(surface.high - surface.corner)) / len(self.place) * 1e-6
        grid = np.tensordot(self.place, self.angles.on_grid(self.angle), axes=([1], [2])) / area_m2
        grid = grid.reshape(rows, columns, *grid.shape[1:])
        turns = np.arange(azimuths + 1)
        for mirror in reversed(generators(surface.mirrors)):
            if mirror[0, 0] == 0.0:
                grid = 0.5 * (grid + grid.swapaxes(0, 1)[:, :, (azimuths // 4 - turns) % azimuths])
            elif mirror[0, 0] < 0.0:
                grid = 0.5 * np.concatenate([grid[:, ::-1, (azimuths // 2 - turns) % azimuths], grid], axis=1)
            else:
                grid = 0.5 * np.concatenate([grid[::-1, :, -turns % azimuths], grid], axis=0)
        left, bottom = surface.low
        right, top = surface.high
        x_mm = np.linspace(left, right, grid.shape[1] + 1)
        y_mm = np.linspace(bottom, top, len(grid) + 1)
        gamma = np.rad2deg(np.arcsin(np.sqrt(self.angles.squares)))
        return RadianceTable(x_mm, y_mm, np.linspace(0.0, 360.0, azimuths + 1), gamma, grid)


def _shape(surface: LightSurface, detail: Detail) -> tuple[int, int]:
    longest = (surface.high - surface.low).max()
    columns, rows = (
        np.maximum(np.round(detail.cells * (surface.high - surface.corner) / longest), 1).astype(int).tolist()
    )
    return rows, columns


def _seen(rays: RayBundle, model: FittedRadiance) -> SeenRays:
    surface = model.surface
    rows, columns = model.shape
    points, along = surface.folded(rays)
    inside = (points[:, :2] - surface.corner) / (surface.high - surface.corner)
    column, row = np.clip(inside * (columns, rows), 0, (columns - 1, rows - 1)).astype(np.int32).T
    nodes, shares = model.angles.at(along)
    weights = (rays.flux / rays.flux.sum()).astype(np.float32)
    return SeenRays(row * columns + column, nodes, shares.astype(np.float32), weights)


def _start(rays: RayBundle, surface: LightSurface, detail: Detail) -> FittedRadiance:
    """Factors that are uniform in angle and follow the light in place, with random variation if there are several."""
    random = np.random.default_rng(_SEED)
    angles = Angles(detail.rings, detail.azimuths)
    shape = _shape(surface, detail)
    angle = angles.measures[:, None] * random.gamma(4.0, size=(len(angles.measures), detail.factors))
    noise = random.standard_normal((detail.factors, *shape))
    noise = gaussian_filter(noise, (0.0, min(shape) / 6.0, min(shape) / 6.0)).reshape(detail.factors, -1).T
    place = np.ascontiguousarray(np.exp(0.7 * noise / noise.std()))
    model = FittedRadiance(surface, detail, place, angle / angle.sum(axis=0))
    light = np.bincount(_seen(rays, model).cells, rays.flux / rays.flux.sum(), len(place))
    return replace(model, place=light[:, None] * place / place.sum(axis=1, keepdims=True))


def _stepped(
    model: FittedRadiance, seen: SeenRays, density: Float[np.ndarray, " n"], light: Float[np.ndarray, " c"]
) -> FittedRadiance:
    """The model after one step, from the densities ``density`` of rays in the order of their cells.

    The mixture in a cell becomes that of the cells around, its ``light`` that of the rays.
    """
    place = model.place.astype(np.float32)
    angle = model.angle.astype(np.float32)
    by_place = np.zeros_like(place)
    by_angle = np.zeros((CHUNKS, *angle.shape), np.float32)
    ends = np.searchsorted(seen.cells, seen.cells[len(density) * np.arange(1, CHUNKS) // CHUNKS])
    parts = [slice(*edges) for edges in pairwise([0, *ends, len(density)])]  # no cell is in two

    def add(chunk: int) -> None:
        part = parts[chunk]
        expect(seen.take(part), density[part], place, angle, by_place, by_angle[chunk])

    in_parallel(add, CHUNKS, shared=len(density) >= _WORTH)
    angle = model.angle * by_angle.sum(axis=0)
    mixture = _blurred((model.place * by_place).reshape(*model.shape, -1), model.detail.blur).reshape(by_place.shape)
    place = mixture * (light / np.maximum(mixture.sum(axis=1), 1e-300))[:, None]
    return replace(model, place=place, angle=angle / np.maximum(angle.sum(axis=0), 1e-300))


def _blurred(values: Float[np.ndarray, "r c k"], cells: float) -> Float[np.ndarray, "r c k"]:
    """``values`` convolved with a Gaussian of ``cells`` cells along both sides; dark beyond the edges."""
    if cells == 0.0:
        return values
    half = int(4.0 * cells + 0.5)
    taps = np.exp(-0.5 * (np.arange(-half, half + 1) / cells) ** 2)
    taps /= taps.sum()
    once = np.empty(values.shape)
    twice = np.empty(values.shape)
    whole = values.reshape(1, len(values), -1), once.reshape(1, len(values), -1)
    in_chunks(lambda _, part: blur(whole[0], taps, part.start, part.stop, whole[1]), len(values))
    in_chunks(lambda _, part: blur(once, taps, part.start, part.stop, twice), values.shape[1])
    return twice


def _densities(model: FittedRadiance, seen: SeenRays) -> Float[np.ndarray, " n"]:
    place = model.place.astype(np.float32)
    angle = model.angle.astype(np.float32)
    density = np.empty(len(seen.cells), np.float32)
    in_chunks(lambda _, part: densities(seen.take(part), place, angle, density[part]), len(density), worth=_WORTH)
    return np.maximum(density, _DARK)
