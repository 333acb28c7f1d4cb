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
from lensforge.shop.offset_face import OffsetFace

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
