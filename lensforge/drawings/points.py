"""Tables of an optical face for a measuring machine: points with normals, and departures from the best-fit sphere.

Both come from the exact SRBF sum, on rings about the axis: every 2.5 degrees of polar angle, 5 degrees of azimuth.
"""

import numpy as np
from jaxtyping import Float

from lensforge.lens import Lens
from lensforge.manufacturing.cut import Check

POINT_COLUMNS = "surface,x_mm,y_mm,z_mm,nx,ny,nz"
SAG_COLUMNS = "surface,polar_deg,azimuth_deg,radius_mm,departure_mm"
_POLAR_DEG, _AZIMUTH_DEG = np.arange(2.5, 90.1, 2.5), np.arange(0.0, 360.0, 5.0)
_INTO_AIR = {"inner": -1.0, "outer": 1.0}


def ring_angles() -> Float[np.ndarray, "n 2"]:
    """Polar angle and azimuth (degrees) of every point of the tables, the apex first."""
    polar, azimuth = np.meshgrid(_POLAR_DEG, _AZIMUTH_DEG, indexing="ij")
    return np.concatenate([np.zeros((1, 2)), np.stack([polar.ravel(), azimuth.ravel()], axis=-1)])


def ring_directions() -> Float[np.ndarray, "n 3"]:
    """Unit directions of :func:`ring_angles`; those of the rim lie in z = 0 exactly."""
    polar, azimuth = np.radians(ring_angles()).T
    height = np.where(ring_angles()[:, 0] == 90.0, 0.0, np.cos(polar))
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), height], axis=-1)


def points_table(lens: Lens) -> str:
    """``x, y, z`` (mm) and the unit normal out of the material, a line for each point of each face."""
    directions = ring_directions()
    lines = [POINT_COLUMNS]
    for name, sign in _INTO_AIR.items():
        surface = lens.inner if name == "inner" else lens.outer
        points = surface.radius(directions)[:, None] * directions
        rows = np.concatenate([points, sign * surface.normal(directions)], axis=1) + 0.0  # no minus zero
        lines += [name + "," + ",".join(f"{value:.9f}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def sag_table(lens: Lens, check: Check) -> str:
    """Distance from the origin and departure from the check's best-fit sphere (mm) at each angle of each face."""
    directions, angles = ring_directions(), ring_angles()
    lines = [SAG_COLUMNS]
    for name, surface, face in (("inner", lens.inner, check.inner), ("outer", lens.outer, check.outer)):
        radius, sphere = surface.radius(directions), face.best_fit_sphere
        away = np.linalg.norm(radius[:, None] * directions - np.array(sphere.centre_mm), axis=1)
        rows = np.column_stack([angles, radius, away - sphere.radius_mm])
        lines += [f"{name},{p:.1f},{a:.1f},{r:.9f},{d:.9f}" for p, a, r, d in rows.tolist()]
    return "\n".join(lines) + "\n"
