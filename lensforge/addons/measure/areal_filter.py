"""Areal spline filter: the part of a measured deviation whose waves are longer than a stated wavelength.

The filtered deviation s minimises

    sum_i a_i (d_i - s_i)^2 c_i^2  +  (wavelength / 2 pi)^4 * integral |second derivatives of s|^2 dA

over the points, each of which stands for the area a_i of the face, so that the density of the points does not matter; c
is the cosine between the ray from the origin and the normal, along which points have their noise. A wave of the stated
wavelength passes by one half, one of n times that wavelength by 1/(1 + n^-4): the transmission of the spline
filters of profiles (M. Krystek, Measurement 18, 9 (1996)). The edge of the face needs no special treatment.

Lengths are along a sphere of the local radius: on a face inclined to it by t, waves along the slope are longer by
1/cos t. Where nothing is measured, a weak term in s^2 lets the deviation fade to 0 within about a wavelength.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from lensforge.cad.boundary import WHOLE, Domain
from lensforge.surfaces.chart_spline import DEGREE, ChartSpline
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import HALF_WIDTH, Surface, gradient_on_sphere, to_chart, to_sphere


class RadialChange(ChartSpline):
    """Change of a radius (mm) over the chart: a spline as of a face; beyond its square, the edge's value.

    ``detail``: sigma of a surface whose spline nodes are an eighth of the shortest wavelength apart.
    """

    def times(self, factor: float) -> "RadialChange":
        """The change times ``factor``."""
        return RadialChange(self.knots, factor * self.control, self.detail)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """The change (mm) in unit ``directions``."""
        return np.asarray(self._spline(self._inside(to_chart(directions))))

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient on the unit sphere (mm/rad)."""
        chart = self._inside(to_chart(directions))
        slopes = np.stack([self._spline(chart, nu=order) for order in ((1, 0), (0, 1))], axis=1)
        return gradient_on_sphere(chart, slopes)

    def _inside(self, chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return np.asarray(np.clip(chart, self.knots[0], self.knots[-1]))


@dataclass(frozen=True)
class ChangedSurface(Surface):
    """A surface whose radius has a change added."""

    original: Surface
    change: RadialChange

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature of either."""
        return min(self.original.detail_rad, self.change.detail_rad)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm) in unit ``directions``."""
        return np.asarray(self.original.radius(directions) + self.change.radius(directions))

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        return np.asarray(self.original.gradient(directions) + self.change.gradient(directions))

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis."""
        change = self.change.radius_on_grid(directions)
        return np.asarray(self.original.radius_on_grid(directions) + change)


# Of the cubic spline. Measured, 3 against 6: at the wavelength 0.487 pass against 0.503, at 1.4 of it 0.779 against
# 0.781; of shorter waves, which it cannot follow, less passes.
NODES_PER_WAVE = 3.0
MOST_NODES = 160  # across the chart: 27,000 unknowns, some seconds
_DEGREE = 3
_WIDEST = float(np.tan(np.deg2rad(112.0) / 2.0))  # the chart's square as far as exported faces are interpolated
_POINTS_PER_CELL = 16  # in which points share an area: their number has an error of a quarter
_FADE = 1e-3  # weight of s^2: takes a thousandth of what is measured
_GAUSS = 0.5 / np.sqrt(3.0)  # two-point Gauss quadrature in each interval
_STEEPEST = 5.0 / 8.0  # wavelengths in ``detail_rad``, of which splines take five nodes
_CHUNK = 65536
_PROBES = 8  # random signs: the degrees of freedom have an error of about a hundredth
_SEED = 0


@dataclass(frozen=True)
class PointDeviations:
    """Radial deviations (mm) from ``surface`` at unit ``directions``; ``domain``: where the face lies.

    ``weights``: of points that do not count alike, as of parts of which one has more of them.
    """

    surface: Surface
    directions: Float[np.ndarray, "n 3"]
    deviations: Float[np.ndarray, " n"]
    domain: Domain = WHOLE
    weights: Float[np.ndarray, " n"] | None = None

    @cached_property
    def largest_radius_mm(self) -> float:
        """Largest radius (mm) of the face, which turns angles into lengths."""
        return float(self.surface.radius(self.domain.held(fibonacci_hemisphere(2000))).max())

    @cached_property
    def cosines(self) -> Float[np.ndarray, " n"]:
        """Cosine between direction and normal: the share of a radial deviation along the normal."""
        return np.asarray(np.sum(self.surface.normal(self.directions) * self.directions, axis=1))

    @cached_property
    def areas(self) -> Float[np.ndarray, " n"]:
        """Area (mm²) per point: each cell of a regular pattern is shared by the points in it, by their weights."""
        cells = fibonacci_hemisphere(max(1, len(self.directions) // _POINTS_PER_CELL))
        _, cell = cKDTree(cells).query(self.directions)
        weights = np.ones(len(cell)) if self.weights is None else self.weights
        whole = np.bincount(cell, weights, minlength=len(cells))
        area = 2.0 * np.pi / len(cells) * self.surface.radius(cells) ** 2
        return np.asarray(area[cell] * weights / whole[cell] / self.cosines)

    def mean_square(self, values: Float[np.ndarray, "n *k"]) -> float:
        """Mean square along the normal, over the area, of radial ``values`` (mm)."""
        along = (self.cosines * values.T) ** 2
        return float(np.mean(along @ self.areas) / np.sum(self.areas))


def shortest_by_nodes_mm(radius_mm: float) -> float:
    """Shortest wavelength (mm) on a face of this largest radius that the number of nodes permits."""
    return NODES_PER_WAVE * radius_mm * 4.0 * float(np.arctan(_WIDEST)) / MOST_NODES


class ArealFilter:
    """The filter of one wavelength (mm) on the points of one face."""

    def __init__(self, points: PointDeviations, wavelength_mm: float) -> None:
        self.points = points
        self.wavelength_mm = wavelength_mm
        self._weights = points.areas * points.cosines**2
        detail = wavelength_mm / points.largest_radius_mm
        # A wavelength and a half beyond the square that is exported: what lies further out has no effect on it.
        half = min(np.tan(np.arctan(HALF_WIDTH) + 0.75 * detail), _WIDEST)
        count = int(np.clip(np.ceil(4.0 * np.arctan(half) / detail * NODES_PER_WAVE), 8, MOST_NODES))
        self._breaks = np.tan(np.linspace(-1.0, 1.0, count + 1) * np.arctan(half))
        self._knots = np.concatenate([[-half] * _DEGREE, self._breaks, [half] * _DEGREE])
        self._values = [self._rows(to_chart(points.directions[rows])) for rows in self._parts()]
        self._fitted = sum((part.T @ part).tocsc() for part in self._weighted(self._values))

    def _parts(self) -> Iterator[slice]:
        for start in range(0, len(self.points.directions), _CHUNK):
            yield slice(start, start + _CHUNK)

    def _weighted(self, values: list[Any]) -> Iterator[Any]:
        for rows, part in zip(self._parts(), values, strict=True):
            yield sparse.diags_array(np.sqrt(self._weights[rows])) @ part

    def _rows(self, chart: Float[np.ndarray, "n 2"]) -> Any:
        """Values of all basis functions at chart points, a sparse row for each."""
        inside = np.clip(chart, self._knots[0], self._knots[-1])
        rows = NdBSpline.design_matrix(inside, (self._knots, self._knots), _DEGREE)
        rows.resize((len(chart), (len(self._knots) - _DEGREE - 1) ** 2))  # scipy leaves out those after the last used
        return rows

    @cached_property
    def _quadrature(self) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
        """Points and weights along an axis of the chart."""
        steps = np.diff(self._breaks)
        centres = 0.5 * (self._breaks[1:] + self._breaks[:-1])
        points = np.stack([centres - _GAUSS * steps, centres + _GAUSS * steps], axis=1).ravel()
        return points, np.repeat(0.5 * steps, 2)

    @cached_property
    def places(self) -> Float[np.ndarray, "p 2"]:
        """Chart points at which the penalty is integrated."""
        axis, _ = self._quadrature
        return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def _scale(self) -> Float[np.ndarray, " p"]:
        """Length (mm) of a unit of the chart at the places."""
        directions = to_sphere(self.places)
        return self.points.surface.radius(directions) * (1.0 + directions[:, 2])

    @cached_property
    def place_areas(self) -> Float[np.ndarray, " p"]:
        """Area (mm^2) that each place stands for."""
        _, weights = self._quadrature
        return np.asarray(np.outer(weights, weights).ravel() * self._scale**2)

    @cached_property
    def _bending(self) -> tuple[list[Any], Any]:
        """Second derivatives along the surface, and values, at the places, both times the root of the area."""
        axis, _ = self._quadrature
        side = len(self._knots) - _DEGREE - 1
        whole = BSpline(self._knots, np.eye(side), _DEGREE)
        orders = [sparse.csr_array(whole(axis, nu=order)) for order in range(3)]
        scale = self._scale
        area = self.place_areas
        along = [
            sparse.diags_array(factor * np.sqrt(area) / scale**2) @ sparse.kron(orders[i], orders[j], format="csr")
            for i, j, factor in ((2, 0, 1.0), (1, 1, np.sqrt(2.0)), (0, 2, 1.0))
        ]
        value = sparse.diags_array(np.sqrt(area)) @ sparse.kron(orders[0], orders[0], format="csr")
        return along, value

    def solve(self, stiffness: Float[np.ndarray, " p"] | None = None) -> "FilteredPoints":
        """Filter the deviations; ``stiffness``: factors of the penalty at the places, 16 doubles the wavelength."""
        along, value = self._bending
        root = np.full(len(self.places), (self.wavelength_mm / (2.0 * np.pi)) ** 2)
        stiff = sparse.diags_array(root if stiffness is None else root * np.sqrt(stiffness))
        penalty = sum((stiff @ matrix).T @ (stiff @ matrix) for matrix in along)
        matrix = (self._fitted + penalty + _FADE * (value.T @ value)).tocsc()
        solver = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return FilteredPoints(self, solver, solver.solve(self.loads(self.points.deviations)))

    def loads(self, values: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "m *k"]:
        """Right sides of the filter's equations for ``values`` at the points."""
        weighted = (self._weights * values.T).T
        pairs = zip(self._parts(), self._values, strict=True)
        return np.asarray(np.sum([part.T @ weighted[rows] for rows, part in pairs], axis=0))

    def at_points(self, control: Float[np.ndarray, "m *k"]) -> Float[np.ndarray, "n *k"]:
        """Values at the points of the splines with these coefficients."""
        return np.concatenate([part @ control for part in self._values])

    def change(self, control: Float[np.ndarray, " m"]) -> RadialChange:
        """The spline of these coefficients, as a quintic one through its values at the knots."""
        side = len(self._knots) - _DEGREE - 1
        table = BSpline.design_matrix(self._breaks, self._knots, _DEGREE)
        values = table @ control.reshape(side, side) @ table.T
        detail = _STEEPEST * self.wavelength_mm / self.points.largest_radius_mm
        along_x = make_interp_spline(self._breaks, np.asarray(values), k=DEGREE)
        along_y = make_interp_spline(self._breaks, along_x.c.T, k=DEGREE)
        return RadialChange(along_x.t, np.ascontiguousarray(along_y.c.T), detail)


@runtime_checkable
class Factorised(Protocol):
    """Factors of a sparse matrix, which solve its equations."""

    def solve(self, rhs: Float[np.ndarray, "m *k"], /) -> Float[np.ndarray, "m *k"]:
        """Solution of the equations for one right-hand side, or for several columns."""


@dataclass(frozen=True)
class FilteredPoints:
    """A filtered deviation: the filter, its solved equations, and the coefficients of its spline."""

    areal: ArealFilter
    solver: Factorised
    control: Float[np.ndarray, " m"]

    @cached_property
    def values(self) -> Float[np.ndarray, " n"]:
        """The filtered deviation (mm) at the points."""
        return self.areal.at_points(self.control)

    @cached_property
    def change(self) -> RadialChange:
        """The filtered deviation over the whole face."""
        return self.areal.change(self.control)

    def refilter(self, values: Float[np.ndarray, " n"]) -> RadialChange:
        """Filter other ``values`` (mm) at the same points."""
        return self.areal.change(self.solver.solve(self.areal.loads(values)))

    def residual_noise(self) -> tuple[float, float]:
        """Shares left in the residual: of the degrees of freedom, and of the noise variance.

        1 - tr A / n, and the mean square along the normal of (I - A) z for random signs z along it (Hutchinson 1990).
        """
        points = self.areal.points
        signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], (_PROBES, len(self.values)))
        noise = (signs / points.cosines).T
        left = noise - self.areal.at_points(self.solver.solve(self.areal.loads(noise)))
        return float(np.mean(signs * points.cosines * left.T)), points.mean_square(left)
