"""Dense table of points of each face, for turning and milling: rings about the axis, with the interpolation's error.

The rings are even in the polar angle as seen from the origin, not in R: a face that stands upright at its rim is
covered down to the rim. On a meridian R and Z are both functions of that angle, and both are interpolated, as the axes
of a machine are from one block to the next: by the polynomial through the nearest nodes (Lagrange), 2 along each axis,
or 4 with the cell in their middle, which needs no end conditions. It errs most in the middle of a cell or of its side.

The spacing is given, or found: error and spacing follow a power law, so that a few trials reach the error asked for.
"""

from dataclasses import dataclass
from numbers import Real
from typing import get_args

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check, FaceName
from lensforge.shop.handover import Interpolation
from lensforge.shop.offset_face import OffsetFace, Plane, offset_faces
from lensforge.spec.spec_section import rounded_up
from lensforge.surfaces.surface import to_chart

_WORDS: dict[Interpolation, str] = {
    "bicubic": "bicubic, the polynomial through the 4 x 4 nearest nodes",
    "linear": "bilinear, between the 4 nearest nodes",
}
_ORDER: dict[Interpolation, int] = {"bicubic": 4, "linear": 2}  # the error falls with this power of the spacing
# Nodes needed beyond a cell on each side.
_BEYOND: dict[Interpolation, int] = {"bicubic": 1, "linear": 0}
_MIDDLE: dict[Interpolation, tuple[float, ...]] = {
    "bicubic": (-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0),
    "linear": (0.5, 0.5),
}

MOST_POINTS = 400_000  # of one table: 40 MB of text
COLUMNS = "x_mm,y_mm,z_mm,nx,ny,nz,polar_deg,azimuth_deg"
_TRIED, _MEASURED = 4_000, 100_000  # middles of cells and sides at which a trial, and the table, are measured
_FIRST_CELLS, _TRIALS, _WIDER = 40, 8, 4.0  # cells across the first trial; trials; most from one to a wider one
_MARGIN = 0.95  # of the spacing that the power law gives
_ROUNDING_NM = 1e-3  # of the files
_RIM_SAMPLES = 1440
_MOST_STEP_DEG = 6.0  # the ring or two that the interpolation needs below the rim must lie on the spline of the face


@dataclass(frozen=True)
class GridRequest:
    """Settings of the tables.

    ``spacing_mm``: between nodes; None: as wide as an error of the ``interpolation`` of ``error_nm`` along the normal
    allows. ``offset_inner_mm``, ``offset_outer_mm``: radius of the ball whose centres the tables hold; 0: points on the
    face.
    """

    spacing_mm: float | None = None
    error_nm: float = 10.0
    interpolation: Interpolation = "bicubic"
    offset_inner_mm: float = 0.0
    offset_outer_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.interpolation not in get_args(Interpolation):
            raise InputError(f"interpolation = {self.interpolation!r}: one of {', '.join(get_args(Interpolation))}")
        for name, value, least, most in (
            ("spacing", self.spacing_mm, 1e-4, 1e3),
            ("error", self.error_nm, 1e-2, 1e6),
        ):
            if value is None and name == "spacing":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not least <= value <= most:
                unit = {"spacing": "mm", "error": "nm"}[name]
                raise InputError(f"{name} = {value!r}: a number of {unit} from {least:g} to {most:g}")


