"""Tables of points of a linear lens: its profiles, dense to cut from, and places along the part to measure at.

A profile is told in the plane y = 0; the face is that profile at every y. Nodes are even in the angle from z towards
+x, as seen from the origin, and reach from foot to foot. x and z are interpolated over the angle by the polynomial
through the nearest nodes (Lagrange), which errs most halfway between them.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.optics.face_roles import BODY, CAVITY
from lensforge.scene.lens import Lens
from lensforge.scene.section_arcs import numbered
from lensforge.shop.handover import Interpolation, PointGrid
from lensforge.shop.point_tables import (
    BEYOND,
    ORDER,
    ROUNDING_NM,
    FaceToCut,
    GridRequest,
    PointTables,
    faces_to_cut,
    halfway,
    point_grid,
    require_count,
    side_phrase,
    table_text,
)
from lensforge.spec.spec_section import rounded_up
from lensforge.surfaces.drawn_profile import in_section

POINT_COLUMNS = "surface,x_mm,y_mm,z_mm,nx,ny,nz,angle_deg"
COLUMNS = "x_mm,z_mm,nx,nz,angle_deg"
_FOOT = "foot"
_FOOT_DEG = 90.0
_MEASURED_DEG = np.arange(-90.0, 90.1, 2.5)
_ALONG = np.array([-0.45, -0.225, 0.0, 0.225, 0.45])  # of the length, clear of the ends
_FEWEST = 32  # cells of the first trial
_SPARE = 1.02  # more cells than the power law asks for
_MORE = 4.0  # most from one trial to the next
_ANGLES = 721  # at which the length of a profile is measured

_OVER_ANGLE: dict[Interpolation, str] = {
    "bicubic": "the polynomial through the 4 nearest nodes",
    "linear": "linear between the 2 nearest nodes",
}


@dataclass(frozen=True)
class ProfileToCut:
    """The profile of a ``face`` as it is cut, from ``low_deg`` to ``high_deg`` from z."""

    face: FaceToCut
    low_deg: float = -90.0
    high_deg: float = 90.0

    def at(self, angles_deg: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Points (x, z) in mm and unit air-side normals at angles from z; the feet lie in z = 0."""
        directions = in_section(np.radians(angles_deg))
        directions[np.abs(angles_deg) == 90.0, 2] = 0.0
        points = self.face.surface.radius(directions)[:, None] * directions
        return points[:, ::2], self.face.air * self.face.surface.normal(directions)[:, ::2]

    @property
    def length_mm(self) -> float:
        """Its length from end to end."""
        points, _ = self.at(np.linspace(self.low_deg, self.high_deg, _ANGLES))
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


@dataclass(frozen=True)
class ProfileTable:
    """Nodes of a profile at ``angles_deg``, those beyond its ends too; ``beyond``: how many on each side."""

    profile: ProfileToCut
    angles_deg: Float[np.ndarray, " n"]
    beyond: int

    @staticmethod
    def of(profile: ProfileToCut, cells: int, scheme: Interpolation) -> "ProfileTable":
        """A table of ``cells`` from end to end."""
        beyond = BEYOND[scheme]
        nodes = np.arange(-beyond, cells + beyond + 1)
        return ProfileTable(profile, profile.low_deg + (profile.high_deg - profile.low_deg) * nodes / cells, beyond)

    @property
    def face(self) -> FaceToCut:
        """The face whose profile it holds."""
        return self.profile.face

    @property
    def rows(self) -> Float[np.ndarray, "n 5"]:
        """x, z (mm), unit normal and angle (degrees) of each node."""
        return np.column_stack([*self.profile.at(self.angles_deg), self.angles_deg])

    @property
    def spacing_mm(self) -> float:
        """Largest distance (mm) between neighbouring nodes of the face."""
        within = self.rows[self.beyond : len(self.angles_deg) - self.beyond, :2]
        return float(np.linalg.norm(np.diff(within, axis=0), axis=1).max())

    def errors_nm(self, scheme: Interpolation) -> Float[np.ndarray, " k"]:
        """Error (nm) of the interpolation along the normal in the middle of each cell."""
        nodes, _ = self.profile.at(self.angles_deg)
        between = halfway(nodes[:, None], 0, scheme)[:, 0]
        within = self.angles_deg[self.beyond : len(self.angles_deg) - self.beyond]
        points, normals = self.profile.at(0.5 * (within[1:] + within[:-1]))
        return np.asarray(1e6 * np.abs(np.sum((between - points) * normals, axis=1)))


