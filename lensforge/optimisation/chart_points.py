"""Points of the chart at which constraints hold, and the matrices from a table to its radius and derivatives there.

The points are the table's nodes, the centres of its cells and the rim: a symmetric lens has its peak on the axis,
which is a centre when the number of nodes is even, and its thinnest wall is often on the rim, between the nodes.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix, vstack
from torch import Tensor

from lensforge.kernels.sparse import SparseMatrix
from lensforge.surfaces import chart
from lensforge.surfaces.spline import TableGrid, cubic_basis
from lensforge.surfaces.symmetry import first_images

_VALUE = ((0, 0),)
_JET = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


@dataclass(frozen=True, eq=False)
class ChartPoints:
    """``k`` points of the chart: coordinates, and the scale ``2/(1 + X^2 + Y^2)`` from chart to sphere.

    ``spacing``: chart distance from a point to the others of its cell, for which it speaks too; 0: for itself alone.
    """

    x: Float[Tensor, " k"]
    y: Float[Tensor, " k"]
    spacing: float = 0.0

    @staticmethod
    def of(points: Float[np.ndarray, "k 2"], spacing: float = 0.0) -> "ChartPoints":
        """The points in the rows of an array."""
        x, y = torch.from_numpy(np.ascontiguousarray(points.T))
        return ChartPoints(x, y, spacing)

    @cached_property
    def scale(self) -> Float[Tensor, " k"]:
        """Angle (rad) on the sphere for a unit of the chart."""
        return 2.0 / (1.0 + self.x**2 + self.y**2)

    @cached_property
    def cosine(self) -> Float[Tensor, " k"]:
        """Cosine of the polar angle."""
        return self.scale - 1.0

    @cached_property
    def directions(self) -> Float[Tensor, "k 3"]:
        """Unit vectors from the origin."""
        return torch.stack([self.x * self.scale, self.y * self.scale, self.cosine], dim=1)


@dataclass(frozen=True)
class RadiusJet:
    """``rho`` (mm) and its derivatives by the chart coordinates at ``k`` points; none where only ``rho`` is needed.

    ``table``: that it was taken from.
    """

    rho: Float[Tensor, " k"]
    derivatives: Float[Tensor, "d k"]  # by X, Y, XX, XY, YY
    table: Float[Tensor, "side side"] | None = None


@dataclass(frozen=True)
class ChartOperator:
    """A set of chart points, and the matrix from a table's coefficients to radius and derivatives at them."""

    points: ChartPoints
    operator: SparseMatrix

    @staticmethod
    def of(
        grid: TableGrid, points: Float[np.ndarray, "k 2"], derivatives: bool, spacing: float = 0.0
    ) -> "ChartOperator":
        """Operator for tables of ``grid``; with ``derivatives`` the first and second ones too."""
        orders = _JET if derivatives else _VALUE
        matrix = vstack([_evaluation(grid, points, order) for order in orders], format="csr")
        return ChartOperator(ChartPoints.of(points, spacing), SparseMatrix(matrix))

    def jets(self, *tables: Float[Tensor, "side side"]) -> list[RadiusJet]:
        """Radius and derivatives of each table; differentiable by its coefficients."""
        columns = torch.stack([table.reshape(-1) for table in tables], dim=1)
        values = (self.operator @ columns).T.reshape(len(tables), -1, len(self.points.x))
        return [RadiusJet(each[0], each[1:], table) for each, table in zip(values, tables, strict=True)]


def constraint_points(grid: TableGrid, symmetry: str, *, every_node: int | None = None) -> Float[np.ndarray, "k 2"]:
    """Chart points of the nodes and cell centres within the hemisphere, and of the rim at the nodes' spacing.

    With ``every_node`` fewer: each first, second, ... node of a row, and no centres. Of mirror images under the group
    ``symmetry`` only one is kept.
    """
    nodes = chart.grid(grid.nodes)
    middles = nodes[:-1, :-1] + 0.5 * grid.step
    if every_node is None:
        both = np.concatenate([nodes.reshape(-1, 2), middles.reshape(-1, 2)])
    else:
        both = nodes[::every_node, ::every_node].reshape(-1, 2)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 8 * int(np.ceil(0.25 * np.pi / grid.step)), endpoint=False)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    points = np.concatenate([both[np.sum(both**2, axis=1) < 1.0], rim])
    kept: Float[np.ndarray, "k 2"] = points[first_images(points, symmetry)]
    return kept


def _evaluation(grid: TableGrid, points: Float[np.ndarray, "k 2"], order: tuple[int, int]) -> csr_matrix:
    """Matrix with one row for each point: the mixed derivative ``order`` of the table there."""
    (at_x, by_x), (at_y, by_y) = (_taps(grid, points[:, axis], order[axis]) for axis in (0, 1))
    columns = at_x[:, :, None] * grid.side + at_y[:, None, :]
    factors = by_x[:, :, None] * by_y[:, None, :]
    rows = np.broadcast_to(np.arange(len(points))[:, None, None], columns.shape)
    matrix = csr_matrix((factors.ravel(), (rows.ravel(), columns.ravel())), shape=(len(points), grid.side**2))
    matrix.eliminate_zeros()
    return matrix


def _taps(
    grid: TableGrid, at: Float[np.ndarray, " k"], order: int
) -> tuple[Int[np.ndarray, "k t"], Float[np.ndarray, "k t"]]:
    """Indices of the coefficients, and their factors, of a derivative along one axis.

    At nodes and centres an interpolating cubic's slope is of fourth order, its second derivative of second order: it
    lacks ``h^2 (1/12 - f(1 - f)/2)`` times the fourth derivative, which the fourth difference of the table supplies.
    """
    position = (at - grid.origin) / grid.step
    cell = np.floor(position + 1e-9).astype(int)  # on the hemisphere all four coefficients are there
    f = position - cell
    index = cell[:, None] + np.arange(-1, 3)
    factors = np.stack(cubic_basis(f, order), axis=1) / grid.step**order
    if order < 2:
        return index, factors
    lack = (1.0 / 12.0 - 0.5 * f * (1.0 - f)) / grid.step**2
    for centre, share in ((cell, 1.0 - f), (cell + 1, f)):
        middle = np.clip(centre, 2, grid.side - 3)
        index = np.concatenate([index, middle[:, None] + np.arange(-2, 3)], axis=1)
        factors = np.concatenate([factors, (lack * share)[:, None] * _FOURTH_DIFFERENCE], axis=1)
    return index, factors
