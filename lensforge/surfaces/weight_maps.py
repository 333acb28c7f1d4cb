"""Maps from weights to table coefficients, level by level: the cost grows with the area that each function covers.

A function is sampled where it is not negligible, on a grid as fine as its own level needs; the level's spline is then
carried over to the table's grid, which is one banded matrix along each axis. So a step of the search costs hardly more
with thousands of narrow functions than with hundreds, and broad functions do not fill a fine grid.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import spline_filter1d
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from lensforge.errors import InputError
from lensforge.surfaces import chart
from lensforge.surfaces.spline import APRON, TableGrid, grid_for
from lensforge.surfaces.srbf import SrbfBasis, fibonacci_hemisphere, level_sigma

_NEGLIGIBLE = 1e-10  # of a function's peak
_FAR = 1e-14  # a spline's coefficient depends on a sample by 2 - sqrt(3) less a node: nothing is left after some 24
_FINER = 1.3  # a coarse level's nodes per sigma over the finest's: its error is then a third of the table's
_SURVEYED = 128  # functions whose samples are counted, to know how many there will be
_MOST_BYTES = 8 * 2**30
_BYTES_PER_SAMPLE = 48  # while the map is built; 12 stay, value and index


@dataclass(frozen=True)
class WeightMap:
    """One level: ``coefficients = refine @ square(samples @ weights) @ refine.T``, before mirror images are averaged.

    ``samples`` (n^2, m): the functions at the nodes of the level's grid, X slowest. ``refine`` (side, n): along one
    axis, from those samples to the coefficients of the table; a band.
    """

    samples: csr_matrix
    refine: csr_matrix


def weight_maps(grid: TableGrid, basis: SrbfBasis) -> list[WeightMap]:
    """The maps of all levels of ``basis`` to tables on ``grid``, coarse first.

    Raises :class:`InputError` before one level takes more than 8 GiB.
    """
    maps = []
    for count in basis.levels:
        sigma = level_sigma(count, basis.sigma_c)
        own = _level_grid(grid, sigma, basis.detail_rad)
        maps.append(WeightMap(_samples(own, count, sigma), _refinement(own, grid)))
    return maps


def _level_grid(grid: TableGrid, sigma: float, finest: float) -> TableGrid:
    """The level's own grid where that is coarser than the table's, by enough that its spline covers the apron."""
    if sigma <= _FINER * finest:
        return grid
    own = grid_for(sigma, _FINER * finest / (2.0 * grid.step))
    return own if (APRON - 1) * own.step >= APRON * grid.step else grid


def _samples(grid: TableGrid, count: int, sigma: float) -> csr_matrix:
    nodes, centres = cKDTree(grid.sample_directions()), cKDTree(fibonacci_hemisphere(count))
    angle = min(sigma * np.sqrt(-np.log(_NEGLIGIBLE)), np.pi)
    chord = 2.0 * np.sin(0.5 * angle)
    some = centres.data[:: -(-count // _SURVEYED)]
    needed = _BYTES_PER_SAMPLE * count * float(nodes.query_ball_point(some, chord, return_length=True).mean())
    if needed > _MOST_BYTES:
        raise InputError(
            f"{count} functions on {grid.nodes} x {grid.nodes} nodes would take {needed / 2**30:.0f} GiB, "
            f"at most {_MOST_BYTES // 2**30}"
        )
    near = nodes.sparse_distance_matrix(centres, chord, output_type="coo_matrix")
    angles = 2.0 * np.arcsin(np.minimum(0.5 * near.data, 1.0))
    values = np.exp(-((angles / sigma) ** 2))
    return csr_matrix((values, (near.row, near.col)), shape=near.shape)


def _refinement(own: TableGrid, grid: TableGrid) -> csr_matrix:
    """Matrix from samples on ``own``, by its spline's values at the nodes of ``grid``, to coefficients on ``grid``."""
    matrix = np.eye(own.nodes + 2 * APRON)
    if own != grid:
        coefficients = spline_filter1d(matrix, order=3, axis=0, mode="mirror")
        first = -chart.HALF_WIDTH - APRON * own.step
        knots = first + own.step * np.arange(-2, len(matrix) + 2)
        reach = chart.HALF_WIDTH + APRON * grid.step
        nodes = np.linspace(-reach, reach, grid.nodes + 2 * APRON)
        matrix = BSpline.design_matrix(nodes, knots, 3) @ coefficients
    kept = spline_filter1d(matrix, order=3, axis=0, mode="mirror")[APRON - 1 : APRON + grid.nodes + 1]
    return csr_matrix(np.where(np.abs(kept) > _FAR, kept, 0.0))
