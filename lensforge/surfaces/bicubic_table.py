"""Table of a surface: a uniform bicubic B-spline of ``rho`` over the stereographic chart.

The cost of tracing a ray does not depend on the number of functions. The table's error against the exact sum falls as
the fourth power of the node spacing (:func:`table_error` measures it).

The coefficients are linear in the SRBF weights: each function has a patch of them, where it is not negligible, on a
grid as fine as its own level needs. The grids are halvings of one another, so that a level's spline is carried over to
the next finer grid exactly. A step of a search then costs little more with thousands of narrow functions than with
hundreds: each covers few nodes, and broad functions do not fill a fine grid.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import spline_filter1d

from lensforge.errors import InputError
from lensforge.kernels.bicubic import add_patches, patch_sums, refine, refine_adjoint
from lensforge.surfaces import surface as chart
from lensforge.surfaces.srbf import SrbfBasis, fibonacci_hemisphere, gaussians, level_sigma
from lensforge.surfaces.surface import Surface

# The filter's end condition decays by 2 - sqrt(3) a node: after 24 nodes it is below 1e-13.
APRON = 24
_MOST_NODES = 4096  # a table of 128 MiB


@dataclass(frozen=True)
class TableGrid:
    """``nodes`` per side over the chart's square; a table has ``nodes + 2`` coefficients per side."""

    nodes: int

    @property
    def step(self) -> float:
        """Node spacing in chart units; at the apex one unit is 2 rad, at the rim 1 rad."""
        return 2.0 * chart.HALF_WIDTH / (self.nodes - 1)

    @property
    def side(self) -> int:
        """Coefficients per side: a cubic needs one beyond each end."""
        return self.nodes + 2

    @property
    def origin(self) -> float:
        """Chart coordinate of coefficient 0."""
        return -chart.HALF_WIDTH - self.step

    def sample_directions(self) -> Float[np.ndarray, "k 3"]:
        """Directions of the nodes and of the apron around them, X slowest."""
        count = self.nodes + 2 * APRON
        half = chart.HALF_WIDTH + APRON * self.step
        return chart.to_sphere(chart.grid(count, half)).reshape(-1, 3)

    def coefficients(self, samples: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "s c"]:
        """Interpolating coefficients, flattened X slowest, of ``c`` functions sampled at :meth:`sample_directions`."""
        count = self.nodes + 2 * APRON
        block = samples.reshape(count, count, -1)
        for axis in (0, 1):
            block = spline_filter1d(block, order=3, axis=axis, mode="mirror")
        inner = slice(APRON - 1, APRON + self.nodes + 1)
        return np.ascontiguousarray(block[inner, inner]).reshape(self.side**2, -1)

    def filter_matrix(self) -> Float[np.ndarray, "side n"]:
        """Matrix of :meth:`coefficients` along one axis."""
        filtered = spline_filter1d(np.eye(self.nodes + 2 * APRON), order=3, axis=0, mode="mirror")
        return np.ascontiguousarray(filtered[APRON - 1 : APRON + self.nodes + 1])


def most_per_sigma(sigma_min_rad: float) -> float:
    """Most nodes across the narrowest function for which a grid fits."""
    return sigma_min_rad * (_MOST_NODES - 1) / (4.0 * chart.HALF_WIDTH)


def grid_for(sigma_min_rad: float, nodes_per_sigma: float) -> TableGrid:
    """The grid whose apex step is ``sigma_min / nodes_per_sigma``, with at least 24 nodes.

    Raises :class:`InputError` if that takes more nodes than allowed.
    """
    spans = 4.0 * chart.HALF_WIDTH * nodes_per_sigma
    if not sigma_min_rad * _MOST_NODES > spans:
        raise InputError(
            f"the narrowest function has sigma = {sigma_min_rad:.3g} rad, a table of {_MOST_NODES} nodes a side "
            f"resolves {spans / _MOST_NODES:.2g} rad"
        )
    return TableGrid(max(24, int(np.ceil(spans / sigma_min_rad)) + 1))


def tabulate(grid: TableGrid, surface: Surface) -> Float[np.ndarray, "side side"]:
    """The table of one surface, from its exact radius."""
    count = grid.nodes + 2 * APRON
    samples = surface.radius_on_grid(grid.sample_directions().reshape(count, count, 3))
    return grid.coefficients(samples.reshape(-1, 1)).reshape(grid.side, grid.side)


