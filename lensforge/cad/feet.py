"""Feet below the base: in the mesh of a part, and in its sections. ``cad.solid`` has them in the solid."""

from math import sqrt

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad.mesh import BodyMesh
from lensforge.cad.patch import Patch
from lensforge.cad.plan import BORE, BOTTOM, FLANGE_SIDE, FOOT_END, FOOT_SIDE, POCKET_SIDE, SIDE, Plan
from lensforge.cad.plate_mesh import MeshParts, prism
from lensforge.spec import BaseSection
from lensforge.surfaces.plane_loop import circle_at

_CHORD_MM = 2e-3  # of their circles


def with_feet(mesh: BodyMesh, plan: Plan[Patch]) -> BodyMesh:
    """The mesh of a body on the base of ``plan`` with its feet: the plane of the bottom is cut out around them."""
    feet, height_mm = plan.base.feet, plan.base.height_mm
    if feet is None:
        return mesh
    parts = MeshParts()
    parts.add_points(mesh.vertices)
    for name in mesh.names:
        if name != BOTTOM:
            parts.add_facets(name, mesh.part(name))
    outline, opening = (_loop(mesh, names) for names in ((FLANGE_SIDE, SIDE), (POCKET_SIDE, BORE)))
    tops = []
    for place in feet.places_mm:
        round_it = circle_at(place, feet.diameter_mm / 2.0)
        top, end = prism(parts, FOOT_SIDE, round_it, _CHORD_MM, height_mm, feet.height_mm, outwards=True)
        parts.add_plane(FOOT_END, end, [], up=False)
        tops.append(top)
    parts.add_plane(BOTTOM, outline, [opening, *tops], up=False)
    return parts.mesh(mesh.rings)


def _loop(mesh: BodyMesh, names: tuple[str, str]) -> Int[np.ndarray, " n"]:
    """Vertices of the bottom on the first of some faces that the mesh has, counter-clockwise."""
    beside = next(name for name in names if name in mesh.names)
    ids = np.intersect1d(mesh.part(BOTTOM), mesh.part(beside))
    return ids[np.argsort(np.arctan2(mesh.vertices[ids, 1], mesh.vertices[ids, 0]), kind="stable")]


def cut_feet(base: BaseSection, azimuth_deg: float) -> list[Float[np.ndarray, "4 2"]]:
    """The feet in the section through the axis at ``azimuth_deg``: (position across, z) in mm of their corners."""
    if base.feet is None:
        return []
    turn, found = np.radians(azimuth_deg), list[np.ndarray]()
    top, end, radius = -base.height_mm, -base.seat_mm, base.feet.diameter_mm / 2.0
    for x, y in base.feet.places_mm:
        across, away = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        if abs(away) < radius:
            half = sqrt(radius**2 - away**2)
            left, right = across - half, across + half
            found.append(np.array([(left, top), (right, top), (right, end), (left, end)]))
    return found
