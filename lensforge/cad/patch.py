"""One optical surface as one NURBS patch over the stereographic chart, without pole or seam; its curvatures.

The points ``rho(u) u`` on a square grid of the chart are interpolated by a tensor-product B-spline of degree 7, in two
passes of ``scipy.interpolate.make_interp_spline``. The spline's parameters *are* the chart's (X, Y), so the rim of the
lens is the unit circle of the parameter plane.

For normals within 0.2 mrad faces of the quickstart take 88 nodes across, of degree 5 112. Least squares take 4 % fewer
than interpolation, other spacings of the knots more.

The grid is uniform in the angle ``2 atan X``, not in X, whose angular step ``2/(1 + X^2)`` is widest at the apex: for
the same step there, that takes a fifth fewer nodes. An interpolating spline is worst at its ends, so the grid extends
by an apron beyond the chart's square, and the spline is then cut back to the square exactly. Together they make the
form error 4 times smaller than with as many nodes uniform in X that end at the square.

A face about a hole is a ring, and may be a cup that reaches far along the axis: its radius then grows with the inverse
square of the angle from the axis, and the nodes grow denser towards the hole. A cup of 102 mm with a mouth of 61 mm
takes 190 nodes for 50 nm; with 320 nodes at even angles it is 280 nm off.

The surface continues below z = 0: an SRBF sum decays smoothly to the offset h, and the corners of the chart
(110 degrees from the axis) lie beyond the trimmed face.

Curvatures are signed for the cutter: convex is positive, concave (a hollow that a ball must enter) negative. With the
air-side normal ``n`` the curvature along a unit tangent ``t`` is ``-x_tt . n``: a ball of glass has ``+1/r``, a
spherical cavity ``-1/r``, whichever face of the lens it is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, make_interp_spline

from lensforge.cad.face_tolerance import MAX_NODES
from lensforge.errors import InputError
from lensforge.surfaces.surface import HALF_WIDTH, Surface, to_chart, to_sphere


def _outward(along_x: Float[np.ndarray, "*n 3"], along_y: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    across = np.cross(along_x, along_y)
    return across / np.linalg.norm(across, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Jet:
    """Position (mm) over the chart and its first and second derivatives by the chart coordinates X and Y."""

    point: Float[np.ndarray, "n 3"]
    x: Float[np.ndarray, "n 3"]
    y: Float[np.ndarray, "n 3"]
    xx: Float[np.ndarray, "n 3"]
    xy: Float[np.ndarray, "n 3"]
    yy: Float[np.ndarray, "n 3"]

    @property
    def area_element(self) -> Float[np.ndarray, " n"]:
        """Area (mm^2) of the face for each unit of chart area."""
        return np.linalg.norm(np.cross(self.x, self.y), axis=1)

    @property
    def normal(self) -> Float[np.ndarray, "n 3"]:
        """Unit normals pointing away from the origin."""
        return _outward(self.x, self.y)


@dataclass(frozen=True)
class PrincipalCurvatures:
    """Signed principal curvatures (1/mm), ``minimum <= maximum``; concave is negative."""

    minimum: Float[np.ndarray, " n"]
    maximum: Float[np.ndarray, " n"]


def principal_curvatures(jet: Jet, normal: Float[np.ndarray, "n 3"]) -> PrincipalCurvatures:
    """Curvatures of a jet with air-side ``normal``: the second fundamental form in an orthonormal tangent frame.

    The frame (Gram-Schmidt on the chart's tangents) makes the shape operator symmetric, so its eigenvalues come from
    a hypot and stay exact at umbilics, where ``H^2 - K`` would lose half of the digits.
    """
    length_x = np.linalg.norm(jet.x, axis=1)
    skew = np.sum(jet.x * jet.y, axis=1) / length_x
    height = jet.area_element / length_x
    form_xx, form_xy, form_yy = (-np.sum(second * normal, axis=1) for second in (jet.xx, jet.xy, jet.yy))
    along = form_xx / length_x**2
    cross = (form_xy / length_x - along * skew) / height
    across = (form_yy - 2.0 * cross * height * skew - along * skew**2) / height**2
    mean = (along + across) / 2.0
    deviator = np.hypot((along - across) / 2.0, cross)
    return PrincipalCurvatures(mean - deviator, mean + deviator)


DEGREE = 7
LEAST_NODES = 72  # resolve what fills the hole of a ring, too
# Measured on the 14 mm dome of the quickstart: 3 nodes per sigma at the apex leave 0.3 nm and 3 urad, 2 leave 30 nm and
# 0.2 mrad.
NODES_PER_SIGMA = 3.0
FIRST_PER_SIGMA = 1.7
_APRON = 8  # nodes beyond each edge: the ends' error decays by 0.43 a node
_ANGLE_SPAN = 4.0 * np.arctan(HALF_WIDTH)  # rad, from edge to edge of the chart's square along an axis
_JET_ORDERS = np.array([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
# Of the angle from the axis to the edge of a hole: nodes are even within, and in proportion to the angle beyond. Of a
# least angle, so that the apron ends before the pole of the chart.
_DENSE = 1.5
_LEAST_DENSE_RAD = 0.1
_FILLED = 0.8  # share of the hole in a ring that is filled
_SMOOTH = 6.0  # how smoothly
_AROUND = 64
_WHOLE = (0.0, 1.0)
Extent = tuple[float, float]
_Angles = float | Float[np.ndarray, " n"]  # rad
_MAX_REACH_DEG = 110.0  # along an axis; the corners are then at 127 degrees


@dataclass(frozen=True)
class Patch:
    """A non-rational tensor-product B-spline, the same clamped ``knots`` in X and Y, ``control`` points in mm."""

    control: Float[np.ndarray, "n n 3"]
    knots: Float[np.ndarray, " k"]

    def rounded(self, step_mm: float) -> "Patch":
        """The patch with its control points on a decimal grid no wider than ``step_mm``: fewer digits in a file."""
        return Patch(np.round(self.control, int(np.ceil(-np.log10(step_mm)))), self.knots)

    @property
    def nodes(self) -> int:
        """Interpolation nodes in each direction."""
        return len(self.control) - DEGREE + 1

    def points(self, chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Points (mm) at chart coordinates inside the square of half width ``HALF_WIDTH``."""
        return self._derivatives(chart, slice(1))[0]

    def tangents(self, chart: Float[np.ndarray, "*n 2"]) -> tuple[Float[np.ndarray, "*n 3"], ...]:
        """Points (mm) and their first derivatives by X and by Y."""
        return tuple(self._derivatives(chart, slice(3)))

    def normals(self, chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Unit normals pointing away from the origin."""
        return _outward(*self._derivatives(chart, slice(1, 3)))

    def points_and_normals(
        self, chart: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points (mm), and unit normals pointing away from the origin."""
        point, *along = self.tangents(chart)
        return point, _outward(*along)

    def jet(self, chart: Float[np.ndarray, "n 2"]) -> Jet:
        """Points and the first and second derivatives of the spline."""
        return Jet(*self._derivatives(chart, slice(6)))

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the origin in unit ``directions``, down to a little below z = 0.

        The spline's point lies off the direction of its parameters by no more than the form error: the ray is met with
        the tangent plane there, where a steep face would be off by as much.
        """
        points, normals = self.points_and_normals(to_chart(directions))
        return (points * normals).sum(axis=-1) / (directions * normals).sum(axis=-1)

    def bounded(self, reach: float = 1.0) -> "Patch":
        """The patch over the disc of radius ``reach`` in the chart; at the corners of its square no deeper than there.

        CAD programs take the bounding box of a face from all control points. Those that do not affect the disc are
        raised to the lowest one that does.
        """
        first = self.knots[: -DEGREE - 1]
        last = self.knots[DEGREE + 1 :]
        nearest = np.clip(0.0, first, last)  # of each function's support to the axis
        bound = np.add.outer(nearest**2, nearest**2) < reach**2
        control = self.control.copy()
        control[~bound, 2] = np.maximum(control[~bound, 2], control[bound, 2].min())
        return Patch(control, self.knots)

    def _derivatives(self, chart: Float[np.ndarray, "*n 2"], chosen: slice) -> Float[np.ndarray, "k *n 3"]:
        from lensforge.kernels.spline_patch import spline_points

        orders = _JET_ORDERS[chosen]
        places = np.ascontiguousarray(chart, dtype=np.float64).reshape(-1, 2)
        basis = np.empty((2, 1 + orders.max(), DEGREE + 1))
        derivatives = np.empty((len(orders), len(places), 3))
        spline_points(self.knots, np.ascontiguousarray(self.control), DEGREE, orders, places, basis, derivatives)
        return derivatives.reshape(len(orders), *chart.shape[:-1], 3)


def default_nodes(detail_rad: float, least: int = LEAST_NODES, per_sigma: float = NODES_PER_SIGMA) -> int:
    """Nodes that resolve the narrowest feature: ``per_sigma`` across it at the apex, at least ``least``."""
    return int(np.clip(np.ceil(1.0 + _ANGLE_SPAN * per_sigma / detail_rad), least, MAX_NODES))


def node_axis(count: int, apron: int = 0, half_width: float = HALF_WIDTH, hole: float = 0.0) -> Float[np.ndarray, " n"]:
    """Chart coordinates of ``count`` nodes from edge to edge of the square, and ``apron`` beyond.

    They are even in angle; around a ``hole``, given by the chart coordinate of its edge, denser towards it.
    """
    span = _spaced(np.arctan(half_width), hole)
    return np.asarray(np.tan(_angle(2.0 * span / (count - 1) * np.arange(-apron, count + apron) - span, hole)))


def even_angles(
    low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"], part: int, parts: int, hole: float = 0.0
) -> Float[np.ndarray, " n"]:
    """Angle (rad) from the axis at ``part`` of ``parts`` steps between two others, spaced as nodes are."""
    start, end = (_spaced(0.5 * edge, hole) for edge in (low, high))
    return np.asarray(2.0 * _angle(start + part * (end - start) / parts, hole))


def _spaced(angle: _Angles, hole: float) -> _Angles:
    """The coordinate in which nodes are even, from half an ``angle`` (rad) from the axis."""
    return angle if hole == 0.0 else np.arcsinh(angle / _dense_rad(hole))


def _angle(spaced: _Angles, hole: float) -> _Angles:
    return spaced if hole == 0.0 else _dense_rad(hole) * np.sinh(spaced)


def _dense_rad(hole: float) -> float:
    return max(_DENSE * float(np.arctan(hole)), _LEAST_DENSE_RAD)


def fit_patch(surface: Surface, nodes: int | None = None, extent: Extent = _WHOLE) -> Patch:
    """Interpolate ``surface`` at ``nodes`` x ``nodes`` chart points; by default as many as its detail needs.

    ``extent``: least and largest distance of its domain from the chart's centre; the square goes a little farther, and
    the hole within a ring is filled smoothly. Raises :class:`InputError` if ``nodes`` is out of range or the radius is
    not positive over the chart.
    """
    fewest = fewest_nodes(extent)
    count = max(fewest, default_nodes(surface.detail_rad)) if nodes is None else nodes
    if not fewest <= count <= MAX_NODES:
        raise InputError(f"nodes = {count}: from {fewest} to {MAX_NODES}; leave it out to have it set by the lens")
    half_width = HALF_WIDTH * extent[1]
    return _interpolate(surface, node_axis(count, _APRON, half_width, extent[0]), half_width, extent[0])


def fit_extended(surface: Surface, nodes: int, extension_deg: float, extent: Extent = _WHOLE) -> Patch:
    """Interpolate ``surface`` over a larger square, ``extension_deg`` (degrees) beyond the edges of its domain.

    ``nodes`` is the count of ``fit_patch`` with this ``extent``; it grows in proportion to the angle.
    """
    if not 0.0 < extension_deg <= _MAX_REACH_DEG - 90.0:
        raise InputError(f"extension = {extension_deg:g} degrees: above 0, up to {_MAX_REACH_DEG - 90.0:g}")
    edges_deg = 2.0 * np.rad2deg(np.arctan(extent)) + (-extension_deg, extension_deg)
    hole, half_width = np.tan(np.deg2rad(np.maximum(edges_deg, 0.0)) / 2.0).tolist()
    wider = _spaced(np.arctan(half_width), extent[0]) / _spaced(np.arctan(HALF_WIDTH * extent[1]), extent[0])
    count = int(np.ceil(1.0 + (nodes - 1) * wider))
    fewest = _fewest_across(half_width, extent[0])
    if count < fewest:
        raise InputError(f"nodes = {nodes}: {count} with the extension, at least {fewest}; leave it out, or raise it")
    return _interpolate(surface, node_axis(count, _APRON, half_width, extent[0]), half_width, hole)


def fewest_nodes(extent: Extent = _WHOLE) -> int:
    """Least number of nodes of a patch over ``extent``."""
    return _fewest_across(HALF_WIDTH * extent[1], extent[0])


def _fewest_across(half_width: float, hole: float) -> int:
    """Least number of nodes across a square whose apron ends before the pole of the chart."""
    room = _spaced(0.5 * np.pi, hole) / _spaced(np.arctan(half_width), hole) - 1.0
    return max(2 * DEGREE, 2 + int(2 * _APRON / room))


def _interpolate(surface: Surface, axis: Float[np.ndarray, " n"], half_width: float, hole: float) -> Patch:
    chart = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    directions = to_sphere(chart)
    radius = _filled(surface, chart, hole) if hole > 0.0 else surface.radius_on_grid(directions)
    _require_positive(radius.reshape(-1), directions.reshape(-1, 3))
    points = radius[..., None] * directions
    along_x = _within_square(make_interp_spline(axis, points, k=DEGREE), half_width)
    along_y = _within_square(make_interp_spline(axis, along_x.c.transpose(1, 0, 2), k=DEGREE), half_width)
    return Patch(np.ascontiguousarray(along_y.c.transpose(1, 0, 2)), along_x.t)


def _filled(surface: Surface, chart: Float[np.ndarray, "n n 2"], hole: float) -> Float[np.ndarray, "n n"]:
    """Radii over a ``chart`` grid; within 0.8 of a ``hole`` blended into the mean of those half as far as its edge.

    There a surface may have no radius, as a cylinder on the axis, or a spike that spoils boxes and integrals. The step
    has 5 derivatives that are 0 at both ends; where radii are taken follows its integral.
    """
    from scipy.special import betainc

    distance = np.maximum(np.linalg.norm(chart, axis=-1), np.finfo(float).tiny)
    share = np.minimum(distance / (_FILLED * hole), 1.0)
    step = betainc(_SMOOTH, _SMOOTH, share)
    taken = 0.5 + share * step - 0.5 * betainc(_SMOOTH + 1.0, _SMOOTH, share)
    radius = surface.radius_on_grid(to_sphere(chart * np.where(share < 1.0, taken / share, 1.0)[..., None]))
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    around = 0.5 * _FILLED * hole * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    mean = surface.radius(to_sphere(around)).mean()
    return np.where(share < 1.0, mean + step * (radius - mean), radius)


def _within_square(wide: BSpline, half_width: float) -> BSpline:
    """The piecewise polynomial on the square only, its end knots clamped; interpolation reproduces it exactly."""
    ends = np.full(DEGREE + 1, half_width)
    interior = wide.t[np.abs(wide.t) < half_width * (1.0 - 1e-12)]
    knots = np.concatenate([-ends, interior, ends])
    averages = np.convolve(knots[1:-1], np.ones(DEGREE), "valid") / DEGREE  # Greville's abscissae, unique for any knots
    averages = np.clip(averages, -half_width, half_width)  # equal knots average to themselves but for rounding
    return make_interp_spline(averages, wide(averages), k=DEGREE, t=knots)


def _require_positive(radius: Float[np.ndarray, " n"], directions: Float[np.ndarray, "n 3"]) -> None:
    worst = int(np.argmin(radius))
    if radius[worst] <= 0.0:
        polar = np.degrees(np.arccos(directions[worst, 2]))
        raise InputError(
            f"surface radius = {radius[worst]:.4g} mm at {polar:.1f} degrees from the axis: it must be above 0, "
            "even below the rim; design with a smaller learning rate or fewer levels"
        )