def evaluate_table(
    grid: TableGrid, table: Float[np.ndarray, "side side"], directions: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """``rho`` of a table at unit directions (plain NumPy; the kernels have a compiled evaluation)."""
    position = (chart.to_chart(directions) - grid.origin) / grid.step
    cell = np.clip(np.floor(position).astype(int), 1, grid.side - 3)
    wx, wy = (cubic_basis(position[:, axis] - cell[:, axis]) for axis in (0, 1))
    total = np.zeros(len(directions))
    for i in range(4):
        for j in range(4):
            total += wx[i] * wy[j] * table[cell[:, 0] - 1 + i, cell[:, 1] - 1 + j]
    return total


def cubic_basis(f: Float[np.ndarray, " k"], order: int = 0) -> list[Float[np.ndarray, " k"]]:
    """The four uniform cubic B-splines of a cell at the fraction ``f``, or their derivatives of ``order`` per step."""
    return [piece(f) for piece in _cubic_pieces(order)]


@lru_cache
def _cubic_pieces(order: int) -> list[np.poly1d]:
    pieces = [np.poly1d(p) / 6.0 for p in ([-1, 3, -3, 1], [3, -6, 0, 4], [-3, 3, 3, 1], [1, 0, 0, 0])]
    return [piece.deriv(order) for piece in pieces] if order else pieces


def table_error(
    grid: TableGrid,
    table: Float[np.ndarray, "side side"],
    surface: Surface,
    samples: int = 4096,
    seed: int = 0,
    within: Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]] | None = None,
) -> float:
    """Largest |table - exact radius| (mm) over random directions of the hemisphere, off the nodes.

    ``within``: tells which directions count; None: all.
    """
    rng = np.random.default_rng(seed)
    z = rng.random(samples)
    azimuth = 2.0 * np.pi * rng.random(samples)
    sine = np.sqrt(1.0 - z * z)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=-1)
    if within is not None:
        directions = directions[within(directions)]
    return float(np.abs(evaluate_table(grid, table, directions) - surface.radius(directions)).max())


_NEGLIGIBLE = 1e-5  # coefficient of a function of height 1: a tenth of the error of a table of 3.4 nodes per sigma
_BEYOND = 0.1  # of the above, to which a function is sampled, and some nodes more: the filter's ends must not be felt
_MARGIN = 4
_BEHIND = 0.75 * np.pi  # from the axis: further down a patch would reach towards the chart's singular point
_BROAD = 0.85  # rad: a function that is as broad is negligible nowhere; its patch is the whole grid


@dataclass(frozen=True)
class LevelPatches:
    """The ``m`` functions of a level on its ``grid``, which is the table's or one of its halvings.

    ``boxes`` (m, 4): first row (X) and column (Y), rows and columns of each patch in a table of the grid. ``values``:
    all patches one after the other, by rows.
    """

    grid: TableGrid
    boxes: Int[np.ndarray, "m 4"]
    values: Float[np.ndarray, " v"]

    @cached_property
    def starts(self) -> Int[np.ndarray, " m"]:
        """Index at which each patch begins in ``values``."""
        sizes = self.boxes[:, 2] * self.boxes[:, 3]
        return np.cumsum(sizes) - sizes


