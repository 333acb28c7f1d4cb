"""Points of the chart at which constraints hold; radius, derivatives and the extent of a keep-out there.

The points are the table's nodes, the centres of its cells and the rim: a symmetric lens has its peak on the axis, which
is a centre when the number of nodes is even, and its thinnest wall is often on the rim, between the nodes.

The extent of the keep-out is, along each ray from the origin, the last point that must stay clear. A cavity that
reaches further in every direction z >= 0 holds all of the keep-out above z = 0, grown by its margin. The part below
z = 0 concerns the base, which the search does not change: the finished part is measured against it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix, vstack
from scipy.spatial import cKDTree
from torch import Tensor

from lensforge.kernels.clearance import grown_extents
from lensforge.kernels.parallel import in_chunks
from lensforge.kernels.sparse import SparseMatrix
from lensforge.spec import Spec
from lensforge.surfaces import surface
from lensforge.surfaces.bicubic_table import TableGrid, cubic_basis
from lensforge.surfaces.mirror_group import first_images, group
from lensforge.surfaces.srbf import fibonacci_hemisphere

if TYPE_CHECKING:
    from lensforge.cad.keep_out import KeepOut

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

    ``tables``: that it was taken from, of several faces all.
    """

    rho: Float[Tensor, " k"]
    derivatives: Float[Tensor, "d k"]  # by X, Y, XX, XY, YY
    tables: tuple[Float[Tensor, "side side"], ...] = ()


def nearest_of(jets: Sequence[RadiusJet]) -> RadiusJet:
    """The nearest of some faces that bound one medium; itself where there is one. Of several, ``tables`` are kept."""
    if len(jets) == 1:
        return jets[0]
    rho = torch.stack([jet.rho for jet in jets])
    first = rho.argmin(dim=0, keepdim=True)
    derivatives = torch.stack([jet.derivatives for jet in jets])
    derivatives_there = (
        derivatives.gather(0, first.expand(len(derivatives[0]), -1)[None])[0] if derivatives.numel() else derivatives[0]
    )
    return RadiusJet(rho.gather(0, first)[0], derivatives_there, tuple(table for jet in jets for table in jet.tables))


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

    def jets(self, tables: Float[Tensor, "f side side"]) -> list[RadiusJet]:
        """Radius and derivatives of each table; differentiable by its coefficients."""
        columns = tables.reshape(len(tables), -1).T
        values = (self.operator @ columns).T.reshape(len(tables), -1, len(self.points.x))
        return [RadiusJet(value[0], value[1:], (table,)) for value, table in zip(values, tables, strict=True)]


def constraint_points(grid: TableGrid, symmetry: str, *, every_node: int | None = None) -> Float[np.ndarray, "k 2"]:
    """Chart points of the nodes and cell centres within the hemisphere, and of the rim at the nodes' spacing.

    With ``every_node`` fewer: each first, second, ... node of a row, and no centres. Of mirror images under the group
    ``symmetry`` only one is kept.
    """
    nodes = surface.grid(grid.nodes)
    middles = nodes[:-1, :-1] + 0.5 * grid.step
    if every_node is None:
        both = np.concatenate([nodes.reshape(-1, 2), middles.reshape(-1, 2)])
    else:
        both = nodes[::every_node, ::every_node].reshape(-1, 2)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 8 * int(np.ceil(0.25 * np.pi / grid.step)), endpoint=False)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    points = np.concatenate([both[np.sum(both**2, axis=1) < 1.0], rim])
    return points[first_images(points, symmetry)]


def meridian_points(grid: TableGrid, detail_rad: float | None, symmetry: str) -> Float[np.ndarray, "k 2"]:
    """Chart points of meridians from the axis to the rim, close together: of a lens whose creases are its extremes.

    ``detail_rad``: of the narrowest function, which meridians are to resolve at the rim; None for faces of revolution,
    of which one is enough. Of mirror images under the group ``symmetry`` only one is kept.
    """
    along = np.linspace(0.0, 1.0, PER_NODE * int(np.ceil(1.0 / grid.step)) + 1)
    if detail_rad is None:
        return np.stack([along, np.zeros_like(along)], axis=1)
    count = max(_FEWEST_MERIDIANS, 8 * int(np.ceil(0.5 * np.pi / detail_rad)))
    azimuth = 2.0 * np.pi * np.arange(count) / count
    across = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), (along[1:, None, None] * across).reshape(-1, 2)])
    return points[first_images(points, symmetry)]


def section_points(grid: TableGrid, symmetry: str) -> Float[np.ndarray, "k 2"]:
    """Chart points of the section y = 0, close together: of faces that are drawn along y, and look the same all along.

    Of mirror images under the group ``symmetry`` only one is kept.
    """
    along = np.linspace(-1.0, 1.0, 2 * _PER_STEP * int(np.ceil(1.0 / grid.step)) + 1)
    points = np.stack([along, np.zeros_like(along)], axis=1)
    return points[first_images(points, symmetry)]


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


_FEWEST_MERIDIANS = 48
_PER_STEP = 2  # points of a section
PER_NODE = 8  # points of a meridian: a rim of 8 mm is then met to some micrometres
# Directions at which the outline is looked for around the points of a search, and their distance on the chart: a bond
# wire with its margin is 0.2 mm across, 0.1 rad at 2 mm.
_DIRECTIONS = 60_000
_SPACING = 0.01
_GROUP = 32  # neighbouring triangles that a ray passes by in one test: a ball of 10,000 takes 0.9 s of one core


