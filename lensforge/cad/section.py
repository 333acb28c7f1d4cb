"""Axial sections of the body: closed outlines of its material, in (position across the axis, z), mm.

Lens and built-in bases are cut in closed form, a base from a STEP file by its mesh.
"""

from collections.abc import Iterator, Sequence
from math import sqrt

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import Boundary
from lensforge.cad.cutter_room import lens_plan
from lensforge.cad.flange import ring_of
from lensforge.cad.plan import Corner, Plan, base_corners, rim_directions
from lensforge.optics.face_roles import BODY, CAVITY
from lensforge.scene.lens import Lens
from lensforge.scene.section_arcs import FaceArc
from lensforge.spec import BaseSection
from lensforge.surfaces.surface import Surface

Curve = Float[np.ndarray, "n 2"]

_DRAWN_ANGLES = 721
_ALONG = 1e-9  # part of a direction across y below which a plane lies along y
_DRAWN_MM = 1e-3  # last digit of a drawn size: sections that differ by less are the same


def body_outlines(lens: Lens, azimuth_deg: float) -> list[Curve]:
    """Outlines of the body in the plane through the axis at ``azimuth_deg``; positions on that side are positive.

    Raises :class:`InputError` if a base's file is missing or does not hold a base.
    """
    azimuth = np.radians(azimuth_deg)
    across = rim_directions(np.array([azimuth]))[0]
    length_mm = lens.spec.lens.drawn_mm
    if length_mm is not None:
        inner, outer = (_drawn_curve(lens.body.arcs(medium), across, length_mm) for medium in (CAVITY, BODY))
        return [np.concatenate([outer, inner[::-1]])]
    plan = lens_plan(lens)
    base = plan.base
    of_file = [] if plan.base.file is None else _cut_of_file(plan.base, across)
    corners = [] if base.file is not None else base_corners(plan)[1:]  # the first is the outer rim itself
    if plan.cavity.opening is not None:
        return [*_around_opening(plan, corners, azimuth), *of_file]
    inner, outer = (profile(boundary, across) for boundary in (plan.cavity, plan.envelope))
    if (ring := ring_of(lens)) is not None:
        outer = ring.around(outer)
    if base.file is not None:
        return [np.concatenate([outer, inner[::-1]]), *of_file]
    right, left = (_at(corners, azimuth + turn) for turn in (0.0, np.pi))
    return [np.concatenate([outer, right, inner[::-1], left[::-1] * (-1.0, 1.0)]), *_cut_feet(base, azimuth_deg)]


def _drawn_curve(arcs: Sequence[FaceArc], across: Float[np.ndarray, "3"], length_mm: float) -> Curve:
    """The faces that are drawn along y and bound a medium, in the plane through z and ``across``, from end to end."""
    polar = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _DRAWN_ANGLES)
    if abs(across[0]) > _ALONG:
        creases = np.arctan(np.tan([arc.high_rad for arc in arcs[:-1]]) / across[0])
        polar = np.unique(np.concatenate([polar, creases]))
    plane = np.column_stack([np.sin(polar), np.cos(polar)])
    directions = plane[:, :1] * across + plane[:, 1:] * np.array([0.0, 0.0, 1.0])
    ends = np.abs(directions[:, 1]) * 2.0 / length_mm
    reciprocals = np.max([ends, *(arc.face.value(directions) for arc in arcs)], axis=0)
    return plane / reciprocals[:, None]


def _cut_feet(base: BaseSection, azimuth_deg: float) -> list[Float[np.ndarray, "4 2"]]:
    """The feet in the section through the axis at ``azimuth_deg``: (position across, z) in mm of their corners."""
    if base.feet is None:
        return []
    turn = np.radians(azimuth_deg)
    outlines = list[np.ndarray]()
    ends = [(-base.height_mm, base.foot_radii_mm[0]), (-base.seat_mm, base.foot_radii_mm[1])]
    for x, y in base.feet.places_mm:
        across = x * np.cos(turn) + y * np.sin(turn)
        away = y * np.cos(turn) - x * np.sin(turn)
        if abs(away) < base.foot_radii_mm[0]:
            halves = [(z, sqrt(max(radius**2 - away**2, 0.0))) for z, radius in ends]
            left, right = ([(across + sign * half, z) for z, half in halves] for sign in (-1.0, 1.0))
            outlines.append(np.array([left[0], *right, left[1]]))
    return outlines