def dyadic_grid(details_rad: Sequence[float], nodes_per_sigma: float) -> tuple[TableGrid, list[int]]:
    """A grid that resolves the narrowest function, and how often it may be halved for each function.

    Raises :class:`InputError` if that takes more nodes than allowed.
    """
    cells = [grid_for(sigma, nodes_per_sigma).nodes - 1 for sigma in details_rad]
    most = max(0, int(np.log2(max(cells) / min(cells))))
    finest = -(-max(cells) // 2**most) * 2**most
    halvings = [max(k for k in range(most + 1) if k == 0 or finest >> k >= needed) for needed in cells]
    return TableGrid(finest + 1), halvings


@dataclass(frozen=True)
class BasisTables:
    """The linear map from the weights of all levels, coarse first, to the coefficients of a table, and its adjoint.

    A table has ``side`` coefficients a side.
    """

    levels: tuple[LevelPatches, ...]
    side: int

    @staticmethod
    def of(basis: SrbfBasis, grid: TableGrid, halvings: Sequence[int]) -> "BasisTables":
        """Maps for tables of ``basis`` on ``grid``; ``halvings``: how often the grid may be halved for each level.

        A level after a finer one takes the finer grid: tables are carried over to finer grids only.
        """
        levels = (
            _patches(TableGrid((grid.nodes - 1 >> times) + 1), count, level_sigma(count, basis.sigma_c))
            for count, times in zip(basis.levels, accumulate(halvings, min), strict=True)
        )
        return BasisTables(tuple(levels), grid.side)

    def table(self, weights: Float[np.ndarray, " k"]) -> Float[np.ndarray, "side side"]:
        """The table, first index X, of one surface."""
        side = self.levels[0].grid.side
        table = np.zeros((side, side))
        for level, level_weights in self._moving(len(weights)):
            table = _finer(table, level.grid.side)
            add_patches(level.boxes, level.starts, level.values, weights[level_weights], table)
        return _finer(table, self.side)

    def by_weights(self, by_table: Float[np.ndarray, "side side"], count: int) -> Float[np.ndarray, " k"]:
        """Adjoint of :meth:`table`: the gradient by the first ``count`` weights."""
        by_weights = np.empty(count)
        for level, level_weights in reversed(list(self._moving(count))):
            by_table = _coarser(by_table, level.grid.side)
            patch_sums(level.boxes, level.starts, level.values, by_table, by_weights[level_weights])
        return by_weights

    def _moving(self, count: int) -> Iterator[tuple[LevelPatches, slice]]:
        """The levels to which the first ``count`` weights belong, each with its weights; levels are not divided."""
        first = 0
        for level in self.levels:
            if first < count:
                yield level, slice(first, first + len(level.boxes))
            first += len(level.boxes)


def _finer(table: Float[np.ndarray, "s s"], side: int) -> Float[np.ndarray, "t t"]:
    """The spline of ``table`` on a grid of ``side`` coefficients, its step the same or halved repeatedly."""
    while len(table) < side:
        fine = 2 * len(table) - 3  # twice the cells, and a coefficient beyond each end
        halfway = np.empty((fine, len(table)))
        finer = np.empty((fine, fine))
        refine(table, halfway, finer)
        table = finer
    return table


def _coarser(by_table: Float[np.ndarray, "t t"], side: int) -> Float[np.ndarray, "s s"]:
    """Adjoint of :func:`_finer`."""
    while len(by_table) > side:
        coarse = (len(by_table) + 3) // 2
        halfway = np.empty((len(by_table), coarse))
        coarser = np.empty((coarse, coarse))
        refine_adjoint(by_table, halfway, coarser)
        by_table = coarser
    return by_table


def _patches(grid: TableGrid, count: int, sigma: float) -> LevelPatches:
    centres = fibonacci_hemisphere(count)
    reach = sigma * np.sqrt(-np.log(_BEYOND * _NEGLIGIBLE))
    patches = [_patch(grid, centre, sigma, reach) for centre in centres]
    boxes = np.array([(row, column, *patch.shape) for row, column, patch in patches])
    return LevelPatches(grid, boxes, np.concatenate([patch.ravel() for *_, patch in patches]))


def _patch(
    grid: TableGrid, centre: Float[np.ndarray, "3"], sigma: float, reach: float
) -> tuple[int, int, Float[np.ndarray, "r c"]]:
    """First row and column, and the coefficients of the function at ``centre`` that are not negligible."""
    polar = np.arccos(centre[2])
    radius = np.tan(0.5 * min(polar + reach, _BEHIND)) - np.tan(0.5 * polar)  # on the chart; the largest is outwards
    nodes = int(np.ceil(radius / grid.step)) + _MARGIN if sigma < _BROAD else grid.side + APRON
    middle = np.rint((chart.to_chart(centre) - grid.origin) / grid.step).astype(int)
    low = np.maximum(middle - nodes, -APRON)
    high = np.minimum(middle + nodes, grid.side - 1 + APRON)
    x, y = (grid.origin + grid.step * np.arange(low[axis], high[axis] + 1) for axis in (0, 1))
    directions = chart.to_sphere(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    block = gaussians(directions.reshape(-1, 3), centre[None], np.array([sigma])).reshape(len(x), len(y))
    for axis in (0, 1):
        block = spline_filter1d(block, order=3, axis=axis, mode="mirror")
    first = np.maximum(-low, 0)
    block = block[first[0] : grid.side - low[0], first[1] : grid.side - low[1]]
    significant = np.abs(block) > _NEGLIGIBLE
    rows = np.nonzero(significant.any(axis=1))[0]
    columns = np.nonzero(significant.any(axis=0))[0]
    cut = block[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return int(low[0] + first[0] + rows[0]), int(low[1] + first[1] + columns[0]), cut