@dataclass(frozen=True)
class KeepOutExtent:
    """Extent (mm) of a keep-out, grown by ``growth_mm``, for a lens of mirror group ``symmetry``.

    A symmetric lens stays clear of all mirror images. Solids that lie beyond ``largest_mm``, the largest radius of the
    lens, stand beside it and do not concern the cavity.
    """

    keep_out: "KeepOut"
    growth_mm: float
    largest_mm: float
    symmetry: str

    @staticmethod
    def of(spec: Spec) -> "KeepOutExtent":
        """The keep-out of ``spec``; symmetry "auto" counts as none. Raises :class:`InputError`."""
        from lensforge.cad.keep_out import FACET_MM, read_keep_out  # half a second, which few searches need

        limits = spec.constraints
        assert limits.keep_out is not None
        symmetry = "none" if spec.lens.symmetry == "auto" else spec.lens.symmetry
        growth_mm = limits.keep_out_margin_mm + FACET_MM  # a mesh lies within its curved faces
        return KeepOutExtent(read_keep_out(limits.keep_out), growth_mm, limits.max_radius_mm, symmetry)

    def at(self, points: ChartPoints) -> Float[Tensor, " k"]:
        """Extent at ``points``, computed once for them; the largest within their spacing, 0 where nothing is."""
        return _extent_at(self, points)

    def along(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Extent along unit ``directions``; 0 where there is nothing."""
        corners, balls, groups = _in_groups(self._corners_inside(), self.growth_mm)
        reach = np.zeros(len(directions))
        for image in group(self.symmetry):
            turned = np.ascontiguousarray(directions @ image)
            extents = np.zeros(len(directions))

            def work(_: int, rows: slice, turned: np.ndarray = turned, extents: np.ndarray = extents) -> None:
                grown_extents(turned[rows], corners, balls, groups, _GROUP, self.growth_mm, extents[rows])

            in_chunks(work, len(directions))
            reach = np.maximum(reach, extents)
        return reach

    def _corners_inside(self) -> Float[np.ndarray, "t 3 3"]:
        """Triangles of the solids that are not beside the lens, those that reach above z = 0 when grown."""
        kept = [np.zeros((0, 3, 3))]
        for solid in self.keep_out.solids:
            corners = solid.corners
            corners = corners[corners[:, :, 2].max(axis=1) > -self.growth_mm]
            if len(corners) and _nearest_mm(corners) < self.largest_mm + self.growth_mm:
                kept.append(corners)
        return np.concatenate(kept)


def _in_groups(
    corners: Float[np.ndarray, "t 3 3"], growth_mm: float
) -> tuple[Float[np.ndarray, "k 3 3"], Float[np.ndarray, "k 4"], Float[np.ndarray, "g 4"]]:
    """The triangles in the order of their groups, a ball around each when grown, and a ball around each group.

    The last triangle fills its group up. The groups that reach furthest come first: most others end before the extent
    that these have found.
    """
    order = cKDTree(corners.mean(axis=1), leafsize=_GROUP).indices if len(corners) else np.zeros(0, dtype=int)
    order = np.pad(order, (0, -len(order) % _GROUP), mode="edge") if len(order) else order
    blocks = corners[order].reshape(-1, _GROUP, 3, 3)
    centres = blocks.mean(axis=2)
    reaches = np.linalg.norm(blocks - centres[:, :, None], axis=3).max(axis=2) + growth_mm
    middle = centres.mean(axis=1)
    radius = (np.linalg.norm(centres - middle[:, None], axis=2) + reaches).max(axis=1)
    first = np.argsort(-(np.linalg.norm(middle, axis=1) + radius), kind="stable")
    balls = np.concatenate([centres, reaches[:, :, None]], axis=2)[first].reshape(-1, 4)
    groups = np.column_stack([middle, radius])[first]
    return np.ascontiguousarray(blocks[first].reshape(-1, 3, 3)), np.ascontiguousarray(balls), groups


def _nearest_mm(corners: Float[np.ndarray, "t 3 3"]) -> float:
    import trimesh

    return float(np.linalg.norm(trimesh.triangles.closest_point(corners, np.zeros((len(corners), 3))), axis=1).min())


@lru_cache(maxsize=8)
def _extent_at(extent: KeepOutExtent, points: ChartPoints) -> Float[Tensor, " k"]:
    places = np.stack([points.x.numpy(), points.y.numpy()], axis=1)
    along_places = extent.along(surface.to_sphere(places))
    if points.spacing > 0.0:
        around, values = _outline(extent)
        near = cKDTree(around).query_ball_point(places, points.spacing + _SPACING)
        along_places = np.array(
            [max(least, values[k].max(initial=0.0)) for least, k in zip(along_places, near, strict=True)]
        )
    return torch.from_numpy(along_places)


@lru_cache(maxsize=2)
def _outline(extent: KeepOutExtent) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, " m"]]:
    """Chart places and extents (mm) of the directions in which there is something, all over the hemisphere."""
    directions = fibonacci_hemisphere(_DIRECTIONS)
    extents = extent.along(directions)
    return surface.to_chart(directions[extents > 0.0]), extents[extents > 0.0]
