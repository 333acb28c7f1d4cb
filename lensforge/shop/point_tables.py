"""Tables of points of the faces as the shop cuts them: coarse rings to measure at, and dense ones to cut from.

All points are of the exact surfaces, each with its unit normal from the material into the air: the centre of a ball of
radius R that touches at **p** is **p** + R **n**.

The rings of a dense table are even in the polar angle as seen from the origin, which covers a rim that stands upright.
R and Z are interpolated over it and the azimuth by the polynomial through the nearest nodes (Lagrange), 2 along each
axis, or 4 with the cell in their middle. It errs most in the middle of a cell or of its side. The spacing is given, or
found: error and spacing follow a power law. A face that ends at creases has rings from the one to the other.
"""

from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Protocol, get_args

import numpy as np
from jaxtyping import Float

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check
from lensforge.shop.handover import Interpolation, PointGrid
from lensforge.spec.spec_section import rounded_up
from lensforge.surfaces.surface import Surface, scaled

if TYPE_CHECKING:
    from lensforge.cad.boundary import Domain

POINT_COLUMNS = "surface,x_mm,y_mm,z_mm,nx,ny,nz,polar_deg,azimuth_deg,departure_mm"
COLUMNS = "x_mm,y_mm,z_mm,nx,ny,nz,polar_deg,azimuth_deg"
_POLAR_DEG = np.arange(2.5, 90.1, 2.5)
_AZIMUTH_DEG = np.arange(0.0, 360.0, 5.0)

_WORDS: dict[Interpolation, str] = {
    "bicubic": "bicubic, the polynomial through the 4 x 4 nearest nodes",
    "linear": "bilinear, between the 4 nearest nodes",
}
ORDER: dict[Interpolation, int] = {"bicubic": 4, "linear": 2}  # the error falls with this power of the spacing
# Nodes needed beyond a cell on each side.
BEYOND: dict[Interpolation, int] = {"bicubic": 1, "linear": 0}
_MIDDLE: dict[Interpolation, tuple[float, ...]] = {
    "bicubic": (-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0),
    "linear": (0.5, 0.5),
}

MOST_POINTS = 400_000  # of one table: 40 MB of text
_TRIED = 4_000  # middles of cells and sides at which a trial is measured
_MEASURED = 100_000  # the same for the table that is chosen
_FIRST_CELLS = 40  # cells across the first trial
_TRIALS = 8  # trials
_WIDER = 4.0  # most from one to a wider one
_TRIED_DEG = 181  # polar angles at which the length of a face is measured
_MARGIN = 0.95  # of the spacing that the power law gives
ROUNDING_NM = 1e-3  # of the files
_RIM_DEG = 90.0
_MOST_STEP_DEG = 6.0  # the ring that the interpolation needs below the rim lies where the surfaces still have a radius


@dataclass(frozen=True)
class GridRequest:
    """Settings of the tables.

    ``spacing_mm``: between nodes; None: as wide as an error of the ``interpolation`` of ``error_nm`` along the normal
    allows.
    """

    spacing_mm: float | None = None
    error_nm: float = 10.0
    interpolation: Interpolation = "bicubic"

    def __post_init__(self) -> None:
        if self.interpolation not in get_args(Interpolation):
            raise InputError(f"interpolation = {self.interpolation!r}: one of {', '.join(get_args(Interpolation))}")
        for name, value, unit, least, most in (
            ("spacing", self.spacing_mm, "mm", 1e-4, 1e3),
            ("error", self.error_nm, "nm", 1e-2, 1e6),
        ):
            if value is None and name == "spacing":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not least <= value <= most:
                raise InputError(f"{name} = {value!r}: a number of {unit} from {least:g} to {most:g}")


