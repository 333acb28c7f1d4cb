"""Dimensions of the lens and its base for the drawing, and tables of both faces for a measuring machine.

All are of the exact surfaces; the tables are on rings about the axis, every 2.5 degrees of polar angle and 5 degrees of
azimuth.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.drawings.offset_face import OffsetFace
from lensforge.geometry.custom_base import read_custom_base, tessellated
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.outline import Outline
from lensforge.geometry.plan import lay_out
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check
from lensforge.surfaces.chart import to_chart, to_sphere
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

_SAMPLES, _STARTS = 5_000, 8  # samples 1.8 degrees apart; searches from the highest of them
_AXIS = np.array([[0.0, 0.0, 1.0]])
POINT_COLUMNS = "surface,x_mm,y_mm,z_mm,nx,ny,nz"
SAG_COLUMNS = "surface,polar_deg,azimuth_deg,radius_mm,departure_mm"
_POLAR_DEG, _AZIMUTH_DEG = np.arange(2.5, 90.1, 2.5), np.arange(0.0, 360.0, 5.0)


@dataclass(frozen=True)
class Dimension:
    """One dimension (mm) with its name."""

    name: str
    value_mm: float


def dimensions(lens: Lens) -> list[Dimension]:
    """Dimensions of the lens and of its base; the width of a rim is that of its enclosing circle about the axis."""
    turn = np.linspace(0.0, 2.0 * np.pi, 1440, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    dome = fibonacci_hemisphere(20_000)
    radius = lens.outer.radius(dome)
    inner_apex, outer_apex = (float(surface.radius(_AXIS)[0]) for surface in (lens.inner, lens.outer))
    found = [
        Dimension("height of the outer apex above A", outer_apex),
        Dimension("highest point above A", highest_point_mm(lens.outer)),
        Dimension("height of the cavity's apex above A", inner_apex),
        Dimension("thickness on the axis", outer_apex - inner_apex),
        Dimension("width of the dome", 2.0 * float((radius * np.hypot(dome[:, 0], dome[:, 1])).max())),
        Dimension("outer rim in A, outside width", 2.0 * float(lens.outer.radius(rim).max())),
        Dimension("opening of the cavity in A, outside width", 2.0 * float(lens.inner.radius(rim).max())),
    ]
    return found + _base_dimensions(lens)


def highest_point_mm(surface: Surface) -> float:
    """Largest height (mm) of ``surface`` above z = 0, which need not be at its apex, searched for between samples."""
    from scipy.optimize import minimize

    def below(chart: Float[np.ndarray, "2"]) -> float:
        direction = to_sphere(chart[None, :])
        return -float(surface.radius(direction)[0] * direction[0, 2])

    samples = np.concatenate([_AXIS, fibonacci_hemisphere(_SAMPLES)])
    heights = surface.radius(samples) * samples[:, 2]
    highest = [float(heights.max())]
    for start in to_chart(samples[np.argsort(heights)[-_STARTS:]]):
        found = minimize(below, start, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12})
        highest.append(-float(found.fun))
    return max(highest)


def _base_dimensions(lens: Lens) -> list[Dimension]:
    base = base_with_room(lens)
    if base.kind == "none":
        return []
    if base.file is not None:
        return _box_of_file(base.file)
    plan = lay_out(lens.inner, lens.outer, base)
    square = base.kind == "square"
    found = [
        Dimension(
            "side of the base" if square else "diameter of the base", base.side_mm if square else base.diameter_mm
        ),
        Dimension("height of the base below A", base.height_mm),
    ]
    for name, value in (
        ("relief step below A", base.step_mm or None),
        ("diameter of the step's wall", _diameter(plan.ring)),
        ("diameter of the bore", _diameter(plan.bore)),
        ("clocking flat, across +x, from the axis", base.flat_mm),
        ("diameter of the pocket", base.pocket_diameter_mm),
        ("depth of the pocket", base.pocket_depth_mm if base.pocket_diameter_mm else None),
        ("diameter of the flange", base.flange_diameter_mm),
        ("height of the flange", base.flange_height_mm if base.flange_diameter_mm else None),
    ):
        if value is not None:
            found.append(Dimension(name, value))
    return found


def _diameter(circle: Outline | None) -> float | None:
    return None if circle is None else 2.0 * float(circle.radius(np.zeros(1))[0])


def _box_of_file(path: Path) -> list[Dimension]:
    """Bounding box of a base from a STEP file; its round faces are tessellated to a hundredth of a millimetre."""
    vertices, _ = tessellated(read_custom_base(path).solid, 1e-2)
    sizes = np.ptp(vertices, axis=0).tolist()
    names = ("width along x", "width along y", "height below A")
    return [Dimension(f"base of {path.name}, {name}", size) for name, size in zip(names, sizes, strict=True)]


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
