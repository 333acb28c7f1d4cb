"""Text of the tables of points: dense tables, clouds with normals, and rings for a measuring machine.

A dense table begins with lines that start with # and say all that is needed to read them, then names of columns, then
rows. A cloud, for programs that read no table with a head (five-axis milling, turning with a slow tool, measuring
machines), has ``x y z i j k``, a line for each point, mm, no first lines; its points are the nodes of the polar table,
rim included. The rings for a measuring machine are every 2.5 degrees of polar angle, their points every 5 degrees of
azimuth, all of the exact surfaces.
"""

import numpy as np
from jaxtyping import Float

from lensforge.cad.part import Part
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check
from lensforge.shop.interpolation import BEYOND, WORDS
from lensforge.shop.offset_face import OffsetFace
from lensforge.shop.point_grids import GridRequest, MeasuredGrid, Polar, Raster
from lensforge.spec.spec_section import rounded_up

_RASTER_COLUMNS, _POLAR_COLUMNS = "x_mm,y_mm,z_mm", "polar_deg,azimuth_deg,r_mm,z_mm"


def file_name(grid: Raster | Polar) -> str:
    """Name of the table's file."""
    return f"grid_{'raster' if isinstance(grid, Raster) else 'polar'}_{grid.face.name}.csv"


def origin_lines(lens: Lens, part: Part) -> list[str]:
    """Lines on the lens, its files, and who has made them."""
    signature = part.signature
    return [
        f"lens: {lens.spec.name}, SHA-256 {lens.sha256}",
        f"author: {signature.author or 'not stated'}; organisation: {signature.organisation or 'not stated'}; "
        f"date: {signature.date or 'not stated'}; by lensforge {lens.version}",
        "units: mm, degrees; coordinates: those of lens.step, z = 0 the plane in which both optical faces end, z the "
        "optical axis; the azimuth counts from +x towards +y",
        scale_line(lens),
    ]


def scale_line(lens: Lens) -> str:
    """Statement of the shrinkage, and of what it applies to."""
    shop = lens.spec.manufacture
    if shop.make == "part":
        return "shrinkage: none; the points are those of the lens itself"
    return f"shrinkage: {shop.shrinkage:.12g}; the points are those of the mould, the lens times {shop.scale:.12g}"


def grid_text(measured: MeasuredGrid, lens: Lens, part: Part, request: GridRequest) -> str:
    """The table as text."""
    grid, scheme = measured.grid, request.interpolation
    lines = [*origin_lines(lens, part), *_face_lines(grid.face)]
    lines += _raster_lines(grid, request) if isinstance(grid, Raster) else _polar_lines(grid, request)
    lines += [
        f"interpolation: {WORDS[scheme]}",
        f"interpolation error: at most {rounded_up(measured.error_nm, 3)} nm along the normal against the exact face, "
        f"at {measured.measured} middles of cells and of their sides",
    ]
    columns = _RASTER_COLUMNS if isinstance(grid, Raster) else _POLAR_COLUMNS
    body = [
        ",".join(f"{value:.9f}" for value in row) for row in (np.round(grid.rows, 9) + 0.0).tolist()
    ]  # no minus zero
    return "\n".join([*(f"# {line}" for line in lines), columns, *body]) + "\n"


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


def _raster_lines(raster: Raster, request: GridRequest) -> list[str]:
    extent, scheme = raster.extent, request.interpolation
    end = "beyond it some lie below the rim"
    if extent.steep:
        end = f"beyond it some are steeper than {request.slope_deg:g} degrees"
    return [
        f"nodes: raster x = i h, y = k h with h = {raster.spacing_mm:.9g} mm, all within {extent.radius_mm:.6g} mm of "
        f"the axis, the steepest {raster.slope_deg:.2f} degrees; {end}",
        f"complete cells: within {raster.covered_mm(scheme):.6g} mm of the axis, "
        f"{100.0 * raster.covered_share(scheme):.2f} % of the face's area; the rest is in the polar table",
    ]


