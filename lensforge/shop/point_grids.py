"""Dense tables of points for turning and milling: a raster and rings on each face, each with its interpolation error.

The spacing is given, or found: error and spacing follow a power law, so that a few trials reach the error asked for.

A raster has X, Y, Z, for raster milling, fly-cutting and slow tools. Z(x, y) has no finite slope where a face stands
upright, as at the rim of a hemisphere. The raster therefore ends where the face becomes steeper than a given angle, on
the largest circle about the axis within which it does not; the polar table has the rest.

A polar table has R, theta, Z on rings about the axis, for turning with a slow or fast tool servo. The rings are even in
the polar angle as seen from the origin, not in R: a face that stands upright at its rim is covered down to the rim. On
a meridian R and Z are both functions of that angle, and both are interpolated, as the axes of the machine are from one
block to the next.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from numbers import Real
from typing import get_args

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check, FaceName
from lensforge.shop.interpolation import BEYOND, ORDER, Interpolation, halfway
from lensforge.shop.offset_face import OffsetFace, Plane, Points, offset_faces
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import to_chart

_RINGS, _AZIMUTHS = 181, 120  # half a degree, 3 degrees; the slope of every node is measured, and the largest stated
_AREA_SAMPLES = 20_000


@dataclass(frozen=True)
class Extent2D:
    """Radius (mm) of the circle about the axis that the raster fills; ``steep``: it ends at the steepest slope."""

    radius_mm: float
    steep: bool


def raster_extent(face: OffsetFace, slope_deg: float) -> Extent2D:
    """The circle within which no point of ``face`` is steeper than ``slope_deg`` and none lies beyond the rim."""
    polar = np.linspace(0.0, 0.5 * np.pi, _RINGS)
    azimuth = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False)
    t, phi = (each.ravel() for each in np.meshgrid(polar, azimuth, indexing="ij"))
    directions = np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.cos(t)], axis=-1)
    centres, normals = face.at(directions)
    out = np.linalg.norm(centres[:, :2], axis=1).reshape(_RINGS, _AZIMUTHS)
    steep = (face.air * normals[:, 2] < np.cos(np.radians(slope_deg))).reshape(_RINGS, _AZIMUTHS)
    # On each meridian the last sample before the first steep one, or the rim: an overhang is not seen from above.
    last = np.where(steep.any(axis=0), np.maximum(steep.argmax(axis=0) - 1, 0), _RINGS - 1)
    ends = out[last, np.arange(_AZIMUTHS)]
    narrowest = int(ends.argmin())
    return Extent2D(float(ends[narrowest]), bool(steep[:, narrowest].any()))


@dataclass(frozen=True)
class Raster:
    """Nodes of a raster of ``spacing_mm`` inside ``extent``: [X, Y], NaN outside; the steepest has ``slope_deg``."""

    face: OffsetFace
    spacing_mm: float
    extent: Extent2D
    x_mm: Float[np.ndarray, " n"]
    z_mm: Float[np.ndarray, "n n"]
    slope_deg: float

    @property
    def rows(self) -> Points:
        """All nodes, row by row along x, from the lowest y upwards."""
        rows, columns = np.nonzero(np.isfinite(self.z_mm.T))
        return np.stack([self.x_mm[columns], self.x_mm[rows], self.z_mm.T[rows, columns]], axis=-1)

    def covered_mm(self, scheme: Interpolation) -> float:
        """Radius (mm) within which every cell has all nodes that its interpolation needs."""
        return self.extent.radius_mm - sqrt(2.0) * self.spacing_mm * (1 + BEYOND[scheme])

    def covered_share(self, scheme: Interpolation) -> float:
        """Share of the face's area whose points lie within :meth:`covered_mm`."""
        directions = fibonacci_hemisphere(_AREA_SAMPLES)
        centres, normals = self.face.at(directions)
        radius = self.face.surface.radius(directions)
        area = radius**2 / np.abs(np.sum(normals * directions, axis=1))
        inside = np.linalg.norm(centres[:, :2], axis=1) <= self.covered_mm(scheme)
        return float(area[inside].sum() / area.sum())

    def errors_nm(self, scheme: Interpolation, most: int) -> Float[np.ndarray, " k"]:
        """Error of the interpolation along the normal in the middle of cells and sides; of at most ``most`` of them."""
        middles = self._middles(scheme)
        middles = middles[:: max(1, -(-len(middles) // most))]
        centres, normals = self.face.found(middles[:, :2], _across, upward=True)
        error: Float[np.ndarray, " k"] = 1e6 * np.abs((middles[:, 2] - centres[:, 2]) * normals[:, 2])
        return error

    def _middles(self, scheme: Interpolation) -> Points:
        first = BEYOND[scheme]
        nodes, between = self.x_mm, 0.5 * (self.x_mm[:-1] + self.x_mm[1:])
        between = between[first : len(between) - first]
        values = self.z_mm[..., None]
        along_x, along_y = halfway(values, 0, scheme), halfway(values, 1, scheme)
        found = []
        for x, y, z in (
            (between, nodes, along_x),
            (nodes, between, along_y),
            (between, between, halfway(along_x, 1, scheme)),
        ):
            grid = np.concatenate([np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1), z], axis=-1).reshape(-1, 3)
            found.append(grid[np.isfinite(grid[:, 2])])
        return np.concatenate(found)


def make_raster(face: OffsetFace, extent: Extent2D, spacing_mm: float) -> Raster:
    """The raster of ``spacing_mm`` with a node on the axis."""
    reach = int(extent.radius_mm / spacing_mm)
    axis = spacing_mm * np.arange(-reach, reach + 1)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    inside = np.linalg.norm(nodes, axis=-1) <= extent.radius_mm
    z_mm = np.full(inside.shape, np.nan)
    centres, normals = face.found(nodes[inside], _across, upward=True)
    z_mm[inside] = centres[:, 2]
    slope_deg = float(np.degrees(np.arccos(np.clip(face.air * normals[:, 2], -1.0, 1.0).min())))
    return Raster(face, spacing_mm, extent, axis, z_mm, slope_deg)


def _across(points: Points) -> Plane:
    return points[:, :2]


_RIM_SAMPLES = 1440
_MOST_STEP_DEG = 6.0  # the ring or two that the interpolation needs below the rim must lie on the spline of the face


@dataclass(frozen=True)
class Polar:
    """Rings ``step_deg`` apart (polar angle), the first the apex, each of even azimuths; [ring, azimuth, (R, Z)] in mm.

    ``normals``: unit vectors from the material into the air at the same nodes, as x, y, z.
    ``rim``: number of the ring at the lowest point of the rim; rings beyond it are run-out.
    """

    face: OffsetFace
    step_deg: float
    rim: int
    azimuths_deg: Float[np.ndarray, " m"]
    values: Float[np.ndarray, "n m 2"]
    normals: Float[np.ndarray, "n m 3"]

    @property
    def rows(self) -> Float[np.ndarray, "k 4"]:
        """Polar angle and azimuth (degrees), R and Z (mm) of each node; the apex once."""
        rings, turns = self.values.shape[:2]
        polar, azimuth = np.meshgrid(self.step_deg * np.arange(rings), self.azimuths_deg, indexing="ij")
        rows = np.concatenate([np.stack([polar, azimuth], axis=-1), self.values], axis=-1).reshape(-1, 4)
        return np.concatenate([rows[:1], rows[turns:]])

    @property
    def cloud(self) -> Float[np.ndarray, "k 6"]:
        """x, y, z (mm) and unit normal of each node without the run-out, the apex once."""
        turn, on_face = np.radians(self.azimuths_deg), self.values[: self.rim + 1]
        r, z = on_face[..., 0], on_face[..., 1]
        rows = np.concatenate(
            [np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1), self.normals[: self.rim + 1]], -1
        )
        return np.concatenate([rows[0, :1], rows[1:].reshape(-1, 6)])

    @property
    def spacing_mm(self) -> float:
        """Largest distance (mm) between neighbouring nodes, along a meridian or around a ring."""
        along = np.linalg.norm(np.diff(self.values, axis=0), axis=-1).max()
        around = self.values[..., 0].max() * np.radians(self.azimuths_deg[1])
        return float(max(along, around))

    def errors_nm(self, scheme: Interpolation, most: int) -> Float[np.ndarray, " k"]:
        """Error of the interpolation along the normal in the middle of cells and sides; of at most ``most`` of them."""
        middles = self._middles(scheme)
        middles = middles[:: max(1, -(-len(middles) // most))]
        azimuth = np.radians(middles[:, 1])
        centres, normals = self.face.found(_on_chart(middles[:, :2]), to_chart)
        across, up = middles[:, 2] - np.linalg.norm(centres[:, :2], axis=1), middles[:, 3] - centres[:, 2]
        outwards = normals[:, 0] * np.cos(azimuth) + normals[:, 1] * np.sin(azimuth)
        error: Float[np.ndarray, " k"] = 1e6 * np.abs(across * outwards + up * normals[:, 2])
        return error

    def _middles(self, scheme: Interpolation) -> Float[np.ndarray, "k 4"]:
        """Polar angle, azimuth, and interpolated R and Z in the middle of every cell and side up to the rim."""
        beyond, turns = BEYOND[scheme], len(self.azimuths_deg)
        # The ring before the first is the first one seen from the other side; the azimuths go around.
        before = np.roll(self.values[1 : 1 + beyond], turns // 2, axis=1) * [-1.0, 1.0]
        rings = np.concatenate([before, self.values])
        along = halfway(rings, 0, scheme)[: self.rim]
        around = halfway(_wrapped(self.values[: self.rim + 1], beyond), 1, scheme)
        both = halfway(_wrapped(along, beyond), 1, scheme)
        at = self.step_deg * np.arange(self.rim + 1)
        half_ring, half_turn = at[:-1] + 0.5 * self.step_deg, self.azimuths_deg + 0.5 * self.azimuths_deg[1]
        found = []
        for polar, azimuth, values in (
            (half_ring, self.azimuths_deg, along),
            (at[1:], half_turn, around[1:]),
            (half_ring, half_turn, both),
        ):
            angles = np.stack(np.meshgrid(polar, azimuth, indexing="ij"), axis=-1)
            found.append(np.concatenate([angles, values], axis=-1).reshape(-1, 4))
        return np.concatenate(found)


def _wrapped(values: Float[np.ndarray, "n m 2"], beyond: int) -> Float[np.ndarray, "n k 2"]:
    turns = values.shape[1]
    return values.take(range(-beyond, turns + 1 + beyond), axis=1, mode="wrap")


def polar_end_deg(face: OffsetFace) -> float:
    """Polar angle (degrees) of the lowest centre over the rim.

    Raises :class:`InputError` where the centres do not surround the origin, as with a large ball in a flat cavity.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, _RIM_SAMPLES, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    centres, normals = face.at(np.concatenate([rim, [[0.0, 0.0, 1.0]]]))
    nearest = float((face.air * np.sum(centres * normals, axis=1)).min())
    if nearest <= 0.0:
        raise InputError(
            f"offset of the {face.name} face = {face.offset_mm:g} mm: the ball's centres do not surround the origin, "
            f"about which the polar table is made; give one that is smaller by more than {-nearest:.4g} mm"
        )
    return float(np.degrees(np.arctan2(np.linalg.norm(centres[:-1, :2], axis=1), centres[:-1, 2])).max())


def make_polar(face: OffsetFace, end_deg: float, spacing_mm: float, scheme: Interpolation) -> Polar:
    """Rings and azimuths about ``spacing_mm`` apart at the widest, and the run-out that the interpolation needs."""
    size = float(np.linalg.norm(face.at(_RIM_AND_APEX)[0], axis=1).max())
    rim = max(int(np.ceil(end_deg / _MOST_STEP_DEG)), int(np.ceil(np.radians(end_deg) * size / spacing_mm)))
    turns = 2 * max(4, int(np.ceil(np.pi * size / spacing_mm)))
    step, azimuths = end_deg / rim, 360.0 / turns * np.arange(turns)
    rings = step * np.arange(1, rim + 1 + BEYOND[scheme])
    angles = np.stack(np.meshgrid(rings, azimuths, indexing="ij"), axis=-1).reshape(-1, 2)
    centres, normals = face.found(_on_chart(angles), to_chart)
    ring_values = np.stack([np.linalg.norm(centres[:, :2], axis=1), centres[:, 2]], axis=-1)
    (apex,), upright = face.found(np.zeros((1, 2)), to_chart)
    values = np.concatenate([np.tile([0.0, apex[2]], (1, turns, 1)), ring_values.reshape(len(rings), turns, 2)])
    vectors = np.concatenate([np.tile(upright, (1, turns, 1)), normals.reshape(len(rings), turns, 3)])
    return Polar(face, step, rim, azimuths, values, vectors)


_RIM_AND_APEX = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])


def _on_chart(angles_deg: Plane) -> Plane:
    """Stereographic coordinates of polar angle and azimuth."""
    polar, azimuth = np.radians(angles_deg).T
    chart: Plane = np.tan(0.5 * polar)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    return chart


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
        found += [_raster_of(face, request), _polar_of(face, request)]
    return found


def _raster_of(face: OffsetFace, request: GridRequest) -> MeasuredGrid:
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


def _polar_of(face: OffsetFace, request: GridRequest) -> MeasuredGrid:
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
