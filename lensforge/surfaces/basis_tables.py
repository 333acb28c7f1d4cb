"""Tables from the weights of basis functions: patches of spline coefficients, and maps level by level.

A function is sampled where it is not negligible, on a grid as fine as its own level needs. The grids are halvings of
one another, so that a level's spline is carried over to the next finer grid exactly. A step of a search then costs
little more with thousands of narrow functions than with hundreds: each covers few nodes, and broad functions do not
fill a fine grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import BSpline
from scipy.ndimage import spline_filter1d
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from lensforge.errors import InputError
from lensforge.surfaces import surface
from lensforge.surfaces.bicubic_table import APRON, TableGrid, grid_for
from lensforge.surfaces.srbf import SrbfBasis, fibonacci_hemisphere, gaussians, level_sigma

_NEGLIGIBLE = 1e-5  # coefficient of a function of height 1: a tenth of the error of a table of 3.4 nodes per sigma
_BEYOND = 0.1  # of the above, to which a function is sampled, and some nodes more: the filter's ends must not be felt
_MARGIN = 4
_BEHIND = 0.75 * np.pi  # from the axis: further down a patch would reach towards the chart's singular point


@dataclass(frozen=True)
class LevelPatches:
    """The ``m`` functions of a level on its ``grid``, which is the table's halved ``halvings`` times.

    ``boxes`` (m, 4): first row (X) and column (Y), rows and columns of each patch in a table of the grid. ``values``:
    all patches one after the other, by rows.
    """

    grid: TableGrid
    halvings: int
    boxes: Int[np.ndarray, "m 4"]
    values: Float[np.ndarray, " v"]

    @cached_property
    def starts(self) -> Int[np.ndarray, " m"]:
        """Index at which each patch begins in ``values``."""
        sizes = self.boxes[:, 2] * self.boxes[:, 3]
        first: Int[np.ndarray, " m"] = np.cumsum(sizes) - sizes
        return first


def dyadic_grid(details_rad: Sequence[float], nodes_per_sigma: float) -> tuple[TableGrid, list[int]]:
    """A grid that resolves the narrowest of some functions, and how often it may be halved for each of them.

    Raises :class:`InputError` where that takes more nodes than fit.
    """
    cells = [grid_for(sigma, nodes_per_sigma).nodes - 1 for sigma in details_rad]
    most = max(0, int(np.log2(max(cells) / min(cells))))
    finest = -(-max(cells) // 2**most) * 2**most
    halvings = [max(k for k in range(most + 1) if k == 0 or finest >> k >= each) for each in cells]
    return TableGrid(finest + 1), halvings


def level_patches(basis: SrbfBasis, grid: TableGrid, halvings: Sequence[int]) -> list[LevelPatches]:
    """Patches of all levels of ``basis``, coarse first, for tables of ``grid``."""
    return [
        _patches(TableGrid((grid.nodes - 1 >> times) + 1), times, count, level_sigma(count, basis.sigma_c))
        for count, times in zip(basis.levels, halvings, strict=True)
    ]


def _patches(grid: TableGrid, halvings: int, count: int, sigma: float) -> LevelPatches:
    centres = fibonacci_hemisphere(count)
    reach = sigma * np.sqrt(-np.log(_BEYOND * _NEGLIGIBLE))
    found = [_patch(grid, centre, sigma, reach) for centre in centres]
    boxes = np.array([(row, column, *patch.shape) for row, column, patch in found])
    return LevelPatches(grid, halvings, boxes, np.concatenate([patch.ravel() for *_, patch in found]))


def _patch(
    grid: TableGrid, centre: Float[np.ndarray, "3"], sigma: float, reach: float
) -> tuple[int, int, Float[np.ndarray, "r c"]]:
    """First row and column, and the coefficients of the function at ``centre`` that are not negligible."""
    polar = np.arccos(centre[2])
    radius = np.tan(0.5 * min(polar + reach, _BEHIND)) - np.tan(0.5 * polar)  # on the chart; the largest is outwards
    nodes = int(np.ceil(radius / grid.step)) + _MARGIN
    middle = np.rint((surface.to_chart(centre) - grid.origin) / grid.step).astype(int)
    low, high = np.maximum(middle - nodes, -APRON), np.minimum(middle + nodes, grid.side - 1 + APRON)
    x, y = (grid.origin + grid.step * np.arange(low[axis], high[axis] + 1) for axis in (0, 1))
    directions = surface.to_sphere(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    block = gaussians(directions.reshape(-1, 3), centre[None], np.array([sigma])).reshape(len(x), len(y))
    for axis in (0, 1):
        block = spline_filter1d(block, order=3, axis=axis, mode="mirror")
    first = np.maximum(-low, 0)
    block = block[first[0] : grid.side - low[0], first[1] : grid.side - low[1]]
    kept = np.abs(block) > _NEGLIGIBLE
    rows, columns = np.nonzero(kept.any(axis=1))[0], np.nonzero(kept.any(axis=0))[0]
    cut = block[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return int(low[0] + first[0] + rows[0]), int(low[1] + first[1] + columns[0]), cut


_NEGLIGIBLE_IN_MAP = 1e-10  # of a function's peak
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
    angle = min(sigma * np.sqrt(-np.log(_NEGLIGIBLE_IN_MAP)), np.pi)
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
        first = -surface.HALF_WIDTH - APRON * own.step
        knots = first + own.step * np.arange(-2, len(matrix) + 2)
        reach = surface.HALF_WIDTH + APRON * grid.step
        nodes = np.linspace(-reach, reach, grid.nodes + 2 * APRON)
        matrix = BSpline.design_matrix(nodes, knots, 3) @ coefficients
    kept = spline_filter1d(matrix, order=3, axis=0, mode="mirror")[APRON - 1 : APRON + grid.nodes + 1]
    return csr_matrix(np.where(np.abs(kept) > _FAR, kept, 0.0))