def drawn_point_tables(lens: Lens, head: list[str], request: GridRequest) -> PointTables:
    """Points to measure and the dense table of each profile, each text beginning with ``head``.

    Raises :class:`InputError` for a table of too many points.
    """
    profiles = _profiles_to_cut(lens)
    length_mm = lens.spec.lens.drawn_mm
    assert length_mm is not None
    rows = [row for profile in profiles for row in _places(profile, length_mm * lens.spec.manufacture.scale)]
    points = "\n".join([*(f"# {line}" for line in head), POINT_COLUMNS, *rows]) + "\n"
    grids = tuple(_grid(profile, head, request) for profile in profiles)
    return PointTables(points.encode(), len(rows), grids)


def _profiles_to_cut(lens: Lens) -> list[ProfileToCut]:
    """Each arc of the section as it is cut, of the cavity first."""
    faces = {face.name: face for face in faces_to_cut(lens)}
    arcs = numbered([*lens.body.arcs(CAVITY), *lens.body.arcs(BODY)])
    return [
        ProfileToCut(
            replace(faces[arc.name], name=name), float(np.degrees(arc.low_rad)), float(np.degrees(arc.high_rad))
        )
        for name, arc in arcs.items()
    ]


def _places(profile: ProfileToCut, length_mm: float) -> list[str]:
    """Rows of places to measure: the profile at five places along the part."""
    measured = _MEASURED_DEG[(profile.low_deg <= _MEASURED_DEG) & (profile.high_deg >= _MEASURED_DEG)]
    points, normals = profile.at(measured)
    rows = []
    for y in length_mm * _ALONG:
        places = np.insert(points, 1, y, axis=1)
        upright = np.insert(normals, 1, 0.0, axis=1)
        numbers = np.round(np.column_stack([places, upright, measured]), 9) + 0.0  # no minus zero
        rows += [f"{profile.face.name}," + ",".join(f"{value:.9f}" for value in row) for row in numbers.tolist()]
    return rows


def _grid(profile: ProfileToCut, head: list[str], request: GridRequest) -> PointGrid:
    table = _table_for(profile, request)
    error_nm = float(table.errors_nm(request.interpolation).max()) + ROUNDING_NM
    text = table_text(table.rows, COLUMNS, [*head, *_lines(table, request, error_nm)])
    return point_grid(table, request.interpolation, error_nm, text)


def _table_for(profile: ProfileToCut, request: GridRequest) -> ProfileTable:
    """The table of the requested spacing, or of about the fewest nodes that keep the error."""
    scheme = request.interpolation
    spacing_mm = request.spacing_mm
    cells = _FEWEST if spacing_mm is None else max(_FEWEST, int(np.ceil(profile.length_mm / spacing_mm)))
    while True:
        require_count(cells, profile.face, request)
        table = ProfileTable.of(profile, cells, scheme)
        if spacing_mm is not None:  # nodes even in the angle are not even along the profile
            excess = table.spacing_mm / spacing_mm
        else:
            error_nm = float(table.errors_nm(scheme).max()) + ROUNDING_NM
            excess = (error_nm / request.error_nm) ** (1.0 / ORDER[scheme])
        if excess <= 1.0:
            return table
        cells = int(np.ceil(cells * min(_SPARE * excess, _MORE)))


def _lines(table: ProfileTable, request: GridRequest, error_nm: float) -> list[str]:
    """Lines on the profile, the nodes, the interpolation, and its error."""
    cells = len(table.angles_deg) - 1 - 2 * table.beyond
    low, high = table.profile.low_deg, table.profile.high_deg
    ends = [_FOOT if abs(end) == _FOOT_DEG else "crease" for end in (low, high)]
    which = f"each {ends[0]}" if ends[0] == ends[1] else "each end"
    beyond = f"; {table.beyond} more beyond {which} continues it smoothly (extension)" if table.beyond else ""
    return [
        f"face: {table.face.name}, drawn along y: this profile at every y; {side_phrase(table.face)}",
        f"nodes: even in the angle from z towards +x, seen from the origin: {low:.12g} + {high - low:.12g} k / {cells} "
        f"degrees; spacing up to {table.spacing_mm:.4g} mm",
        f"extent: from {ends[0]} to {ends[1]}, angles {low:.6g} to {high:.6g}{beyond}",
        "nx, nz: the unit normal n from the material into the air, ny = 0; the centre of a ball of radius R is p + R n",
        f"interpolation: of x and z over the angle, {_OVER_ANGLE[request.interpolation]}",
        f"interpolation error: at most {rounded_up(error_nm, 3)} nm along the normal against the exact profile, at "
        f"{cells} middles of cells",
    ]