def _polar_lines(polar: Polar, request: GridRequest) -> list[str]:
    turns = len(polar.azimuths_deg)
    return [
        f"nodes: rings of polar angle i p with p = {polar.step_deg:.15g} degrees, seen from the origin; {turns} "
        f"azimuths k q with q = {360.0 / turns:.15g} degrees; the apex once; spacing up to {polar.spacing_mm:.4g} mm",
        f"extent: all of the face; ring {polar.rim} is at the lowest point of the rim, "
        f"{BEYOND[request.interpolation]} more and what lies below the rim continue the face smoothly (run-out)",
        "r_mm is the distance from the axis; r_mm and z_mm are interpolated over polar angle and azimuth; the ring "
        "before the apex is the first one from the other side, r_mm with the other sign",
    ]


_DIGITS = 9


def cloud_name(polar: Polar) -> str:
    """Name of the cloud's file."""
    return f"cloud_{polar.face.name}.xyz"


def cloud_text(polar: Polar) -> str:
    """The cloud as text: x, y, z (mm) and the unit normal from the material into the air."""
    rows = np.round(polar.cloud, _DIGITS) + 0.0  # no minus zero
    return "".join(" ".join(f"{value:.{_DIGITS}f}" for value in row) + "\n" for row in rows.tolist())


def cloud_facts(polar: Polar) -> str:
    """Words on the cloud, which has none in it."""
    offset = polar.face.offset_mm
    at = "on the face" if offset == 0.0 else f"{offset:g} mm off the face, into the air"
    return (
        f"{len(polar.cloud)} points {at}, the nodes of grid_polar_{polar.face.name}.csv up to the rim: x y z i j k, "
        "mm and the unit normal from the material into the air, coordinates of lens.step; no first lines"
    )


POINT_COLUMNS = "surface,x_mm,y_mm,z_mm,nx,ny,nz"
SAG_COLUMNS = "surface,polar_deg,azimuth_deg,radius_mm,departure_mm"
_POLAR_DEG, _AZIMUTH_DEG = np.arange(2.5, 90.1, 2.5), np.arange(0.0, 360.0, 5.0)


def ring_angles() -> Float[np.ndarray, "n 2"]:
    """Polar angle and azimuth (degrees) of every point of the tables, the apex first."""
    polar, azimuth = np.meshgrid(_POLAR_DEG, _AZIMUTH_DEG, indexing="ij")
    return np.concatenate([np.zeros((1, 2)), np.stack([polar.ravel(), azimuth.ravel()], axis=-1)])


def ring_directions() -> Float[np.ndarray, "n 3"]:
    """Unit directions of :func:`ring_angles`; those of the rim lie in z = 0 exactly."""
    polar, azimuth = np.radians(ring_angles()).T
    height = np.where(ring_angles()[:, 0] == 90.0, 0.0, np.cos(polar))
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), height], axis=-1)


def points_table(faces: list[OffsetFace], head: list[str]) -> str:
    """``x, y, z`` (mm) and the unit normal out of the material, a line for each point of each face as it is cut."""
    directions = ring_directions()
    lines = [*(f"# {line}" for line in head), POINT_COLUMNS]
    for face in faces:
        name, surface = face.name, face.surface
        points = surface.radius(directions)[:, None] * directions
        rows = np.concatenate([points, face.air * surface.normal(directions)], axis=1) + 0.0  # no minus zero
        lines += [name + "," + ",".join(f"{value:.9f}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def sag_table(faces: list[OffsetFace], check: Check, head: list[str]) -> str:
    """Distance from the origin and departure from the check's best-fit sphere (mm) at each angle of each face."""
    directions, angles = ring_directions(), ring_angles()
    lines = [*(f"# {line}" for line in head), SAG_COLUMNS]
    for face in faces:
        name, sphere = face.name, getattr(check, face.name).best_fit_sphere
        radius = face.surface.radius(directions)
        away = np.linalg.norm(radius[:, None] * directions - np.array(sphere.centre_mm), axis=1)
        rows = np.column_stack([angles, radius, away - sphere.radius_mm])
        lines += [f"{name},{p:.1f},{a:.1f},{r:.9f},{d:.9f}" for p, a, r, d in rows.tolist()]
    return "\n".join(lines) + "\n"
