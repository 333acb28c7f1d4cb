"""Resolution of an intensity table by the light itself: as fine as its structure needs and its rays allow.

Two tables of the same rays, one with twice the nodes, differ by structure that the coarser one leaves out and by the
noise of the finer. Independent samples of the rays tell one from the other: the mean square of the difference less its
standard error squared is the structure alone. A finer table is taken while it gains more structure than noise.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from lensforge.light.angular_grid import AngularGrid, Axis
from lensforge.light.least_irradiance import largest_without_noise
from lensforge.results import Extent, Metric
from lensforge.sources.intensity import TabulatedIntensity

_COARSEST = (4, 6)  # halvings of the finest grid in C and in gamma, where the choice begins: 10 by 10 degrees
_BRIGHT = 0.1  # of the peak: where relative errors are stated
_LEAST_SAMPLES = 3  # by which an error of interpolation, and the error of that, can be told from noise
_RICHARDSON = 4.0 / 3.0  # the error of linear interpolation is 4/3 of what halving its steps changes

Level = tuple[int, int]  # halvings of the finest grid in C and in gamma
Samples = Float[np.ndarray, "p c g"]


@dataclass(frozen=True, eq=False)
class FittedIntensity:
    """Intensity tables (W/sr) of independent samples on ``grid``, each of all the flux; their mean is the result.

    ``interpolation_error``: rms, relative to the peak, of what a table of half the steps adds where the light is
    brighter than a tenth of the peak, and one standard error of that; None where so few samples cannot tell.
    ``finer``: the table of half the steps, by all samples: what it changes is the error of a figure by interpolation.
    """

    grid: AngularGrid
    samples: Samples
    interpolation_error: float | None
    finer: TabulatedIntensity

    @property
    def values(self) -> Float[np.ndarray, "c g"]:
        """Intensity (W/sr) at the nodes; on the axis, where all planes meet, the same in all of them."""
        mean: Float[np.ndarray, "c g"] = self.samples.mean(axis=0)
        return mean

    @property
    def standard_errors(self) -> Float[np.ndarray, "c g"] | None:
        """Standard error (W/sr) at each node, by the spread of the samples; None where there is one alone."""
        count = len(self.samples)
        if count < 2:
            return None
        errors: Float[np.ndarray, "c g"] = self.samples.std(axis=0, ddof=1) / np.sqrt(count)
        return errors

    @property
    def node_error(self) -> Extent | None:
        """Relative standard error of the nodes brighter than a tenth of the peak: rms, by solid angle, and largest."""
        errors, values = self.standard_errors, self.values
        if errors is None:
            return None
        bright = _bright(values)
        relative = errors[bright] / values[bright]
        weights = np.broadcast_to(self.grid.solid_angles, values.shape)[bright]
        rms = float(np.sqrt((relative**2 @ weights) / weights.sum()))
        return Extent(max=float(relative.max()), rms=rms)

    @cached_property
    def peak(self) -> Metric:
        """Largest intensity (W/sr), noise taken off.

        The largest of many noisy numbers is too large: ``evaluation.minimum`` says how that is found.
        """
        largest = largest_without_noise(self.samples.reshape(len(self.samples), -1))
        return largest.model_copy(update={"unit": "W/sr"})


def fit(finest: AngularGrid, deposits: Samples) -> FittedIntensity:
    """Fit a table to the ``deposits`` of independent samples on ``finest``, at the resolution that they support.

    The finest grid itself is not used: by it the error of the next is measured.
    """
    pyramid = _Pyramid(finest, deposits)
    level: Level = _COARSEST
    while (finer := _worthwhile(pyramid, level)) is not None:
        level = finer
    half = (level[0] - 1, level[1] - 1)
    table = pyramid.grid(half).table(pyramid.table(half).mean(axis=0))
    return FittedIntensity(pyramid.grid(level), pyramid.table(level), _interpolation_error(pyramid, level), table)


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
            grid = self.grid(level)
            self._tables[level] = grid.fitted(self._deposits[level])
        return self._tables[level]

    def difference(self, coarse: Level, fine: Level) -> Samples:
        """Tables at ``fine`` less those at ``coarse``, on the grid of ``fine``."""
        values = self.table(coarse)
        for c in range(coarse[0], fine[0], -1):
            values = self.grid((c - 1, coarse[1])).refined(values, "c")
        for gamma in range(coarse[1], fine[1], -1):
            values = self.grid((fine[0], gamma - 1)).refined(values, "gamma")
        added: Samples = self.table(fine) - values
        return added


def _before(level: Level) -> tuple[Level, Axis]:
    """Level from which one halving leads to ``level``, and its axis."""
    c, gamma = level
    return ((c - 1, gamma), "c") if c > 0 else ((c, gamma - 1), "gamma")


def _worthwhile(pyramid: _Pyramid, level: Level) -> Level | None:
    """The finer level that gains most; None where none gains structure beyond its noise."""
    c, gamma = level
    best, gain = None, 0.0
    for finer in ((c - 1, gamma), (c, gamma - 1), (c - 1, gamma - 1)):
        if min(finer) < 1:
            continue
        difference, fine = pyramid.difference(level, finer), pyramid.grid(finer)
        if len(difference) < 2:
            continue
        structure = float((_mean_square(difference) * fine.solid_angles).sum())
        noise = float((_variance(pyramid.table(finer)) * fine.solid_angles).sum())
        noise -= float((_variance(pyramid.table(level)) * pyramid.grid(level).solid_angles).sum())
        if structure - noise > gain:
            best, gain = finer, structure - noise
    return best


def _interpolation_error(pyramid: _Pyramid, level: Level) -> float | None:
    """Error of the table by what half its steps add, one standard error (by the jackknife) above the estimate."""
    finer = (level[0] - 1, level[1] - 1)
    difference, grid = pyramid.difference(level, finer), pyramid.grid(finer)
    count = len(difference)
    if count < _LEAST_SAMPLES:
        return None
    mean = pyramid.table(level).mean(axis=0)
    bright = _bright(grid.refined(grid.coarser("gamma").refined(mean[None], "c"), "gamma")[0])
    weights = np.broadcast_to(grid.solid_angles, bright.shape)[bright]
    added = difference[:, bright]
    total, squares = added.sum(axis=0), (added**2).sum(axis=0)
    whole = (total**2 - squares) @ weights / (count * (count - 1.0) * weights.sum())
    without = [((total - own) ** 2 - squares + own**2) @ weights for own in added]
    spread = np.std(without) / ((count - 1.0) * (count - 2.0) * weights.sum())
    square = whole + np.sqrt(count - 1.0) * spread
    return _RICHARDSON * float(np.sqrt(max(square, 0.0))) / float(mean.max())


def _bright(values: Float[np.ndarray, "c g"]) -> Bool[np.ndarray, "c g"]:
    found: Bool[np.ndarray, "c g"] = values > _BRIGHT * values.max()
    return found


def _variance(samples: Samples) -> Float[np.ndarray, "c g"]:
    """Variance of the mean of ``samples``."""
    variance: Float[np.ndarray, "c g"] = samples.var(axis=0, ddof=1) / len(samples)
    return variance


def _mean_square(samples: Samples) -> Float[np.ndarray, "c g"]:
    """Square of the mean of ``samples`` less its variance: unbiased for the square of what they have in common."""
    square: Float[np.ndarray, "c g"] = samples.mean(axis=0) ** 2 - _variance(samples)
    return square
