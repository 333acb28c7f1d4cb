"""Dense tables of points for turning and milling: a raster and rings on each face, each with its interpolation error.

The spacing is given, or found: error and spacing follow a power law, so that a few trials reach the error asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import get_args

import numpy as np

from lensforge.drawings.interpolation import ORDER, Interpolation
from lensforge.drawings.offset_face import OffsetFace, offset_faces
from lensforge.drawings.polar import Polar, make_polar, polar_end_deg
from lensforge.drawings.raster import Raster, make_raster, raster_extent
from lensforge.errors import InputError
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check, FaceName

MOST_POINTS = 400_000  # of one table: 16 MB of text
_TRIED, _MEASURED = 4_000, 100_000  # middles of cells and sides at which a trial, and the table, are measured
_FIRST_CELLS, _TRIALS, _WIDER = 40, 8, 4.0  # cells across the first trial; trials; most from one to a wider one
_MARGIN = 0.95  # of the spacing that the power law gives
_ROUNDING_NM = 1e-3  # of the files


@dataclass(frozen=True)
class GridRequest:
    """Settings of the tables.

    ``spacing_mm``: between nodes; None: as wide as an error of the ``interpolation`` of ``error_nm`` along the normal
    allows. ``slope_deg``: where the raster ends. ``offset_inner_mm``, ``offset_outer_mm``: radius of the ball whose
    centres the tables hold; 0: points on the face.
    """

    spacing_mm: float | None = None
    error_nm: float = 10.0
    interpolation: Interpolation = "bicubic"
    slope_deg: float = 60.0
    offset_inner_mm: float = 0.0
    offset_outer_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.interpolation not in get_args(Interpolation):
            raise InputError(f"interpolation = {self.interpolation!r}: one of {', '.join(get_args(Interpolation))}")
        for name, value, least, most in (
            ("spacing", self.spacing_mm, 1e-4, 1e3),
            ("error", self.error_nm, 1e-2, 1e6),
            ("slope", self.slope_deg, 1.0, 85.0),
        ):
            if value is None and name == "spacing":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not least <= value <= most:
                unit = {"spacing": "mm", "error": "nm", "slope": "degrees"}[name]
                raise InputError(f"{name} = {value!r}: a number of {unit} from {least:g} to {most:g}")


@dataclass(frozen=True)
class MeasuredGrid:
    """A table and the largest error (nm) of what is interpolated in it, at ``measured`` places, and of its nodes."""

    grid: Raster | Polar
    error_nm: float
    measured: int


def make_grids(lens: Lens, check: Check, request: GridRequest) -> list[MeasuredGrid]:
    """Raster and rings of the inner and of the outer face.

    Raises :class:`InputError` for an offset that does not fit a face, and for a spacing that gives too many points or
    none.
    """
    offsets: dict[FaceName, float] = {"inner": request.offset_inner_mm, "outer": request.offset_outer_mm}
    found = []
    for face in offset_faces(lens, check, offsets):
        found += [_raster(face, request), _polar(face, request)]
    return found


def _raster(face: OffsetFace, request: GridRequest) -> MeasuredGrid:
    extent = raster_extent(face, request.slope_deg)
    if not extent.radius_mm > 1e-6 * _ROUNDING_NM:
        raise InputError(
            f"slope = {request.slope_deg:g} degrees: the {face.name} face is steeper than that at its apex, and has no "
            "raster; give a larger slope"
        )

    def make(spacing_mm: float) -> Raster:
        _require_count(np.pi * (extent.radius_mm / spacing_mm) ** 2, face, "raster", request)
        raster = make_raster(face, extent, spacing_mm)
        if not raster.covered_mm(request.interpolation) > 0.0:
            raise InputError(
                f"spacing = {spacing_mm:g} mm: the raster of the {face.name} face is {2.0 * extent.radius_mm:.4g} mm "
                "wide, and has no complete cell; give a smaller spacing"
            )
        return raster

    return _measured(make, 2.0 * extent.radius_mm / _FIRST_CELLS, request)


def _polar(face: OffsetFace, request: GridRequest) -> MeasuredGrid:
    end_deg = polar_end_deg(face)
    size = float(face.at(np.array([[0.0, 0.0, 1.0]]))[0][0, 2])

    def make(spacing_mm: float) -> Polar:
        _require_count(2.0 * np.pi * np.radians(end_deg) * (size / spacing_mm) ** 2, face, "polar table", request)
        return make_polar(face, end_deg, spacing_mm, request.interpolation)

    return _measured(make, 2.0 * size / _FIRST_CELLS, request)


def _measured(make: Callable[[float], Raster | Polar], first_mm: float, request: GridRequest) -> MeasuredGrid:
    """The table of the spacing that is given, or of about the widest that keeps the error."""
    if request.spacing_mm is not None:
        return _stated(make(request.spacing_mm), request)
    spacing, order = first_mm, ORDER[request.interpolation]
    for trial in range(_TRIALS):
        spacing = _rounded_down(spacing)
        grid = make(spacing)
        error = float(grid.errors_nm(request.interpolation, _TRIED).max())
        if trial > 0 and error <= request.error_nm:
            found = _stated(grid, request)
            if found.error_nm <= request.error_nm:
                return found
            error = found.error_nm
        wider = _MARGIN * (request.error_nm / max(error, _ROUNDING_NM)) ** (1.0 / order)
        tried, spacing = spacing, spacing * min(wider, _WIDER)
    raise InputError(
        f"error = {request.error_nm:g} nm: {error:.3g} nm at a spacing of {tried:.3g} mm; give a larger error"
    )


def _stated(grid: Raster | Polar, request: GridRequest) -> MeasuredGrid:
    errors = grid.errors_nm(request.interpolation, _MEASURED)
    return MeasuredGrid(grid, float(errors.max()) + grid.face.spline_error_nm + _ROUNDING_NM, len(errors))


def _rounded_down(spacing_mm: float) -> float:
    """``spacing_mm`` to three significant digits, for the header of the table."""
    unit = 10.0 ** (np.floor(np.log10(spacing_mm)) - 2.0)
    return float(f"{np.floor(spacing_mm / unit + 1e-9) * unit:.3g}")


def _require_count(points: float, face: OffsetFace, kind: str, request: GridRequest) -> None:
    if points <= MOST_POINTS:
        return
    name, asked = "error", f"error = {request.error_nm:g} nm"
    if request.spacing_mm is not None:
        name, asked = "spacing", f"spacing = {request.spacing_mm:g} mm"
    other = ", or bicubic interpolation" if request.interpolation == "linear" else ""
    raise InputError(
        f"{asked}: the {kind} of the {face.name} face would have {points:.2g} points, at most {MOST_POINTS}; give a "
        f"larger {name}{other}"
    )
