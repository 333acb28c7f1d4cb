"""A face as the shop cuts it, and the centres of a ball that touches it: points moved along its air-side normal.

``Q = P + R a``: P on the face, **a** its unit normal from the material into the air, R the radius of a probe or a tool.
The centres for given coordinates are found by Newton's method on a spline of the face with twice the nodes that its
detail asks for: its error is measured, some thousandths of a nanometre, and counts in that of every table.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from numbers import Real

import numpy as np
from jaxtyping import Float

from lensforge.cad.form_error import chart_samples, form_error
from lensforge.cad.patch import Patch, default_nodes, fit_extended
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check, FaceName
from lensforge.surfaces.surface import Surface, grid, scaled, to_chart

Points = Float[np.ndarray, "n 3"]
Plane = Float[np.ndarray, "n 2"]
Projection = Callable[[Points], Plane]

_MOST_STEPS, _CONVERGED = 40, 1e-12  # relative to the size of the face; the files round off 1e-9 mm
_FINER = 2  # times the nodes of the export: 6e-4 to 2e-3 nm for its 0.05 to 0.15 nm, in half a second
_LONGEST = 0.1  # chart units in one step
_STEP = 1e-6  # relative; of the central difference of a projection, which is smooth
_RUNOUT_DEG, _NODES, _HALF_WIDTH = 15.0, 121, 1.25  # of the spline; of the starts, to 12 degrees below the rim


@dataclass(frozen=True)
class OffsetFace:
    """Centres of a ball of ``offset_mm`` on ``surface``; ``air``: 1 where the air is outside of it, -1 where inside."""

    name: FaceName
    surface: Surface
    air: int
    offset_mm: float

    def at(self, directions: Points) -> tuple[Points, Points]:
        """Centres (mm) and unit air-side normals over the points of contact in unit ``directions``."""
        centres, normals, _ = self._over(to_chart(directions))
        return centres, normals

    def found(self, wanted: Plane, project: Projection) -> tuple[Points, Points]:
        """Centres and normals where ``project`` of the centre is ``wanted``, to rounding.

        Raises :class:`InputError` where there is no such centre.
        """
        chart, scale = self._start(wanted, project), float(np.abs(project(self._samples[1])).max())
        for _ in range(_MOST_STEPS):
            centres, normals, slopes = self._over(chart)
            missing = wanted - project(centres)
            if np.abs(missing).max() <= _CONVERGED * scale:
                return centres, normals
            chart = chart + _newton(missing, centres, slopes, project)
        raise InputError(
            f"offset of the {self.name} face = {self.offset_mm:g} mm: the ball's centres are no smooth surface; "
            "give a smaller ball"
        )

    @cached_property
    def spline_error_nm(self) -> float:
        """Largest distance of the spline from the face, over its samples within the rim."""
        chart = chart_samples()
        return form_error(self.surface, self._patch.points(chart), self._patch.normals(chart)).form_max_nm

    def _over(self, chart: Plane) -> tuple[Points, Points, Float[np.ndarray, "n 3 2"]]:
        """Centres and unit air-side normals over points of the chart, and the derivatives of the centres by it."""
        jet = self._patch.jet(np.clip(chart, -_HALF_WIDTH, _HALF_WIDTH))
        across = np.cross(jet.x, jet.y)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        outward, columns = across / length, []
        for tangent, turn in (
            (jet.x, np.cross(jet.xx, jet.y) + np.cross(jet.x, jet.xy)),
            (jet.y, np.cross(jet.xy, jet.y) + np.cross(jet.x, jet.yy)),
        ):
            tilt = (turn - outward * np.sum(outward * turn, axis=1, keepdims=True)) / length
            columns.append(tangent + self.air * self.offset_mm * tilt)
        normals = self.air * outward
        return jet.point + self.offset_mm * normals, normals, np.stack(columns, axis=-1)

    def _start(self, wanted: Plane, project: Projection) -> Plane:
        from scipy.spatial import cKDTree

        chart, centres = self._samples
        _, nearest = cKDTree(project(centres)).query(wanted)
        start: Plane = chart[nearest]
        return start

    @cached_property
    def _samples(self) -> tuple[Plane, Points]:
        """Points of the chart, and the centres over them."""
        chart = grid(_NODES, _HALF_WIDTH).reshape(-1, 2)
        chart = chart[np.linalg.norm(chart, axis=1) <= _HALF_WIDTH]
        return chart, self._over(chart)[0]

    @cached_property
    def _patch(self) -> Patch:
        return fit_extended(self.surface, _FINER * default_nodes(self.surface.detail_rad), _RUNOUT_DEG)


def _newton(missing: Plane, centres: Points, slopes: Float[np.ndarray, "n 3 2"], project: Projection) -> Plane:
    """The step over the chart that adds ``missing`` to the projection, no longer than ``_LONGEST``."""
    columns = []
    for slope in np.moveaxis(slopes, -1, 0):
        columns.append((project(centres + _STEP * slope) - project(centres - _STEP * slope)) / (2.0 * _STEP))
    (a, b), (c, d) = (column.T for column in columns)
    x, y = missing.T
    with np.errstate(divide="ignore", invalid="ignore"):  # no slope at all: not a number, which never converges
        step = np.stack([d * x - c * y, a * y - b * x], axis=-1) / (a * d - b * c)[:, None]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    shortened: Plane = step * np.minimum(1.0, _LONGEST / np.maximum(length, _LONGEST))
    return shortened


def offset_faces(lens: Lens, check: Check, offsets_mm: dict[FaceName, float]) -> list[OffsetFace]:
    """Both faces as they are cut: scaled for a mould insert, whose air is on the side of the lens's material.

    Raises :class:`InputError` for an offset below 0, and for a ball that does not fit the face by ``check``.
    """
    scale, side = lens.spec.manufacture.scale, 1 if lens.spec.manufacture.make == "part" else -1
    found = []
    for name, surface, air in (("inner", lens.inner, -side), ("outer", lens.outer, side)):
        face: FaceName = "inner" if name == "inner" else "outer"
        _require_fit(face, offsets_mm[face], getattr(check, face).cutter.largest_radius_mm)
        found.append(OffsetFace(face, scaled(surface, scale), air, offsets_mm[face]))
    return found


def _require_fit(name: FaceName, offset_mm: float, largest_mm: float | None) -> None:
    if isinstance(offset_mm, bool) or not isinstance(offset_mm, Real) or not 0.0 <= offset_mm < np.inf:
        raise InputError(f"offset of the {name} face = {offset_mm!r}: 0, or the radius of a ball in mm on the air side")
    if largest_mm is not None and offset_mm > largest_mm:
        raise InputError(
            f"offset of the {name} face = {offset_mm:g} mm: the ball does not fit everywhere, and the surface of its "
            f"centres would cross itself; the largest that touches all of the face has {largest_mm:.4g} mm"
        )