@dataclass(frozen=True)
class DenseTable:
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
    def rows(self) -> Float[np.ndarray, "k 8"]:
        """x, y, z (mm), unit normal, polar angle and azimuth (degrees) of each node; the apex once."""
        rings, turns = self.values.shape[:2]
        polar, azimuth = np.meshgrid(self.step_deg * np.arange(rings), self.azimuths_deg, indexing="ij")
        turn, r, z = np.radians(azimuth), self.values[..., 0], self.values[..., 1]
        places = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)
        angles = np.stack([polar, azimuth], axis=-1)
        rows = np.concatenate([places, self.normals, angles], axis=-1).reshape(-1, 8)
        return np.concatenate([rows[:1], rows[turns:]])

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
        beyond, turns = _BEYOND[scheme], len(self.azimuths_deg)
        # The ring before the first is the first one seen from the other side; the azimuths go around.
        before = np.roll(self.values[1 : 1 + beyond], turns // 2, axis=1) * [-1.0, 1.0]
        rings = np.concatenate([before, self.values])
        along = _halfway(rings, 0, scheme)[: self.rim]
        around = _halfway(_wrapped(self.values[: self.rim + 1], beyond), 1, scheme)
        both = _halfway(_wrapped(along, beyond), 1, scheme)
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


def _halfway(values: Float[np.ndarray, "n m c"], axis: int, scheme: Interpolation) -> Float[np.ndarray, "k l c"]:
    """Values halfway between the nodes along ``axis``; NaN where a node that this needs is NaN.

    The first is ``_BEYOND`` nodes and a half from the first node.
    """
    weights = _MIDDLE[scheme]
    count = values.shape[axis] - len(weights) + 1
    return sum((weight * np.take(values, range(k, k + count), axis) for k, weight in enumerate(weights)), np.zeros(()))


@dataclass(frozen=True)
class MeasuredTable:
    """A table and the largest error (nm) of what is interpolated in it, at ``measured`` places, and of its nodes."""

    table: DenseTable
    error_nm: float
    measured: int


def dense_tables(lens: Lens, check: Check, request: GridRequest) -> list[MeasuredTable]:
    """The table of the inner and of the outer face.

    Raises :class:`InputError` for an offset that does not fit a face, and for a spacing that gives too many points.
    """
    offsets: dict[FaceName, float] = {"inner": request.offset_inner_mm, "outer": request.offset_outer_mm}
    return [_measured(face, request) for face in offset_faces(lens, check, offsets)]


def _measured(face: OffsetFace, request: GridRequest) -> MeasuredTable:
    """The table of the spacing that is given, or of about the widest that keeps the error."""
    end_deg = polar_end_deg(face)
    size = float(face.at(np.array([[0.0, 0.0, 1.0]]))[0][0, 2])

    def make(spacing_mm: float) -> DenseTable:
        _require_count(2.0 * np.pi * np.radians(end_deg) * (size / spacing_mm) ** 2, face, request)
        return make_table(face, end_deg, spacing_mm, request.interpolation)

    if request.spacing_mm is not None:
        return _stated(make(request.spacing_mm), request)
    spacing, order = 2.0 * size / _FIRST_CELLS, _ORDER[request.interpolation]
    for trial in range(_TRIALS):
        spacing = _rounded_down(spacing)
        table = make(spacing)
        error = float(table.errors_nm(request.interpolation, _TRIED).max())
        if trial > 0 and error <= request.error_nm:
            found = _stated(table, request)
            if found.error_nm <= request.error_nm:
                return found
            error = found.error_nm
        wider = _MARGIN * (request.error_nm / max(error, _ROUNDING_NM)) ** (1.0 / order)
        tried, spacing = spacing, spacing * min(wider, _WIDER)
    raise InputError(
        f"error = {request.error_nm:g} nm: {error:.3g} nm at a spacing of {tried:.3g} mm; give a larger error"
    )


def _stated(table: DenseTable, request: GridRequest) -> MeasuredTable:
    errors = table.errors_nm(request.interpolation, _MEASURED)
    return MeasuredTable(table, float(errors.max()) + table.face.spline_error_nm + _ROUNDING_NM, len(errors))


def _rounded_down(spacing_mm: float) -> float:
    """``spacing_mm`` to three significant digits, for the header of the table."""
    unit = 10.0 ** (np.floor(np.log10(spacing_mm)) - 2.0)
    return float(f"{np.floor(spacing_mm / unit + 1e-9) * unit:.3g}")


def _require_count(points: float, face: OffsetFace, request: GridRequest) -> None:
    if points <= MOST_POINTS:
        return
    name, asked = "error", f"error = {request.error_nm:g} nm"
    if request.spacing_mm is not None:
        name, asked = "spacing", f"spacing = {request.spacing_mm:g} mm"
    other = ", or bicubic interpolation" if request.interpolation == "linear" else ""
    raise InputError(
        f"{asked}: the table of the {face.name} face would have {points:.2g} points, at most {MOST_POINTS}; give a "
        f"larger {name}{other}"
    )


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
            f"about which the table is made; give one that is smaller by more than {-nearest:.4g} mm"
        )
    return float(np.degrees(np.arctan2(np.linalg.norm(centres[:-1, :2], axis=1), centres[:-1, 2])).max())