@dataclass(frozen=True)
class FaceToCut:
    """A face as it is cut; ``air``: 1 if the air lies outside its ``surface``, -1 if inside.

    ``domain``: the part of the chart on which it bounds the lens; None for all of the hemisphere.
    """

    name: str
    surface: Surface
    air: int
    domain: "Domain | None" = None

    @property
    def ends_deg(self) -> tuple[float, float]:
        """Polar angles (degrees) of its two ends: 0 and 90 for a whole face."""
        if self.domain is None:
            return 0.0, _RIM_DEG
        low, high = (float(np.degrees(2.0 * np.arctan(radius))) for radius in self.domain.extent)
        return low, high if self.domain.outside is not None else _RIM_DEG

    @property
    def lengths_mm(self) -> tuple[float, float]:
        """Largest length (mm) per radian along a meridian, and around the axis; for a whole face both are its size."""
        begin, end = self.ends_deg
        turn = np.array([0.0, 90.0, 180.0, 270.0])
        polar = np.linspace(begin, end, _TRIED_DEG)
        points, _ = self.at(np.stack(np.meshgrid(polar, turn, indexing="ij"), axis=-1).reshape(-1, 2))
        if self.domain is None:
            size = float(np.linalg.norm(points.reshape(_TRIED_DEG, 4, 3)[[0, -1]], axis=2).max())
            return size, size
        steps = np.diff(points.reshape(_TRIED_DEG, 4, 3), axis=0)
        along = float(np.linalg.norm(steps, axis=2).max()) / np.radians(polar[1] - polar[0])
        return along, float(np.hypot(points[:, 0], points[:, 1]).max())

    @property
    def ring_angles(self) -> Float[np.ndarray, "n 2"]:
        """Polar angle and azimuth (degrees) of every point to measure, the apex first."""
        polar, azimuth = np.meshgrid(_POLAR_DEG, _AZIMUTH_DEG, indexing="ij")
        angles = np.concatenate([np.zeros((1, 2)), np.stack([polar.ravel(), azimuth.ravel()], axis=-1)])
        if self.domain is None:
            return angles
        radius = np.tan(0.5 * np.radians(angles[:, 0]))
        low, high = self.domain.radii(np.radians(angles[:, 1]))
        return angles[(radius >= low) & (radius <= high + 1e-12)]

    def at(self, angles_deg: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points (mm) and unit air-side normals at polar angles and azimuths (degrees); the rim lies in z = 0."""
        polar, azimuth = np.radians(angles_deg).T
        height = np.where(angles_deg[:, 0] == _RIM_DEG, 0.0, np.cos(polar))
        directions = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), height], axis=-1)
        return self.surface.radius(directions)[:, None] * directions, self.air * self.surface.normal(directions)


def faces_to_cut(lens: Lens) -> list[FaceToCut]:
    """The faces as they are cut: for a mould insert scaled, with the air in place of the lens's material."""
    from lensforge.cad.boundary import lens_boundaries  # and with it SciPy
    from lensforge.shop.face_samples import air_side

    shop = lens.spec.manufacture
    trimmed = {face.name: face.domain for boundary in lens_boundaries(lens) for face in boundary.faces}
    domains = {name: domain if domain.edges else None for name, domain in trimmed.items()}
    return [
        FaceToCut(face.name, scaled(face.surface, shop.scale), air_side(face, shop), domains[face.name])
        for face in lens.body.faces
        if face.is_optical
    ]


@dataclass(frozen=True)
class PointTables:
    """``measured``: table of places to measure at, as bytes, and their number ``places``; ``grids``: dense tables."""

    measured: bytes
    places: int
    grids: tuple[PointGrid, ...]


def point_tables(lens: Lens, check: Check, head: list[str], request: GridRequest) -> PointTables:
    """Points to measure and the dense table of each face, each text beginning with ``head``.

    Raises :class:`InputError` for a table of too many points.
    """
    places = sum(len(face.ring_angles) for face in faces_to_cut(lens))
    return PointTables(points_table(lens, check, head).encode(), places, dense_tables(lens, head, request))


def points_table(lens: Lens, check: Check, head: list[str]) -> str:
    """Points to measure, each with its normal and its departure (mm) from the check's best-fit sphere."""
    lines = [*(f"# {line}" for line in head), POINT_COLUMNS]
    for face in faces_to_cut(lens):
        sphere = check.faces[face.name].best_fit_sphere
        angles = face.ring_angles
        points, normals = face.at(angles)
        departure = np.linalg.norm(points - np.array(sphere.centre_mm), axis=1) - sphere.radius_mm
        rows = np.round(np.column_stack([points, normals, angles, departure]), 9) + 0.0  # no minus zero
        lines += [face.name + "," + ",".join(f"{value:.9f}" for value in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def origin_lines(lens: Lens, part: Part) -> list[str]:
    """Lines stating the lens, its files, and their author."""
    signature = part.signature
    shop = lens.spec.manufacture
    scale = "shrinkage: none; the points are those of the lens itself"
    if shop.cuts == "inserts":
        scale = f"shrinkage: {shop.shrinkage:.12g}; the points are those of the mould, the lens times {shop.scale:.12g}"
    return [
        f"lens: {lens.spec.name}, SHA-256 {part.inputs['lens']}",
        f"author: {signature.author or 'not stated'}; organisation: {signature.organisation or 'not stated'}; "
        f"date: {signature.date or 'not stated'}; by lensforge {lens.version}",
        "units: mm, degrees; coordinates: those of lens.step, z = 0 the plane in which the optical faces end, z the "
        "optical axis; the azimuth counts from +x towards +y",
        scale,
    ]


@dataclass(frozen=True)
class DenseTable:
    """Rings ``step_deg`` apart from the polar angle ``first_deg`` on, of even azimuths; [ring, azimuth, (R, Z)] in mm.

    ``normals``: unit vectors from the material into the air at the same nodes, as x, y, z. The face lies from ring
    ``begin``, 0 where that is the apex, to ring ``rim``; the rings beyond continue it.
    """

    face: FaceToCut
    first_deg: float
    step_deg: float
    begin: int
    rim: int
    azimuths_deg: Float[np.ndarray, " m"]
    values: Float[np.ndarray, "n m 2"]
    normals: Float[np.ndarray, "n m 3"]

    @property
    def rows(self) -> Float[np.ndarray, "k 8"]:
        """x, y, z (mm), unit normal, polar angle and azimuth (degrees) of each node; the apex once."""
        turns = self.values.shape[1]
        polar, azimuth = np.meshgrid(self.polar_deg, self.azimuths_deg, indexing="ij")
        turn = np.radians(azimuth)
        r = self.values[..., 0]
        z = self.values[..., 1]
        places = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)
        angles = np.stack([polar, azimuth], axis=-1)
        rows = np.concatenate([places, self.normals, angles], axis=-1).reshape(-1, 8)
        return rows if self.first_deg > 0.0 else np.concatenate([rows[:1], rows[turns:]])

    @property
    def polar_deg(self) -> Float[np.ndarray, " n"]:
        """Polar angle (degrees) of each ring."""
        return np.asarray(self.first_deg + self.step_deg * np.arange(len(self.values)))

    @property
    def spacing_mm(self) -> float:
        """Largest distance (mm) between neighbouring nodes, along a meridian or around a ring."""
        along = np.linalg.norm(np.diff(self.values, axis=0), axis=-1).max()
        around = self.values[..., 0].max() * np.radians(self.azimuths_deg[1])
        return float(max(along, around))

    def errors_nm(self, scheme: Interpolation, most: int) -> Float[np.ndarray, " k"]:
        """Error (nm) of the interpolation along the normal in the middle of at most ``most`` cells and sides."""
        middles = self._middles(scheme)
        middles = middles[:: max(1, -(-len(middles) // most))]
        azimuth = np.radians(middles[:, 1])
        points, normals = self.face.at(middles[:, :2])
        across = middles[:, 2] - np.linalg.norm(points[:, :2], axis=1)
        up = middles[:, 3] - points[:, 2]
        outwards = normals[:, 0] * np.cos(azimuth) + normals[:, 1] * np.sin(azimuth)
        return np.asarray(1e6 * np.abs(across * outwards + up * normals[:, 2]))

    def _middles(self, scheme: Interpolation) -> Float[np.ndarray, "k 4"]:
        """Polar angle, azimuth, and interpolated R and Z in the middle of every cell and side of the face."""
        beyond = BEYOND[scheme]
        turns = len(self.azimuths_deg)
        begin = self.begin
        rings = self.values[begin - beyond :] if begin else self.values
        if not begin:  # the ring before the apex is the first one seen from the other side; the azimuths go around
            rings = np.concatenate([np.roll(rings[1 : 1 + beyond], turns // 2, axis=1) * [-1.0, 1.0], rings])
        along = halfway(rings, 0, scheme)[: self.rim - begin]
        around = halfway(_wrapped(self.values[begin : self.rim + 1], beyond), 1, scheme)
        both = halfway(_wrapped(along, beyond), 1, scheme)
        at = self.polar_deg[begin : self.rim + 1]
        half_ring = at[:-1] + 0.5 * self.step_deg
        half_turn = self.azimuths_deg + 0.5 * self.azimuths_deg[1]
        middles = []
        for polar, azimuth, values in (
            (half_ring, self.azimuths_deg, along),
            (at[1:], half_turn, around[1:]),
            (half_ring, half_turn, both),
        ):
            angles = np.stack(np.meshgrid(polar, azimuth, indexing="ij"), axis=-1)
            middles.append(np.concatenate([angles, values], axis=-1).reshape(-1, 4))
        return np.concatenate(middles)


def _wrapped(values: Float[np.ndarray, "n m 2"], beyond: int) -> Float[np.ndarray, "n k 2"]:
    turns = values.shape[1]
    return values.take(range(-beyond, turns + 1 + beyond), axis=1, mode="wrap")


def halfway(values: Float[np.ndarray, "n m c"], axis: int, scheme: Interpolation) -> Float[np.ndarray, "k l c"]:
    """Values halfway between the nodes along ``axis``; NaN where a node that this needs is NaN.

    The first is ``BEYOND`` nodes and a half from the first node.
    """
    weights = _MIDDLE[scheme]
    count = values.shape[axis] - len(weights) + 1
    return sum((weight * np.take(values, range(k, k + count), axis) for k, weight in enumerate(weights)), np.zeros(()))


def dense_tables(lens: Lens, head: list[str], request: GridRequest) -> tuple[PointGrid, ...]:
    """The table of each face, beginning with ``head``.

    Raises :class:`InputError` for a table of too many points.
    """
    return tuple(_grid(*_table_for(face, request), head, request) for face in faces_to_cut(lens))


def _grid(table: DenseTable, errors: Float[np.ndarray, " k"], head: list[str], request: GridRequest) -> PointGrid:
    error_nm = float(errors.max()) + ROUNDING_NM
    lines = [*head, *_table_lines(table, request, error_nm, len(errors))]
    return point_grid(table, request.interpolation, error_nm, table_text(table.rows, COLUMNS, lines))


class Nodes(Protocol):
    """A dense table of a face."""

    @property
    def face(self) -> FaceToCut: ...  # noqa: D102

    @property
    def rows(self) -> Float[np.ndarray, "n c"]: ...  # noqa: D102

    @property
    def spacing_mm(self) -> float: ...  # noqa: D102


def point_grid(table: Nodes, interpolation: Interpolation, error_nm: float, text: str) -> PointGrid:
    """The file of a dense table, whose content is ``text``."""
    return PointGrid(
        file=f"grid_{table.face.name}.csv",
        face=table.face.name,
        spacing_mm=table.spacing_mm,
        interpolation=interpolation,
        error_nm=error_nm,
        points=len(table.rows),
        content=text.encode(),
    )


def _table_for(face: FaceToCut, request: GridRequest) -> tuple[DenseTable, Float[np.ndarray, " k"]]:
    """The table of the requested spacing, or of about the widest that keeps the error; and its errors (nm)."""
    span = np.radians(face.ends_deg[1] - face.ends_deg[0])
    scheme = request.interpolation
    along, around = face.lengths_mm if face.domain else 2 * (float(face.at(np.zeros((1, 2)))[0][0, 2]),)

    def make(spacing_mm: float) -> DenseTable:
        require_count((span * along / spacing_mm) * (2.0 * np.pi * around / spacing_mm), face, request)
        return make_table(face, spacing_mm, scheme)

    if request.spacing_mm is not None:
        table = make(request.spacing_mm)
        return table, table.errors_nm(scheme, _MEASURED)
    spacing = 2.0 * around / _FIRST_CELLS
    for trial in range(_TRIALS):
        table = make(spacing)
        error = float(table.errors_nm(scheme, _TRIED).max())
        if trial > 0 and error <= request.error_nm:
            errors = table.errors_nm(scheme, _MEASURED)
            error = float(errors.max()) + ROUNDING_NM
            if error <= request.error_nm:
                return table, errors
        wider = _MARGIN * (request.error_nm / max(error, ROUNDING_NM)) ** (1.0 / ORDER[scheme])
        tried = spacing
        spacing = spacing * min(wider, _WIDER)
    raise InputError(
        f"error = {request.error_nm:g} nm: {error:.3g} nm at a spacing of {tried:.3g} mm; give a larger error"
    )


def require_count(points: float, face: FaceToCut, request: GridRequest) -> None:
    """Raise :class:`InputError` for a table of too many ``points``."""
    if points <= MOST_POINTS:
        return
    name = "error"
    setting = f"error = {request.error_nm:g} nm"
    if request.spacing_mm is not None:
        name = "spacing"
        setting = f"spacing = {request.spacing_mm:g} mm"
    alternative = ", or bicubic interpolation" if request.interpolation == "linear" else ""
    raise InputError(
        f"{setting}: the table of the {face.name} face would have {points:.2g} points, at most {MOST_POINTS}; give a "
        f"larger {name}{alternative}"
    )


def make_table(face: FaceToCut, spacing_mm: float, scheme: Interpolation) -> DenseTable:
    """Rings and azimuths about ``spacing_mm`` apart at the widest, over the face and as far as ``scheme`` needs."""
    begin_deg, end_deg = face.ends_deg
    along, around = face.lengths_mm
    span = end_deg - begin_deg
    count = max(int(np.ceil(span / _MOST_STEP_DEG)), int(np.ceil(np.radians(span) * along / spacing_mm)))
    turns = 2 * max(4, int(np.ceil(np.pi * around / spacing_mm)))
    begin = BEYOND[scheme] if begin_deg > 0.0 else 0
    step = span / count
    rim = begin + count
    azimuths = 360.0 / turns * np.arange(turns)
    first_deg = begin_deg - begin * step
    polar = first_deg + step * np.arange(rim + 1 + BEYOND[scheme])
    polar[rim] = end_deg
    points, normals = face.at(np.stack(np.meshgrid(polar, azimuths, indexing="ij"), axis=-1).reshape(-1, 2))
    values = np.stack([np.linalg.norm(points[:, :2], axis=1), points[:, 2]], axis=-1)
    shape = len(polar), turns
    nodes = values.reshape(*shape, 2), normals.reshape(*shape, 3)
    return DenseTable(face, first_deg, step, begin, rim, azimuths, *nodes)


def table_text(rows: Float[np.ndarray, "n c"], columns: str, head: list[str]) -> str:
    """A table as text: lines beginning with # that say how to read it, the names of its columns, then rows."""
    numbers = (np.round(rows, 9) + 0.0).tolist()  # no minus zero
    body = [",".join(f"{value:.9f}" for value in row) for row in numbers]
    return "\n".join([*(f"# {line}" for line in head), columns, *body]) + "\n"


def side_phrase(face: FaceToCut) -> str:
    """Phrase for the side on which the tool is."""
    return f"its air, where the tool is, lies {'away from' if face.air > 0 else 'towards'} the origin"


def _table_lines(table: DenseTable, request: GridRequest, error_nm: float, measured: int) -> list[str]:
    """Lines on the face, the nodes, the interpolation, and its error at ``measured`` places."""
    turns = len(table.azimuths_deg)
    beyond = BEYOND[request.interpolation]
    first = table.first_deg
    begins = f"b + i p with b = {first:.15g} degrees and"
    apex = ""
    before = ""
    extent = f", from ring {table.begin}, which reaches its crease"
    where = "at either end"
    if not table.begin:
        begins = "i p with"
        apex = "the apex once; "
        extent = ""
        where = "beyond it"
        before = "; the ring before the apex is the first one from the other side, r with the other sign"
    rim = "reaches its crease"
    if table.face.ends_deg[1] == _RIM_DEG:
        rim = "is the rim"
        where = where if table.begin else "below it"
    return [
        f"face: {table.face.name}; {side_phrase(table.face)}",
        f"nodes: rings of polar angle {begins} p = {table.step_deg:.15g} degrees, seen from the origin; {turns} "
        f"azimuths k q with q = {360.0 / turns:.15g} degrees; {apex}spacing up to {table.spacing_mm:.4g} mm",
        f"extent: all of the face{extent}; ring {table.rim} {rim}, {beyond} more {where} "
        "continues the face smoothly (extension)",
        f"interpolated over polar angle and azimuth: z, and r, the distance from the axis{before}",
        "nx, ny, nz: the unit normal n from the material into the air; the centre of a ball of radius R is p + R n",
        f"interpolation: {_WORDS[request.interpolation]}",
        f"interpolation error: at most {rounded_up(error_nm, 3)} nm along the normal against the exact face, "
        f"at {measured} middles of cells and of their sides",
    ]
