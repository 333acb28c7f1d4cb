"""One optical surface as one NURBS patch over the stereographic chart: no pole, no seam.

The points ``rho(u) u`` on a square grid of the chart are interpolated by a tensor-product quintic
B-spline, in two passes of ``scipy.interpolate.make_interp_spline``. The spline's parameters *are* the
chart's (X, Y), so the rim of the lens is the unit circle of the parameter plane.

Below z = 0 the SRBF sum itself continues the surface: it decays smoothly to the offset h, and the
corners of the chart (110 degrees from the axis) lie beyond the trimmed face.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline

from lensforge.errors import InputError
from lensforge.surfaces.chart import HALF_WIDTH, grid, to_chart, to_sphere
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

DEGREE = 5
# The chart's map of a plain sphere has its own poles at R = +-i, which wide functions do not see: 72 nodes follow it.
MIN_NODES, MAX_NODES = 72, 240
# Measured: 4 nodes per sigma at the apex leave 0.5 nm and 2 urad on a 14 mm dome, 3 nodes 3 nm and 14 urad.
NODES_PER_SIGMA = 4.0


@dataclass(frozen=True)
class Patch:
    """A non-rational tensor-product B-spline, the same clamped ``knots`` in X and Y, ``control`` points in mm."""

    control: Float[np.ndarray, "n n 3"]
    knots: Float[np.ndarray, " k"]

    @property
    def nodes(self) -> int:
        """Interpolation nodes in each direction."""
        return len(self.control)

    def points(self, chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Points (mm) at chart coordinates inside the square of half width ``HALF_WIDTH``."""
        return self._spline(chart)

    def normals(self, chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Unit normals pointing away from the origin."""
        normal = np.cross(self._spline(chart, nu=(1, 0)), self._spline(chart, nu=(0, 1)))
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the origin in unit ``directions``, down to a little below z = 0.

        A point of the spline leaves the ray of its parameters by no more than the form error, so its distance is taken.
        """
        return np.linalg.norm(self.points(to_chart(directions)), axis=-1)

    @cached_property
    def _spline(self) -> NdBSpline:
        return NdBSpline((self.knots, self.knots), self.control, DEGREE)


def default_nodes(basis: SrbfBasis) -> int:
    """Nodes that resolve the narrowest function: the grid step at the apex is ``sigma / NODES_PER_SIGMA`` or less.

    One step of X is two steps of angle at the apex (``X = tan(theta/2)``), and less towards the rim.
    """
    apex_step = float(basis.sigmas.min()) / NODES_PER_SIGMA
    return int(np.clip(np.ceil(1.0 + 4.0 * HALF_WIDTH / apex_step), MIN_NODES, MAX_NODES))


def fit_patch(surface: SrbfSurface, nodes: int | None = None) -> Patch:
    """Interpolate ``surface`` at ``nodes`` x ``nodes`` chart points; by default as many as its basis needs.

    Raises :class:`InputError` if ``nodes`` is out of range or the radius is not positive over the chart.
    """
    count = default_nodes(surface.basis) if nodes is None else nodes
    if not 2 * DEGREE <= count <= MAX_NODES:
        raise InputError(f"nodes = {count}: from {2 * DEGREE} to {MAX_NODES}; leave it out to let the lens decide")
    directions = to_sphere(grid(count).reshape(-1, 2))
    radius = surface.radius(directions)
    _require_positive(radius, directions)
    points = (radius[:, None] * directions).reshape(count, count, 3)
    axis = np.linspace(-HALF_WIDTH, HALF_WIDTH, count)
    along_x: BSpline = make_interp_spline(axis, points, k=DEGREE, axis=0)
    along_y: BSpline = make_interp_spline(axis, along_x.c.transpose(1, 0, 2), k=DEGREE, axis=0)
    return Patch(np.ascontiguousarray(along_y.c.transpose(1, 0, 2)), along_x.t)


def _require_positive(radius: Float[np.ndarray, " n"], directions: Float[np.ndarray, "n 3"]) -> None:
    worst = int(np.argmin(radius))
    if radius[worst] <= 0.0:
        polar = np.degrees(np.arccos(directions[worst, 2]))
        raise InputError(
            f"surface radius = {radius[worst]:.4g} mm at {polar:.1f} degrees from the axis: it must be above 0 "
            "to 110 degrees; design with a smaller learning rate or fewer levels"
        )
