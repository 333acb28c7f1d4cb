"""An emitter whose radiance depends on position and direction together: near-field data of a real LED."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import remedy
from lensforge.sources.bundle import RayBundle
from lensforge.sources.flux import emitter_flux
from lensforge.sources.inverse_cdf import choose, choose_each, linear_inverse
from lensforge.sources.qmc import sobol
from lensforge.sources.radiance_table import RadianceTable, read_radiance
from lensforge.spec.source import RadianceSource

_BLOCK, _BLOCK_NUMBERS = 2**14, 2**23  # rays drawn at a time, and numbers: each ray needs rows of the table

Cells = tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]  # row and column of each ray's cell


@dataclass(frozen=True, eq=False)
class RadianceEmitter:
    """Rays of equal flux, their density in position and direction in proportion to ``table``; total flux ``flux_w``."""

    table: RadianceTable
    flux_w: float
    ray_count: int | None = None

    @cached_property
    def symmetry(self) -> str:
        """Symmetry of the table."""
        return self.table.symmetry

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux by quasi-Monte-Carlo points in four dimensions."""
        points = sobol(count, 4, seed)
        origins, directions = np.empty((count, 3)), np.empty((count, 3))
        block = max(min(_BLOCK, _BLOCK_NUMBERS // max(self.table.radiance.shape)), 1)
        for start in range(0, count, block):
            some = slice(start, start + block)
            origins[some], directions[some] = self.emit(points[some])
        return RayBundle(origins, directions, np.full(count, self.flux_w / count))

    def emit(self, points: Float[np.ndarray, "n 4"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Map points of the unit cube to start points (mm) and unit directions; equal volumes get equal flux."""
        cells, origins = self._place(points[:, 0], points[:, 1])
        low, between = self._turn(cells, points[:, 3])
        turn = np.deg2rad(self.table.c_deg)
        azimuth = 2.0 * np.pi * between if len(turn) == 1 else turn[low] + between * (turn[low + 1] - turn[low])
        square = self._rise(cells, low, between, points[:, 2])
        sine, cosine = np.sqrt(square), np.sqrt(np.maximum(1.0 - square, 0.0))
        return origins, np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)

    def outline(self) -> Float[np.ndarray, "4 3"]:
        """Rectangle (mm) around the cells that emit."""
        rows, columns = np.nonzero(self.table.cell_fluxes)
        left, right = self.table.x_mm[columns.min()], self.table.x_mm[columns.max() + 1]
        bottom, top = self.table.y_mm[rows.min()], self.table.y_mm[rows.max() + 1]
        return np.array([[left, bottom, 0.0], [right, bottom, 0.0], [right, top, 0.0], [left, top, 0.0]])

    def _place(
        self, down: Float[np.ndarray, " n"], across: Float[np.ndarray, " n"]
    ) -> tuple[Cells, Float[np.ndarray, "n 3"]]:
        """Choose the row by the first number, the column by the second given the row; uniform inside the cell."""
        rows, y = choose(self._rows, down)
        columns, x = choose_each(self._columns[rows], across)
        origins = np.zeros((len(rows), 3))
        for axis, edges, cell, place in ((0, self.table.x_mm, columns, x), (1, self.table.y_mm, rows, y)):
            origins[:, axis] = edges[cell] + place * (edges[cell + 1] - edges[cell])
        return (rows, columns), origins

    def _turn(
        self, cells: Cells, numbers: Float[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Choose the sector of azimuth, and the position in it, by each number given the cell."""
        if len(self.table.c_deg) == 1:
            return np.zeros(len(numbers), dtype=np.int64), numbers
        low, rest = choose_each(self._azimuths[cells], numbers)
        planes = self.table.cumulative[..., -1]
        return low, linear_inverse(planes[(*cells, low)], planes[(*cells, low + 1)], rest)

    def _rise(
        self,
        cells: Cells,
        low: Int[np.ndarray, " n"],
        between: Float[np.ndarray, " n"],
        numbers: Float[np.ndarray, " n"],
    ) -> Float[np.ndarray, " n"]:
        """Choose ``sin^2 gamma`` by each number given the cell and the azimuth."""
        high = np.minimum(low + 1, len(self.table.c_deg) - 1)

        def blend(values: Float[np.ndarray, "y x c g"]) -> Float[np.ndarray, "n g"]:
            share = between[:, None]
            mixed: Float[np.ndarray, "n g"] = (1.0 - share) * values[(*cells, low)] + share * values[(*cells, high)]
            return mixed

        cell, rest = choose_each(blend(self.table.cumulative)[:, 1:], numbers)
        radiance, each = blend(self.table.radiance), np.arange(len(numbers))
        place = linear_inverse(radiance[each, cell], radiance[each, cell + 1], rest)
        squares = self.table.squares
        squared: Float[np.ndarray, " n"] = squares[cell] + place * (squares[cell + 1] - squares[cell])
        return squared

    @cached_property
    def _rows(self) -> Float[np.ndarray, " y"]:
        return np.cumsum(self.table.cell_fluxes.sum(axis=1))

    @cached_property
    def _columns(self) -> Float[np.ndarray, "y x"]:
        return np.cumsum(self.table.cell_fluxes, axis=1)

    @cached_property
    def _azimuths(self) -> Float[np.ndarray, "y x s"]:
        return np.cumsum(self.table.sectors, axis=2)


def radiance_emitter(spec: RadianceSource) -> RadianceEmitter:
    """Build the emitter that ``spec`` describes, in the plane z = 0, of the table's flux unless ``spec`` has one.

    Raises :class:`InputError` for a file that cannot be used.
    """
    with remedy("correct source.file"):
        table = read_radiance(spec.file)
    return RadianceEmitter(table, emitter_flux(spec, table.flux()).flux_w)
