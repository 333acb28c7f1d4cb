"""Text of the tables: lines that begin with # say all that is needed to read them, then names of columns, then rows."""

import numpy as np

from lensforge.drawings.grids import GridRequest, MeasuredGrid
from lensforge.drawings.interpolation import BEYOND, WORDS
from lensforge.drawings.offset_face import OffsetFace
from lensforge.drawings.polar import Polar
from lensforge.drawings.raster import Raster
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.spec.section import rounded_up

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
