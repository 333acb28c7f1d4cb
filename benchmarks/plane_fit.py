"""The light of two profiles in the plane on pixels, its derivatives by coefficients, and a fit of both to wanted light.

Rays from even slopes at Gauss nodes of the source; the light between two neighbours of a node lies evenly between the
places where they land, so that the light of pixels is a continuous function of the profiles, without noise. Profiles
are those of `lensforge.surfaces.drawn_profile`.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import atan2, hypot, pi, sqrt

import numpy as np
from jaxtyping import Float

from lensforge.kernels.compiled import inline, kernel
from lensforge.surfaces.drawn_profile import profile_basis

_END = profile_basis(6).high  # half turns at which a profile ends
_NEWTON = 30
_NEWTON_MORE = 2  # from a crossing near by
_LONGEST = 2.0  # mm, of a Newton step
_CHANGE = 1e-6  # of a profile's value (1/mm) and slope, in difference quotients

Coefficients = Float[np.ndarray, "2 c"]


@inline
def _spline(coefficients, angle, weights, slopes):
    """Number of the first of six coefficients at an angle; their weights are set, and those of the slope by it."""
    step = 2.0 * _END / (len(coefficients) - 5)
    at = min(max((angle / pi + _END) / step, 0.0), len(coefficients) - 5.0 - 1e-9)
    first = int(at)
    part = at - first
    weights[0] = 1.0
    for degree in range(1, 6):
        if degree == 5:
            slopes[0] = -weights[0]
            for k in range(1, 5):
                slopes[k] = weights[k - 1] - weights[k]
            slopes[5] = weights[4]
        saved = 0.0
        for k in range(degree):
            share = weights[k] / degree
            weights[k] = saved + (k + 1.0 - part) * share
            saved = (part + degree - k - 1.0) * share
        weights[degree] = saved
    for k in range(6):
        slopes[k] /= step * pi
    return first


@inline
def _profile(coefficients, angle, change, weights, slopes):
    """Reciprocal distance and its slope at an angle; ``change``: of value and slope, and the angle about which."""
    first = _spline(coefficients, angle, weights, slopes)
    value = change[0] + change[1] * (angle - change[2])
    slope = change[1]
    for k in range(6):
        value += weights[k] * coefficients[first + k]
        slope += slopes[k] * coefficients[first + k]
    return value, slope


@kernel
def _through(coefficients, ray, ratio, change, length, steps, weights, slopes):
    """Take ``ray`` (x, z, along x, along z, share across, share along) through a face, from a path near its crossing.

    Returns the path, and the angle of the crossing from z; a path of -1 where it does not cross, or is reflected.
    """
    for step in range(steps + 1):
        x = ray[0] + length * ray[2]
        z = ray[1] + length * ray[3]
        shadow = hypot(x, z)
        angle = atan2(x, z)
        value, slope = _profile(coefficients, angle, change, weights, slopes)
        off = shadow * value - 1.0
        normal_x = (x * value + z * slope) / shadow
        normal_z = (z * value - x * slope) / shadow
        rise = normal_x * ray[2] + normal_z * ray[3]
        if step == steps or abs(off) < 4e-16:
            break
        length -= min(max(off / max(rise, 1e-3), -_LONGEST), _LONGEST)
    if not abs(off) < 1e-9 or not rise > 0.0:
        return -1.0, 0.0
    norm = hypot(normal_x, normal_z)
    cosine = rise / norm
    square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    if square <= 0.0:
        return -1.0, 0.0
    leaving = sqrt(square)
    ray[0], ray[1] = x, z
    ray[2] = ratio * ray[2] + (leaving - ratio * cosine) * normal_x / norm
    ray[3] = ratio * ray[3] + (leaving - ratio * cosine) * normal_z / norm
    ray[4] *= 1.0 - ((ratio * cosine - leaving) / (ratio * cosine + leaving)) ** 2
    ray[5] *= 1.0 - ((cosine - ratio * leaving) / (cosine + ratio * leaving)) ** 2
    return length, angle


@kernel
def _landed(profiles, start, index, distance, changes, paths, angles, steps, scratch):
    """Place where a ray from ``start`` (x, slope) lands, and its share; of a lost ray the share is -1."""
    ray, weights, slopes = scratch[0], scratch[1], scratch[2]
    norm = hypot(1.0, start[1])
    ray[0], ray[1], ray[2], ray[3], ray[4], ray[5] = start[0], 0.0, start[1] / norm, 1.0 / norm, 1.0, 1.0
    for face in range(2):
        ratio = 1.0 / index if face == 0 else index
        paths[face], angles[face] = _through(
            profiles[face], ray, ratio, changes[face], paths[face], steps, weights, slopes
        )
        if paths[face] < 0.0:
            return 0.0, -1.0
    if ray[3] <= 0.05:
        return 0.0, -1.0
    return ray[0] + (distance - ray[1]) * ray[2] / ray[3], 0.5 * (ray[4] + ray[5])


@kernel
def _trace(profiles, starts, index, distance, landed, angles, derivatives, changes, scratch):
    """Trace all rays; ``derivatives``: of place and share by value and slope of each profile where the ray meets it."""
    paths, near, around = scratch[3], scratch[4], scratch[5]
    for ray in range(len(starts)):
        paths[0] = 0.9 / profiles[0, len(profiles[0]) // 2]
        paths[1] = 0.9 / profiles[1, len(profiles[0]) // 2] - paths[0]
        place, share = _landed(profiles, starts[ray], index, distance, changes, paths, angles[ray], _NEWTON, scratch)
        landed[ray, 0], landed[ray, 1] = place, share
        for face in range(2):
            for kind in range(2):
                near[0], near[1] = paths[0], paths[1]
                changes[face, kind] = _CHANGE
                changes[face, 2] = angles[ray, face]
                moved, passed = _landed(
                    profiles, starts[ray], index, distance, changes, near, around, _NEWTON_MORE, scratch
                )
                changes[face, kind] = 0.0
                good = share >= 0.0 and passed >= 0.0
                derivatives[ray, face, kind, 0] = (moved - place) / _CHANGE if good else 0.0
                derivatives[ray, face, kind, 1] = (passed - share) / _CHANGE if good else 0.0


@kernel
def _onto_pixels(profiles, row, flux, landed, angles, derivatives, borders, light, slopes_of_light, scratch):
    """Add the light between neighbours of each ``row`` of rays to pixels, and its derivatives by all coefficients."""
    width = borders[1] - borders[0]
    weights, slopes = scratch[0], scratch[1]
    total = 0.0
    for ray in range(len(landed) - 1):
        if (ray + 1) % row == 0 or landed[ray, 1] < 0.0 or landed[ray + 1, 1] < 0.0:
            continue
        low, high = (ray, ray + 1) if landed[ray, 0] <= landed[ray + 1, 0] else (ray + 1, ray)
        start, end = landed[low, 0], landed[high, 0]
        span = max(end - start, 1e-12)
        amount = flux[ray] * 0.5 * (landed[low, 1] + landed[high, 1])
        total += amount
        first = int(np.floor((start - borders[0]) / width))
        last = int(np.floor((end - borders[0]) / width))
        for pixel in range(max(first, 0), min(last, len(light) - 1) + 1):
            share = (min(end, borders[pixel + 1]) - max(start, borders[pixel])) / span
            light[pixel] += amount * share
            by_end = amount * ((1.0 if end < borders[pixel + 1] else 0.0) - share) / span
            by_start = amount * (share - (1.0 if start > borders[pixel] else 0.0)) / span
            for side in range(2):
                of_ray = low if side == 0 else high
                by_place = by_start if side == 0 else by_end
                for face in range(2):
                    first_of = _spline(profiles[face], angles[of_ray, face], weights, slopes)
                    by_value = derivatives[of_ray, face, 0]
                    by_slope = derivatives[of_ray, face, 1]
                    half = 0.5 * flux[ray] * share
                    of_value = by_place * by_value[0] + half * by_value[1]
                    of_slope = by_place * by_slope[0] + half * by_slope[1]
                    for k in range(6):
                        slopes_of_light[pixel, face, first_of + k] += of_value * weights[k] + of_slope * slopes[k]
    return total


@dataclass(frozen=True)
class PlaneLight:
    """Light of the pixels and its derivatives by the coefficients.

    ``leaving``: of all pixels and beside them. ``lost``: flux of rays that do not leave. ``folded``: share of the steps
    between neighbours against the way of most of their node.
    """

    pixels: Float[np.ndarray, " p"]
    slopes: Float[np.ndarray, "p 2 c"]
    leaving: float
    lost: float
    folded: float


@dataclass(frozen=True)
class PlaneScene:
    """A source on z = 0, an index, and a line of pixels; see `plane_tracer.PlaneSource` for the source.

    ``nodes``: places of the source, and ``cells`` between slopes.
    """

    half_mm: float
    steepest: float
    variance: float
    index: float
    distance_mm: float
    borders: Float[np.ndarray, " b"]
    nodes: int = 128
    cells: int = 400

    @cached_property
    def starts(self) -> Float[np.ndarray, "r 2"]:
        """Place and slope of each ray."""
        places = self.half_mm * np.polynomial.legendre.leggauss(self.nodes)[0]
        slopes = self.steepest * np.linspace(-1.0, 1.0, self.cells + 1)
        return np.stack(np.meshgrid(places, slopes, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def flux(self) -> Float[np.ndarray, " r"]:
        """Flux between a ray and the next, of 1 in all."""
        nodes, weights = np.polynomial.legendre.leggauss(self.nodes)
        middles = np.linspace(-1.0, 1.0, 2 * self.cells + 1)[1::2]
        of_places = weights * np.exp(-0.5 * nodes**2 / self.variance)
        of_slopes = np.append(np.exp(-0.5 * middles**2 / self.variance), 0.0)
        flux = np.outer(of_places, of_slopes)
        return (flux / flux.sum()).ravel()

    def light(self, profiles: Coefficients) -> PlaneLight:
        """The light of a lens of these profiles."""
        count = len(self.starts)
        landed = np.empty((count, 2))
        angles = np.empty((count, 2))
        derivatives = np.empty((count, 2, 2, 2))
        scratch = np.zeros((6, 6))
        changes = np.zeros((2, 3))
        _trace(profiles, self.starts, self.index, self.distance_mm, landed, angles, derivatives, changes, scratch)
        pixels = np.zeros(len(self.borders) - 1)
        slopes = np.zeros((len(pixels), *profiles.shape))
        row = self.cells + 1
        leaving = _onto_pixels(
            profiles, row, self.flux, landed, angles, derivatives, self.borders, pixels, slopes, scratch
        )
        steps = np.diff(landed[:, 0].reshape(-1, row), axis=1)
        folded = float(np.mean(steps * np.median(steps) < 0.0))
        return PlaneLight(pixels, slopes, leaving, float(self.flux[landed[:, 1] < 0.0].sum()), folded)


def error(light: Float[np.ndarray, " p"], wanted: Float[np.ndarray, " p"]) -> float:
    """Mean absolute error of two distributions of light over the mean, each of a flux of 1."""
    return float(np.abs(light / light.sum() - wanted / wanted.sum()).sum())


_HELD = 100.0  # weight of the middle of both faces, which the light leaves nearly open
_STIFF = 100.0  # weight of second differences in the damping of a step: broad changes come first
_STIFF_AT_END = 1.0  # the same where single pixels count
_FIRM = 1e-3  # weight of each coefficient in it
_STIFFER = 4.0  # damping after a step that is taken back, and
_SOFTER = 10.0  # after one that is kept
_LEAST_DAMPING = 1e-9
_MOST_DAMPING = 1e7
_MOST_LOST = 1e-3
_LARGEST_STEP = 0.08  # of a coefficient
_ENOUGH = 2e-3  # share of the squared error that a step must take away


@dataclass(frozen=True)
class FitStep:
    """Profiles after some seconds of the processor, and their error."""

    profiles: Coefficients
    error: float
    seconds: float


@dataclass(frozen=True)
class _Residuals:
    """What a fit minimises: light off the wanted one, pixel by pixel or added up from one side, and the sizes."""

    scene: PlaneScene
    wanted: Float[np.ndarray, " p"]
    summed: bool
    sizes: Float[np.ndarray, "2"]

    def of(self, profiles: Coefficients, light: PlaneLight) -> tuple[np.ndarray, np.ndarray]:
        """Residuals, and their derivatives by the relative change of each free coefficient."""
        count = len(self.wanted)
        off = count * (light.pixels / light.leaving - self.wanted / self.wanted.sum())
        free = (profiles.shape[1] + 1) // 2
        relative = light.slopes * self.sizes[:, None]
        halves = relative[:, :, :free].copy()
        halves[:, :, : profiles.shape[1] - free] += relative[:, :, ::-1][:, :, : profiles.shape[1] - free]
        slopes = count * halves.reshape(count, -1) / light.leaving
        if self.summed:  # light that misses the pixels to the left counts as before the first
            off = (np.cumsum(off) - 0.5 * off.sum()) / np.sqrt(count)
            slopes = (np.cumsum(slopes, axis=0) - 0.5 * slopes.sum(axis=0)) / np.sqrt(count)
        held = np.kron(np.eye(2), np.append(np.zeros(free - 1), 1.0))
        means = profiles[:, free - 1] / self.sizes - 1.0
        return np.append(off, _HELD * means), np.vstack([slopes, _HELD * held])


def fitted(scene: PlaneScene, profiles: Coefficients, wanted: Float[np.ndarray, " p"]) -> Iterator[FitStep]:
    """Fit both profiles, even about z, to the ``wanted`` light by Levenberg's and Marquardt's method, step by step.

    First the light is added up from one side: there it is moved far, which pixels by themselves do not see.
    """
    begin = time.process_time()
    residuals = _Residuals(scene, wanted, True, profiles[:, (profiles.shape[1] - 1) // 2])
    step = FitStep(profiles, np.inf, 0.0)
    for summed in (True, False):
        for moved, light in _descent(replace(residuals, summed=summed), step.profiles):
            step = FitStep(moved, error(light.pixels, wanted), time.process_time() - begin)
            yield step


def _descent(residuals: _Residuals, profiles: Coefficients) -> Iterator[tuple[Coefficients, PlaneLight]]:
    count = profiles.shape[1]
    free = (count + 1) // 2
    bends = np.diff(_even(np.eye(free), count), n=2, axis=1)
    stiff = _STIFF if residuals.summed else _STIFF_AT_END
    held = np.kron(np.eye(2), stiff * bends @ bends.T + _FIRM * np.eye(free))
    damping = 1.0
    off, slopes = residuals.of(profiles, residuals.scene.light(profiles))
    while damping < _MOST_DAMPING:
        step = -np.linalg.solve(slopes.T @ slopes + damping * held, slopes.T @ off).reshape(2, free)
        moved = profiles + residuals.sizes[:, None] * _even(step, count)
        light = residuals.scene.light(moved) if np.abs(step).max() < _LARGEST_STEP else None
        after = residuals.of(moved, light) if light is not None and light.lost < _MOST_LOST else None
        if light is None or after is None or not after[0] @ after[0] < off @ off:
            damping *= _STIFFER
            continue
        gain = 1.0 - after[0] @ after[0] / (off @ off)
        profiles = moved
        off, slopes = after
        damping = max(damping / _SOFTER, _LEAST_DAMPING)
        yield profiles, light
        if gain < _ENOUGH:
            return


def _even(halves: Float[np.ndarray, "n h"], count: int) -> Float[np.ndarray, "n c"]:
    """Rows of coefficients that are even about z, by their first halves."""
    return np.concatenate([halves, halves[:, ::-1][:, count % 2 :]], axis=1)
