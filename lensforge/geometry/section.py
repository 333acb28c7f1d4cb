"""Axial sections of the body: closed outlines of its material, in (position across the axis, z), mm.

Lens and built-in bases are cut in closed form, a base from a STEP file by its mesh.
"""

import numpy as np
from jaxtyping import Float

from lensforge.geometry.custom_base import read_custom_base, tessellated
from lensforge.geometry.outline import Outline, circle, outline_of
from lensforge.geometry.plan import FLUSH_MM, relief_ring, rim_directions
from lensforge.lens import Lens
from lensforge.spec import BaseSection
from lensforge.surfaces.surface import Surface

Curve = Float[np.ndarray, "n 2"]

_CHORD_MM = 1e-2  # of a base's curved faces: finer than a drawn line


def body_outlines(lens: Lens, azimuth_deg: float) -> list[Curve]:
    """Outlines of the body in the plane through the axis at ``azimuth_deg``; positions on that side are positive.

    Raises :class:`InputError` where a base's file is missing or does not hold a base.
    """
    azimuth = np.radians(azimuth_deg)
    across = rim_directions(np.array([azimuth]))[0]
    inner, outer = profile(lens.inner, across), profile(lens.outer, across)
    base = lens.spec.base
    if base.file is not None:
        return [np.concatenate([outer, inner[::-1]]), *_cut_of_file(base, across)]
    right, left = (_base_corners(lens, azimuth + turn) for turn in (0.0, np.pi))
    return [np.concatenate([outer, right, inner[::-1], left[::-1] * (-1.0, 1.0)])]


def profile(surface: Surface, across: Float[np.ndarray, " 3"], count: int = 361) -> Curve:
    """The surface's curve in the section through the axis and ``across``, rim to rim: (position across, z) in mm."""
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count)
    polar = np.column_stack([np.sin(theta), np.cos(theta)])
    polar[[0, -1], 1] = 0.0  # the rim lies in z = 0 exactly
    directions = polar[:, :1] * across + polar[:, 1:] * np.array([0.0, 0.0, 1.0])
    curve: Curve = surface.radius(directions)[:, None] * polar
    return curve


def _base_corners(lens: Lens, azimuth: float) -> Curve:
    """Corners of the base on one side, from the outer rim around to the foot of the bore; none without a base."""
    base = lens.spec.base
    if base.kind == "none":
        return np.empty((0, 2))
    at = np.array([azimuth])
    rim, bore = (float(surface.radius(rim_directions(at))[0]) for surface in (lens.outer, lens.inner))
    side, bottom = _at(outline_of(base), at), -base.height_mm
    corners = _seat(relief_ring(lens.inner, lens.outer, base), base, rim, side)
    if base.flange_diameter_mm is not None:
        flange, shoulder = _at(circle(base.flange_diameter_mm / 2.0), at), bottom + base.flange_height_mm
        corners += [(side, shoulder), (flange, shoulder), (flange, bottom)]
    else:
        corners.append((side, bottom))
    if base.pocket_diameter_mm is not None:
        pocket, ceiling = base.pocket_diameter_mm / 2.0, bottom + base.pocket_depth_mm
        corners += [(pocket, bottom), (pocket, ceiling), (bore, ceiling)]
    else:
        corners.append((bore, bottom))
    return np.array(corners)


def _seat(ring: Outline | None, base: BaseSection, rim: float, side: float) -> list[tuple[float, float]]:
    """Corners from the rim down the step, if there is one, and across to the base's side."""
    top = -base.relief_step_mm
    if ring is not None:
        wall = _at(ring, np.zeros(1))
        return [(wall, 0.0), (wall, top), (side, top)]
    return [] if abs(rim - side) <= FLUSH_MM else [(rim, top), (side, top)]


def _at(outline: Outline, azimuth: Float[np.ndarray, "1"]) -> float:
    return float(outline.radius(azimuth)[0])


def _cut_of_file(base: BaseSection, across: Float[np.ndarray, " 3"]) -> list[Curve]:
    import trimesh

    assert base.file is not None
    vertices, triangles = tessellated(read_custom_base(base.file).solid, _CHORD_MM)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    cut = mesh.section(plane_origin=np.zeros(3), plane_normal=np.cross([0.0, 0.0, 1.0], across))
    return [] if cut is None else [np.column_stack([line @ across, line[:, 2]]) for line in cut.discrete]