def _around_opening(plan: Plan[Surface], corners: list[Corner], azimuth: float) -> Iterator[Curve]:
    """An outline on each side of the axis, from the rim of the opening around the base and back."""
    for sign, turn in ((1.0, azimuth), (-1.0, azimuth + np.pi)):
        inner, outer = (_from_opening(boundary, turn) for boundary in (plan.cavity, plan.envelope))
        yield np.concatenate([outer, _at(corners, turn), inner[::-1]]) * (sign, 1.0)


def _from_opening(boundary: Boundary[Surface], azimuth: float, count: int = 181) -> Curve:
    """The curve at one azimuth from the opening to the rim: (distance from the axis, z) in mm."""
    turn = np.array([azimuth])
    rims = [
        2.0 * np.arctan(crease.radius(turn)) for crease in (boundary.opening, *boundary.creases) if crease is not None
    ]
    polar = np.unique(np.concatenate([np.linspace(float(rims[0][0]), 0.5 * np.pi, count), *rims]))
    plane = np.column_stack([np.sin(polar), np.cos(polar)])
    plane[-1, 1] = 0.0  # the rim lies in z = 0 exactly
    directions = np.column_stack([plane[:, :1] * rim_directions(turn)[:, :2], plane[:, 1]])
    return boundary.radius(directions)[:, None] * plane


def other_section_deg(lens: Lens) -> float | None:
    """Azimuth (degrees) of a second section that differs from that at 0; None for a part of revolution."""
    first = body_outlines(lens, 0.0)
    for azimuth_deg in (90.0, 45.0):
        outlines = body_outlines(lens, azimuth_deg)
        if [outline.shape for outline in outlines] != [outline.shape for outline in first]:
            return azimuth_deg
        if any(np.abs(a - b).max() > _DRAWN_MM for a, b in zip(first, outlines, strict=True)):
            return azimuth_deg
    return None


def _at(corners: list[Corner], azimuth: float) -> Curve:
    """Distance from the axis and z of corners of the base on one side of the section."""
    turn = np.array([azimuth])
    return np.array([(float(corner.radius(turn)[0]), -corner.depth_mm) for corner in corners]).reshape(-1, 2)


def profile(boundary: Boundary[Surface], across: Float[np.ndarray, " 3"], count: int = 361) -> Curve:
    """The curve in the section through the axis and ``across``, rim to rim: (position across, z) in mm.

    Its points are equally spaced in angle, and at creases.
    """
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count)
    azimuth = np.arctan2(across[1], across[0]) + np.array([0.0, np.pi])
    corners = [2.0 * np.arctan(crease.radius(azimuth)) * (1.0, -1.0) for crease in boundary.creases]
    theta = np.sort(np.concatenate([theta, *corners]))
    polar = np.column_stack([np.sin(theta), np.cos(theta)])
    polar[[0, -1], 1] = 0.0  # the rim lies in z = 0 exactly
    directions = polar[:, :1] * across + polar[:, 1:] * np.array([0.0, 0.0, 1.0])
    return boundary.radius(directions)[:, None] * polar


def _cut_of_file(base: BaseSection, across: Float[np.ndarray, " 3"]) -> list[Curve]:
    import trimesh

    from lensforge.cad.custom_base import mesh_of_base

    assert base.file is not None
    mesh = trimesh.Trimesh(*mesh_of_base(base.file), process=False)
    cut = mesh.section(plane_origin=np.zeros(3), plane_normal=np.cross([0.0, 0.0, 1.0], across))
    return [] if cut is None else [np.column_stack([line @ across, line[:, 2]]) for line in cut.discrete]
