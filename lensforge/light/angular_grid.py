"""Intensity tables over C and gamma, fitted to the flux of rays at the resolution that these support.

Shares of each ray's flux go to the four nodes around its direction by their bilinear functions, by which readers take a
table, too. Divided by the nodes' solid angles they are too low at a peak, by h^2 I''/12 with steps h. The nearest table
by least squares, the L2 projection on linear finite elements, has the opposite error, and more noise. The mean of both,
along C and along gamma, is right to h^4. All have the flux of the rays.

Near the axis only those waves around it are kept that the steps in gamma resolve as well. The axis itself has the
smallest cell of all: means of cones about it are drawn to one parabola in gamma, as far as noise makes them differ from
it. Choosing one or the other would make figures jump for light whose noise is near the threshold.

Two tables of the same rays, one with twice the nodes, differ by structure and by noise. Independent samples tell one
from the other: a finer table is taken while it gains more structure than noise.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.results import Extent, Metric
from lensforge.results.estimates import debiased_maximum, in_doubt
from lensforge.results.replicate_pairs import error_over_pairs, mean_over_pairs
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.mirror_group import group

if TYPE_CHECKING:
    from scipy import sparse


Axis = Literal["c", "gamma"]
_GAUSS = 6  # points in a cell of gamma: sin(gamma) times a parabola over 10 degrees is integrated to 1e-16


@dataclass(frozen=True, eq=False)
class AngularGrid:
    """Nodes of an intensity table: C at ``planes`` equal steps, ``gamma_deg`` rising from 0 to 90."""

    planes: int
    gamma_deg: Float[np.ndarray, " g"]

    @property
    def c_deg(self) -> Float[np.ndarray, " c"]:
        """Angles of the half-planes, 0 first; 360 is not repeated."""
        return np.arange(self.planes) * (360.0 / self.planes)

    def deposit(self, rays: RayBundle) -> Float[np.ndarray, "c g"]:
        """Split the flux (W) of ``rays``, which go upwards, among the nodes."""
        x, y, z = rays.directions.T
        azimuth, gamma = np.rad2deg(np.arctan2(y, x)), np.rad2deg(np.arctan2(np.hypot(x, y), z))
        flux = np.zeros(self.planes * len(self.gamma_deg))
        for node, share in self._corners(azimuth, gamma):
            flux += np.bincount(node, rays.flux * share, minlength=len(flux))
        return flux.reshape(self.planes, len(self.gamma_deg))

    def readings(self, c_deg: Float[np.ndarray, " k"], gamma_deg: Float[np.ndarray, " k"]) -> "sparse.csr_array":
        """Matrix from the values of a table, in rows of gamma, to the intensity in each of ``k`` directions."""
        from scipy import sparse

        nodes, shares = zip(*self._corners(c_deg, gamma_deg), strict=True)
        rows = np.tile(np.arange(len(c_deg)), len(nodes))
        shape = (len(c_deg), self.planes * len(self.gamma_deg))
        return sparse.csr_array((np.concatenate(shares), (rows, np.concatenate(nodes))), shape=shape)

    def _corners(
        self, c_deg: Float[np.ndarray, " k"], gamma_deg: Float[np.ndarray, " k"]
    ) -> Iterator[tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]]:
        """The four nodes around each direction, one after the other, and the bilinear share of each."""
        nodes = len(self.gamma_deg)
        azimuth = c_deg * (self.planes / 360.0)
        place = np.interp(gamma_deg, self.gamma_deg, np.arange(nodes))
        plane = np.floor(azimuth).astype(int)
        cell = np.minimum(place.astype(int), nodes - 2)
        right, below = azimuth - plane, place - cell
        for next_plane, share_plane in ((0, 1.0 - right), (1, right)):
            for next_cell, share_cell in ((0, 1.0 - below), (1, below)):
                yield (plane + next_plane) % self.planes * nodes + cell + next_cell, share_plane * share_cell

    def images_mean(self, deposits: Float[np.ndarray, "*p c g"], symmetry: str) -> Float[np.ndarray, "*p c g"]:
        """Mean of ``deposits`` and their mirror images under the group ``symmetry``; planes in multiples of 4."""
        total = np.zeros_like(deposits)
        for image in group(symmetry):
            total += deposits[..., self._image_rows(image), :]
        return total / len(group(symmetry))

    def _image_rows(self, image: Float[np.ndarray, "3 3"]) -> Int[np.ndarray, " c"]:
        turn = np.deg2rad(self.c_deg)
        x, y = image[:2, :2] @ np.stack([np.cos(turn), np.sin(turn)])
        return np.asarray(np.round(np.arctan2(y, x) / (2.0 * np.pi) * self.planes).astype(int) % self.planes)

    def coarser(self, axis: Axis) -> "AngularGrid":
        """Grid of every second half-plane, or of every second cone."""
        if axis == "c":
            return AngularGrid(self.planes // 2, self.gamma_deg)
        return AngularGrid(self.planes, self.gamma_deg[::2])

    def restricted(self, deposits: Float[np.ndarray, "p c g"], axis: Axis) -> Float[np.ndarray, "p d h"]:
        """Deposits on :meth:`coarser` of the rays that made ``deposits`` here: exact, without the rays."""
        if axis == "c":
            odd = 0.5 * deposits[:, 1::2]
            return np.asarray(deposits[:, ::2] + odd + np.roll(odd, 1, axis=1))
        along: Float[np.ndarray, "p d h"] = deposits[:, :, ::2].copy()
        odd = deposits[:, :, 1::2]
        share = self._shares
        along[:, :, :-1] += (1.0 - share) * odd
        along[:, :, 1:] += share * odd
        return along

    def refined(self, table: Float[np.ndarray, "p d h"], axis: Axis) -> Float[np.ndarray, "p c g"]:
        """Values here of tables on :meth:`coarser`."""
        values = np.zeros((len(table), self.planes, len(self.gamma_deg)))
        if axis == "c":
            values[:, ::2] = table
            values[:, 1::2] = 0.5 * (table + np.roll(table, -1, axis=1))
            return values
        values[:, :, ::2] = table
        values[:, :, 1::2] = (1.0 - self._shares) * table[:, :, :-1] + self._shares * table[:, :, 1:]
        return values

    @property
    def _shares(self) -> Float[np.ndarray, " h"]:
        """Position of every second cone between its neighbours, 0 to 1."""
        even = self.gamma_deg[::2]
        return np.asarray((self.gamma_deg[1::2] - even[:-1]) / np.diff(even))

    @cached_property
    def solid_angles(self) -> Float[np.ndarray, " g"]:
        """Integral (sr) of a node's bilinear function, by its cone; on the axis that of one of ``planes`` parts."""
        return np.asarray(self._gram.sum(axis=1) * (2.0 * np.pi / self.planes))

    def products(self, samples: Float[np.ndarray, "p c g"]) -> Float[np.ndarray, "p p"]:
        """Products of every pair of ``samples``, node by node, over solid angle."""
        flat = (samples * np.sqrt(self.solid_angles)).reshape(len(samples), -1)
        return np.asarray(flat @ flat.T)

    @cached_property
    def _gram(self) -> Float[np.ndarray, "g g"]:
        """Integrals of the products of two functions of gamma with sin(gamma)."""
        gamma = np.deg2rad(self.gamma_deg)
        points, weights = np.polynomial.legendre.leggauss(_GAUSS)
        share = 0.5 * (1.0 + points)
        half = 0.5 * np.diff(gamma)[:, None]
        measure = half * weights * np.sin(gamma[:-1, None] + 2.0 * half * share)
        gram = np.zeros((len(gamma), len(gamma)))
        cell = np.arange(len(gamma) - 1)
        for row, row_function in ((0, 1.0 - share), (1, share)):
            for column, column_function in ((0, 1.0 - share), (1, share)):
                gram[cell + row, cell + column] += (measure * row_function * column_function).sum(axis=1)
        return gram

    @cached_property
    def _first_nodes(self) -> Int[np.ndarray, " m"]:
        """For each wave around the axis, the first cone whose steps in gamma are no longer than half the wave."""
        gamma = np.deg2rad(self.gamma_deg)
        waves = np.pi * np.sin(gamma) / np.gradient(gamma)
        resolved = waves[None, :] >= np.arange(self.planes // 2 + 1)[:, None]
        return np.where(resolved.any(axis=1), resolved.argmax(axis=1), len(gamma))

    def fitted(self, deposits: Float[np.ndarray, "p c g"]) -> Float[np.ndarray, "p c g"]:
        """Intensities (W/sr) at the nodes for each of ``p`` deposits; some may be below 0."""
        step = 2.0 * np.pi / self.planes
        waves = np.fft.rfft(deposits, axis=1)
        solution = np.zeros_like(waves)
        for wave, first in enumerate(self._first_nodes):
            if first < len(self.gamma_deg):
                right = waves[:, wave].T * (0.5 * (1.0 + 3.0 / (2.0 + np.cos(wave * step))) / step)
                solved = self._along_gamma(np.concatenate([right.real, right.imag], axis=1), int(first))
                solution[:, wave] = (solved[:, : len(deposits)] + 1j * solved[:, len(deposits) :]).T
        solution[:, 0] = self._pooled(solution[:, 0].real, deposits.sum(axis=(0, 1)))
        return np.fft.irfft(solution, n=self.planes, axis=1)

    def _pooled(self, means: Float[np.ndarray, "p g"], flux: Float[np.ndarray, " g"]) -> Float[np.ndarray, "p g"]:
        """``means`` of all cones; those about the axis shrunk to parabolas a + b gamma^2 of the same flux.

        ``flux`` of each cone: typical nodes are those where the light is. A sample acts in two ways: by its own values,
        and by how far all values are shrunk. With the second by the jackknife, errors are up to 1.5 times the true
        scatter, without it 0.5 to 0.9: two thirds of it are used.
        """
        total = float(flux.sum())
        if not total > 0.0:
            return means
        typical = float(flux @ self.solid_angles) / total
        most = int(np.searchsorted(self.planes * np.cumsum(self.solid_angles), _POLE_NODES * typical)) + 1
        most = min(max(most, 3), len(self.gamma_deg))
        drawn = self._drawn_to_parabolas(means, most)
        count = len(means)
        if count < _LEAST_SAMPLES:
            return drawn
        left_out = [self._drawn_to_parabolas(np.delete(means, k, axis=0), most).mean(axis=0) for k in range(count)]
        influences = (count - 1) * (np.mean(left_out, axis=0) - left_out)
        mean = drawn.mean(axis=0)
        return mean + (1.0 - _JACKKNIFE) * (drawn - mean) + _JACKKNIFE * influences

    def _drawn_to_parabolas(self, means: Float[np.ndarray, "p g"], most: int) -> Float[np.ndarray, "p g"]:
        """``means`` with the first 3 to ``most`` cones shrunk to their parabolas in turn.

        A difference shrinks by the share of its square that noise makes (James & Stein 1961). A single sample has no
        known noise, and is taken to the last parabola.
        """
        parts = len(means)
        values = means
        for count in range(3, most + 1):
            weights = self.solid_angles[:count]
            places = np.stack([np.ones(count), self.gamma_deg[:count] ** 2], axis=1)
            normal = places.T @ (weights[:, None] * places)
            parabola = means[:, :count] @ (weights[:, None] * places) @ np.linalg.inv(normal) @ places.T
            off = means[:, :count] - parabola
            share = 1.0
            if parts > 1:
                square = weights @ off.mean(axis=0) ** 2
                noise = weights @ off.var(axis=0, ddof=1) / parts
                share = min(noise / square, 1.0) if square > 0.0 else 1.0
            values = np.concatenate(
                [values[:, :count] + share * (parabola - values[:, :count]), means[:, count:]], axis=1
            )
        return values

    def _along_gamma(self, flux: Float[np.ndarray, "g k"], first: int) -> Float[np.ndarray, "g k"]:
        """Values by gamma from deposits along it, 0 before the node ``first``.

        The average is the nearest table plus what flows between neighbours (each pair of nodes by its product of
        functions), so half of that is their mean. Towards the horizon, where the light is cut off and an average would
        be one-sided, the flow fades out.
        """
        from scipy.linalg import solveh_banded

        beside = np.diagonal(self._gram, 1)
        diagonal = np.diagonal(self._gram)
        sums = self._gram.sum(axis=1)
        values = np.zeros_like(flux)
        bands = np.stack([np.pad(beside[first:], (1, 0)), diagonal[first:]])
        right = flux[first:]
        values[first:] = solveh_banded(bands, right, check_finite=False) if len(right) > 1 else right / diagonal[-1]
        inwards = np.arange(len(beside))[::-1]
        share = 0.5 * np.minimum(inwards / _FADING_STEPS, 1.0)
        flow = (share * beside)[:, None] * np.diff(values, axis=0)
        values[:-1] += flow / sums[:-1, None]
        values[1:] -= flow / sums[1:, None]
        values[:first] = 0.0
        return values

    def table(self, values: Float[np.ndarray, "c g"]) -> TabulatedIntensity:
        """Table of ``values`` with those below 0 removed, of the same flux.

        A cone with values below 0 keeps its flux: its other values are reduced. Cones whose total flux is below 0 are
        made up for by all values.
        """
        flux = float((values * self.solid_angles).sum())
        positive = np.maximum(values, 0.0)
        sums = positive.sum(axis=0)
        cone_sums = np.maximum(values.sum(axis=0), 0.0)
        positive *= np.divide(cone_sums, sums, out=np.zeros_like(sums), where=sums > 0.0)
        positive *= flux / float((positive * self.solid_angles).sum())
        closed = np.concatenate([positive, positive[:1]])
        return TabulatedIntensity(np.append(self.c_deg, 360.0), self.gamma_deg, closed)


_JACKKNIFE = 2.0 / 3.0  # share in the errors of cones about the axis
_POLE_NODES = 4.0  # typical nodes whose solid angle the cones about the axis hold together
_FADING_STEPS = 4  # of gamma before the horizon
_FINEST_PLANES = 576  # every 0.625 degrees
# Steps in gamma: 64 for each 10 degrees of the beam, 128 for narrow ones, 64 beyond it; so that after each of six
# halvings the cones are at even degrees, and the beam's end is one of them.
_NARROW_DEG = (2.5, 5.0, 10.0, 20.0)
_STEPS_PER_10_DEG = 64
_NARROW_STEPS = 128
_OUTSIDE_STEPS = 64


def finest_grid(beam_deg: float) -> AngularGrid:
    """Grid for light nearly all within ``beam_deg`` of the axis: fine there, coarse beyond."""
    narrow_deg = next((end for end in _NARROW_DEG if beam_deg <= end), None)
    reach = min(10.0 * np.ceil(beam_deg / 10.0), 90.0) if narrow_deg is None else narrow_deg
    steps = _NARROW_STEPS if narrow_deg is not None else round(reach / 10.0) * _STEPS_PER_10_DEG
    inside, outside = np.linspace(0.0, reach, steps + 1), np.linspace(reach, 90.0, _OUTSIDE_STEPS + 1)
    return AngularGrid(_FINEST_PLANES, np.unique(np.concatenate([inside, outside])))  # the beam's end once


COARSEST = (4, 6)  # halvings of the finest grid in C and in gamma, where the choice begins: 10 by 10 degrees
COARSEST_TO_HORIZON = (3, 4)  # 5 by 2.5 degrees: CIE 140; by steps of 5 the glare is a tenth off
_BRIGHT = 0.1  # of the peak: where relative errors are stated
_LEAST_SAMPLES = 3  # by which an error of interpolation, and the error of that, can be told from noise
_LEAST_FOR_CHANCE = 4  # samples by which the error of a square is known
_LEAST_CHANCE = 0.01  # of other steps, to count in an error
_RICHARDSON = 4.0 / 3.0  # the error of linear interpolation is 4/3 of what halving its steps changes

Level = tuple[int, int]  # halvings of the finest grid in C and in gamma
Samples = Float[np.ndarray, "p c g"]


@dataclass(frozen=True, eq=False)
class Rival:
    """Tables in other steps, ``light``, which other rays might have chosen.

    ``doubt``: as in :func:`~lensforge.results.estimates.in_doubt`.
    """

    light: "FittedIntensity"
    doubt: float


@dataclass(frozen=True, eq=False)
class FittedIntensity:
    """Intensity tables (W/sr) of independent samples on ``grid``, each of all the flux; their mean is the result.

    ``interpolation_error``: rms, relative to the peak, of what a table of half the steps adds where the light is
    brighter than a tenth of the peak, and one standard error of that; None if the samples are too few to tell.
    ``rival``: None if other rays would choose the same steps.
    """

    grid: AngularGrid
    samples: Samples
    interpolation_error: float | None
    rival: Rival | None = None

    @property
    def values(self) -> Float[np.ndarray, "c g"]:
        """Intensity (W/sr) at the nodes; equal in all planes on the axis, where they meet."""
        return np.asarray(self.samples.mean(axis=0))

    @property
    def standard_errors(self) -> Float[np.ndarray, "c g"] | None:
        """Standard error (W/sr) at each node, by the spread of the samples; None if there is one alone."""
        count = len(self.samples)
        if count < 2:
            return None
        return np.asarray(self.samples.std(axis=0, ddof=1) / np.sqrt(count))

    @property
    def node_error(self) -> Extent | None:
        """Relative standard error of the nodes brighter than a tenth of the peak: rms, by solid angle, and largest."""
        errors = self.standard_errors
        values = self.values
        if errors is None:
            return None
        bright = _bright(values)
        relative = errors[bright] / values[bright]
        weights = np.broadcast_to(self.grid.solid_angles, values.shape)[bright]
        rms = float(np.sqrt((relative**2 @ weights) / weights.sum()))
        return Extent(max=float(relative.max()), rms=rms)

    @cached_property
    def peak(self) -> Metric:
        """Largest intensity (W/sr), corrected for the bias of noise."""
        largest = debiased_maximum(self.samples.reshape(len(self.samples), -1)).changed(unit="W/sr")
        return largest if self.rival is None else in_doubt(largest, self.rival.light.peak, self.rival.doubt)


def fit(finest: AngularGrid, deposits: Samples, coarsest: Level = COARSEST) -> FittedIntensity:
    """Fit a table to the ``deposits`` of independent samples on ``finest``, which measures the error of the next."""
    pyramid = _Pyramid(finest, deposits)
    level, left_out = _chosen(pyramid, coarsest)
    error = _interpolation_error(pyramid, level)
    return FittedIntensity(pyramid.grid(level), pyramid.table(level), error, _rival(pyramid, level, left_out))


class _Pyramid:
    """Grids and fitted tables at all levels, made when needed."""

    def __init__(self, finest: AngularGrid, deposits: Samples) -> None:
        self._grids = {(0, 0): finest}
        self._deposits = {(0, 0): deposits}
        self._tables: dict[Level, Samples] = {}

    def grid(self, level: Level) -> AngularGrid:
        """Grid after the halvings of ``level``."""
        if level not in self._grids:
            before, axis = _before(level)
            self._grids[level] = self.grid(before).coarser(axis)
            self._deposits[level] = self._grids[before].restricted(self._deposits[before], axis)
        return self._grids[level]

    def table(self, level: Level) -> Samples:
        """Tables fitted at ``level``."""
        if level not in self._tables:
            self._tables[level] = self.grid(level).fitted(self._deposits[level])
        return self._tables[level]

    def refined(self, coarse: Level, fine: Level) -> Samples:
        """Tables at ``coarse`` on the grid of ``fine``."""
        values = self.table(coarse)
        for c in range(coarse[0], fine[0], -1):
            values = self.grid((c - 1, coarse[1])).refined(values, "c")
        for gamma in range(coarse[1], fine[1], -1):
            values = self.grid((fine[0], gamma - 1)).refined(values, "gamma")
        return values

    def difference(self, coarse: Level, fine: Level) -> Samples:
        """Tables at ``fine`` less those at ``coarse``, on the grid of ``fine``."""
        return np.asarray(self.table(fine) - self.refined(coarse, fine))

    def noise(self, level: Level) -> Float[np.ndarray, "p p"]:
        """Square of the noise in the mean of the tables at ``level``, by each pair of them."""
        products = self.grid(level).products(self.table(level))
        squares = np.diag(products)
        return (0.5 * (squares[:, None] + squares[None, :]) - products) / len(products)

    def apart(self, first: Level, second: Level) -> float:
        """Square of the difference between the mean tables at two levels."""
        fine = (min(first[0], second[0]), min(first[1], second[1]))
        difference = (self.refined(first, fine) - self.refined(second, fine)).mean(axis=0)
        return float(self.grid(fine).products(difference[None])[0, 0])


def _before(level: Level) -> tuple[Level, Axis]:
    c, gamma = level
    return ((c - 1, gamma), "c") if c > 0 else ((c, gamma - 1), "gamma")


@dataclass(frozen=True)
class _Candidate:
    """A ``level`` to move to, and for each pair of samples its gain: structure less noise, relative to the pair."""

    level: Level
    gains: Float[np.ndarray, "p p"]

    @property
    def gain(self) -> float:
        """The gain, corrected for the noise of squares; 0 for a single sample."""
        return mean_over_pairs(self.gains) if len(self.gains) > 1 else 0.0

    def chance_against(self, best: "_Candidate") -> float:
        """Probability that other rays would prefer this candidate to ``best``; 0 if the samples are too few to tell."""
        if len(self.gains) < _LEAST_FOR_CHANCE:
            return 0.0
        behind = self.gains - best.gains
        error = error_over_pairs(behind)
        return 0.5 * math.erfc(-mean_over_pairs(behind) / error / math.sqrt(2.0)) if error > 0.0 else 0.0


def _candidates(pyramid: _Pyramid, level: Level) -> Iterator[_Candidate]:
    """Candidates: ``level`` itself and its three finer neighbours."""
    c, gamma = level
    stays = pyramid.noise(level)
    yield _Candidate(level, np.zeros_like(stays))
    for finer in ((c - 1, gamma), (c, gamma - 1), (c - 1, gamma - 1)):
        if min(finer) >= 1:
            structure = pyramid.grid(finer).products(pyramid.difference(level, finer))
            yield _Candidate(finer, structure - pyramid.noise(finer) + stays)


def _chosen(pyramid: _Pyramid, level: Level) -> tuple[Level, list[tuple[Level, float]]]:
    """The level from which no finer one gains structure beyond its noise, and the probability of each other level."""
    left_out: list[tuple[Level, float]] = []
    while True:
        best, *losers = sorted(_candidates(pyramid, level), key=lambda candidate: -candidate.gain)
        left_out += [(loser.level, loser.chance_against(best)) for loser in losers]
        if best.level == level:
            return level, left_out
        level = best.level


def _rival(pyramid: _Pyramid, level: Level, left_out: Sequence[tuple[Level, float]]) -> "Rival | None":
    """The rejected level whose probability makes the tables at ``level`` least certain."""
    likely = [(other, chance) for other, chance in left_out if chance > _LEAST_CHANCE]
    if not likely:
        return None
    other, chance = max(likely, key=lambda rival: rival[1] * (1.0 - rival[1]) * pyramid.apart(level, rival[0]))
    return Rival(FittedIntensity(pyramid.grid(other), pyramid.table(other), None), math.sqrt(chance * (1.0 - chance)))


def _interpolation_error(pyramid: _Pyramid, level: Level) -> float | None:
    """Error of the table by what half its steps add, one standard error (by the jackknife) above the estimate."""
    finer = (level[0] - 1, level[1] - 1)
    difference = pyramid.difference(level, finer)
    grid = pyramid.grid(finer)
    count = len(difference)
    if count < _LEAST_SAMPLES:
        return None
    mean = pyramid.table(level).mean(axis=0)
    bright = _bright(grid.refined(grid.coarser("gamma").refined(mean[None], "c"), "gamma")[0])
    weights = np.broadcast_to(grid.solid_angles, bright.shape)[bright]
    added = difference[:, bright]
    total = added.sum(axis=0)
    squares = (added**2).sum(axis=0)
    whole = (total**2 - squares) @ weights / (count * (count - 1.0) * weights.sum())
    without = [((total - sample) ** 2 - squares + sample**2) @ weights for sample in added]
    spread = np.std(without) / ((count - 1.0) * (count - 2.0) * weights.sum())
    square = whole + np.sqrt(count - 1.0) * spread
    return _RICHARDSON * float(np.sqrt(max(square, 0.0))) / float(mean.max())


def _bright(values: Float[np.ndarray, "c g"]) -> Bool[np.ndarray, "c g"]:
    return np.asarray(values > _BRIGHT * values.max())
