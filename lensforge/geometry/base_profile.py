"""The section of the base: its corners from the outer rim around the outside, the bottom and the bore to the cavity.

Mesh, drawings and the obstacles of tools are made from the same corners. The solid has them as edges of its faces.
"""

from dataclasses import dataclass

from lensforge.geometry.arcs import Radius
from lensforge.geometry.plan import Face, Plan, rim_radius

OUTER, INNER, RIM = "OPTICAL_OUTER", "OPTICAL_INNER", "RIM"
TOP, SIDE, BOTTOM, BORE, BORE_TOP = "BASE_TOP", "BASE_SIDE", "BASE_BOTTOM", "BASE_BORE", "BORE_TOP"
RELIEF, FLANGE_TOP, FLANGE_SIDE = "BASE_RELIEF", "FLANGE_TOP", "FLANGE_SIDE"
POCKET_SIDE, POCKET_TOP = "POCKET_SIDE", "POCKET_TOP"


@dataclass(frozen=True)
class Corner:
    """A closed line around the body: its distance (mm) from the axis over azimuths, and its depth (mm) below z = 0.

    ``face``: the name of the face between it and the next corner.
    """

    radius: Radius
    depth_mm: float
    face: str


def base_corners(plan: Plan[Face]) -> list[Corner]:
    """The corners from the outer rim to the last one before the cavity's rim; the outer rim alone without a base."""
    rim = rim_radius(plan.outer)
    if not plan.has_base:
        return [Corner(rim, 0.0, RIM)]
    return [*_seat(plan, rim), *_foot(plan), *_bore(plan)]


def _seat(plan: Plan[Face], rim: Radius) -> list[Corner]:
    """The outer rim, and the wall of a step below it."""
    if plan.ring is not None:
        wall = plan.ring.radius
        return [Corner(rim, 0.0, RIM), Corner(wall, 0.0, RELIEF), Corner(wall, plan.relief_mm, TOP)]
    if plan.relief_mm > 0.0:
        return [Corner(rim, 0.0, RELIEF), Corner(rim, plan.relief_mm, TOP)]
    return [Corner(rim, 0.0, TOP)]


def _foot(plan: Plan[Face]) -> list[Corner]:
    """The side and the bottom of the base, and its flange."""
    side, height = plan.outline.radius, plan.base.height_mm
    top = Corner(side, plan.relief_mm, SIDE)
    if plan.flange is None:
        return [top, Corner(side, height, BOTTOM)]
    wide = plan.flange.radius
    shoulder = Corner(side, plan.shoulder_mm, FLANGE_TOP)
    return [top, shoulder, Corner(wide, plan.shoulder_mm, FLANGE_SIDE), Corner(wide, height, BOTTOM)]


def _bore(plan: Plan[Face]) -> list[Corner]:
    """The pocket in the bottom, and the bore."""
    corners = []
    if plan.pocket is not None:
        pocket = plan.pocket.radius
        corners += [Corner(pocket, plan.base.height_mm, POCKET_SIDE), Corner(pocket, plan.bore_mm, POCKET_TOP)]
    if plan.bore is None:
        return [*corners, Corner(rim_radius(plan.inner), plan.bore_mm, BORE)]
    return [*corners, Corner(plan.bore.radius, plan.bore_mm, BORE), Corner(plan.bore.radius, 0.0, BORE_TOP)]