def make_table(face: OffsetFace, end_deg: float, spacing_mm: float, scheme: Interpolation) -> DenseTable:
    """Rings and azimuths about ``spacing_mm`` apart at the widest, and the run-out that the interpolation needs."""
    size = float(np.linalg.norm(face.at(_RIM_AND_APEX)[0], axis=1).max())
    rim = max(int(np.ceil(end_deg / _MOST_STEP_DEG)), int(np.ceil(np.radians(end_deg) * size / spacing_mm)))
    turns = 2 * max(4, int(np.ceil(np.pi * size / spacing_mm)))
    step, azimuths = end_deg / rim, 360.0 / turns * np.arange(turns)
    rings = step * np.arange(1, rim + 1 + _BEYOND[scheme])
    angles = np.stack(np.meshgrid(rings, azimuths, indexing="ij"), axis=-1).reshape(-1, 2)
    centres, normals = face.found(_on_chart(angles), to_chart)
    ring_values = np.stack([np.linalg.norm(centres[:, :2], axis=1), centres[:, 2]], axis=-1)
    (apex,), upright = face.found(np.zeros((1, 2)), to_chart)
    values = np.concatenate([np.tile([0.0, apex[2]], (1, turns, 1)), ring_values.reshape(len(rings), turns, 2)])
    vectors = np.concatenate([np.tile(upright, (1, turns, 1)), normals.reshape(len(rings), turns, 3)])
    return DenseTable(face, step, rim, azimuths, values, vectors)


_RIM_AND_APEX = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])


def _on_chart(angles_deg: Plane) -> Plane:
    """Stereographic coordinates of polar angle and azimuth."""
    polar, azimuth = np.radians(angles_deg).T
    chart: Plane = np.tan(0.5 * polar)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    return chart


def file_name(table: DenseTable) -> str:
    """Name of the table's file."""
    return f"grid_{table.face.name}.csv"


def table_text(measured: MeasuredTable, head: list[str], request: GridRequest) -> str:
    """The table as text: ``head`` and more lines that begin with # and say all that is needed to read it, then rows."""
    table, scheme = measured.table, request.interpolation
    lines = [
        *head,
        *_face_lines(table.face),
        *_node_lines(table, request),
        f"interpolation: {_WORDS[scheme]}",
        f"interpolation error: at most {rounded_up(measured.error_nm, 3)} nm along the normal against the exact face, "
        f"at {measured.measured} middles of cells and of their sides",
    ]
    rows = (np.round(table.rows, 9) + 0.0).tolist()  # no minus zero
    body = [",".join(f"{value:.9f}" for value in row) for row in rows]
    return "\n".join([*(f"# {line}" for line in lines), COLUMNS, *body]) + "\n"


def _face_lines(face: OffsetFace) -> list[str]:
    side = "away from the origin" if face.air > 0 else "towards the origin"
    if face.offset_mm == 0.0:
        offset = "offset: 0; the points lie on the face"
    else:
        offset = (
            f"offset: {face.offset_mm:.9g} mm, the points are centres of a ball of this radius, "
            f"P + {face.offset_mm:.9g} n with P on the face and n its unit normal from the material into the air"
        )
    return [f"face: {face.name}; its air, where the tool is, lies {side}", offset]


def _node_lines(table: DenseTable, request: GridRequest) -> list[str]:
    turns = len(table.azimuths_deg)
    return [
        f"nodes: rings of polar angle i p with p = {table.step_deg:.15g} degrees, seen from the origin; {turns} "
        f"azimuths k q with q = {360.0 / turns:.15g} degrees; the apex once; spacing up to {table.spacing_mm:.4g} mm",
        f"extent: all of the face; ring {table.rim} is at the lowest point of the rim, "
        f"{_BEYOND[request.interpolation]} more and what lies below the rim continue the face smoothly (run-out)",
        "interpolated over polar angle and azimuth: z, and r, the distance from the axis; the ring before the apex is "
        "the first one from the other side, r with the other sign",
        "nx, ny, nz: the unit normal from the material into the air",
    ]
