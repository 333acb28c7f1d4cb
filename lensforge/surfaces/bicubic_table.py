"""Table of a surface: a uniform bicubic B-spline of ``rho`` over the stereographic chart.

The coefficients are linear in the SRBF weights (``BasisTables`` is the map), and the cost of tracing a ray does
not depend on the number of functions. The table's error against the exact sum falls as the fourth power
of the node spacing (:func:`table_error` measures it).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import spline_filter1d

from lensforge.errors import InputError
from lensforge.surfaces import surface as chart
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
        """Coefficients per side: the cubic needs one beyond each end."""
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
        kept = slice(APRON - 1, APRON + self.nodes + 1)
        return np.ascontiguousarray(block[kept, kept]).reshape(self.side**2, -1)


def grid_for(sigma_min_rad: float, nodes_per_sigma: float) -> TableGrid:
    """The grid whose apex step is ``sigma_min / nodes_per_sigma``, with at least 24 nodes.

    Raises :class:`InputError` where that takes more nodes than fit.
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
    """The four uniform cubic B-splines of a cell, or their derivatives of ``order`` per step, at the fraction ``f``."""
    pieces = [np.poly1d(p) / 6.0 for p in ([-1, 3, -3, 1], [3, -6, 0, 4], [-3, 3, 3, 1], [1, 0, 0, 0])]
    return [piece.deriv(order)(f) if order else piece(f) for piece in pieces]


def table_error(
    grid: TableGrid, table: Float[np.ndarray, "side side"], surface: Surface, samples: int = 4096, seed: int = 0
) -> float:
    """Largest |table - exact radius| (mm) over random directions of the hemisphere, off the nodes."""
    rng = np.random.default_rng(seed)
    z, azimuth = rng.random(samples), 2.0 * np.pi * rng.random(samples)
    sine = np.sqrt(1.0 - z * z)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=-1)
    return float(np.abs(evaluate_table(grid, table, directions) - surface.radius(directions)).max())
