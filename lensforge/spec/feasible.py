"""Limits that no lens can keep together, refused where the spec is made: closed forms on the meridian.

Of all inner surfaces that keep the limits there is a smallest one: the paraboloid of the cavity or, where that is
steeper than the draft allows, a cone from where the two touch. A face with draft ``d`` is a height over the plane
z = 0 whose slope is nowhere above ``cot d``, so that outwards from any of its points, at height z, it reaches the
plane no earlier than ``z tan d`` further out. Lenses of any symmetry keep to these bounds.
"""

from math import cos, radians, sin, sqrt, tan

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.spec.lens_section import LensSection
from lensforge.spec.part_section import BaseSection, ManufactureSection
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import rounded_up

_POLAR = np.linspace(0.0, 0.5 * np.pi, 2001)  # rad, from the axis to the horizon
_SHAPE_TOLERANCE = 1e-3  # of a concave radius, and of the sine of a draft: what the search's own limits tolerate

_Meridian = Float[np.ndarray, " k"]


def require_feasible(lens: LensSection, limits: ConstraintsSection, manufacture: ManufactureSection) -> None:
    """Raise ``ValueError`` where no lens keeps all limits: the fields, their values, and what is allowed."""
    _require_shapes_of_fixed(lens, limits, manufacture)
    inner = smallest_inner_mm(lens, limits)
    _require_fixed_inside(lens, limits, inner)
    _require_fixed_below(lens, limits)
    _require_below_glass(lens, limits)
    if lens.fixed_outer is None:
        fixed = lens.fixed_inner
        _require_room_for_draft(limits, inner if fixed is None else fixed.shape.largest_mm(_POLAR))
    _require_room_for_ball(lens, limits, manufacture, inner)


def _require_below_glass(lens: LensSection, limits: ConstraintsSection) -> None:
    """A cover glass against the largest height that the lens may have."""
    highest = limits.max_radius_mm if limits.max_height_mm is None else min(limits.max_height_mm, limits.max_radius_mm)
    if lens.cover_glass is not None and lens.cover_glass.distance_mm < highest:
        raise ValueError(
            f"lens.cover_glass.distance_mm = {lens.cover_glass.distance_mm:g}: the lens may be {highest:g} mm high "
            "(constraints.max_radius_mm, max_height_mm); move the glass away"
        )


def smallest_inner_mm(lens: LensSection, limits: ConstraintsSection) -> _Meridian:
    """Distance (mm) of the smallest inner surface from the origin, from the axis to the horizon.

    That of a fixed one is its own, the least all around.
    """
    if lens.fixed_inner is not None:
        return lens.fixed_inner.shape.least_mm(_POLAR)
    height, radius = limits.cavity_height_mm, limits.cavity_radius_mm
    sine, cosine = np.sin(_POLAR), np.cos(_POLAR)
    paraboloid: _Meridian = 2.0 * height / (cosine + np.sqrt(cosine**2 + (2.0 * height / radius * sine) ** 2))
    tangent = tan(radians(limits.inner_draft_deg or 0.0))
    if 2.0 * height * tangent <= radius:  # its steepest slope, at the rim, has the draft
        return paraboloid
    touches_mm = radius**2 / (2.0 * height * tangent)
    rim_mm = 0.5 * touches_mm + height * tangent
    cone: _Meridian = rim_mm / (sine + cosine * tangent)
    return np.where(paraboloid * sine <= touches_mm, paraboloid, cone)


def _require_fixed_inside(lens: LensSection, limits: ConstraintsSection, inner: _Meridian) -> None:
    """Fixed surfaces against the cavity, the wall and the largest radius."""
    fixed_inner, fixed_outer = lens.fixed_inner, lens.fixed_outer
    wall, largest, tolerance = limits.min_thickness_mm, limits.max_radius_mm, limits.tolerance_mm
    if fixed_inner is not None:
        inside = fixed_inner.shape.clearance_mm(limits.cavity_height_mm, limits.cavity_radius_mm)
        if inside < 0.0:
            raise ValueError(
                f"lens.fixed_inner cuts {-inside:.3g} mm into the paraboloid of constraints.cavity_height_mm = "
                f"{limits.cavity_height_mm:g} and cavity_radius_mm = {limits.cavity_radius_mm:g}"
            )
        reached = float(fixed_inner.shape.radii_mm.max())
        if reached + wall > largest:
            raise ValueError(
                f"lens.fixed_inner reaches {reached:.6g} mm from the origin; with "
                f"constraints.min_thickness_mm = {wall:g} the lens needs a constraints.max_radius_mm of at least "
                f"{rounded_up(reached + wall)}, it is {largest:g}"
            )
    if fixed_outer is not None:
        reached = float(fixed_outer.shape.radii_mm.max())
        if reached > largest:
            raise ValueError(
                f"lens.fixed_outer reaches {reached:.6g} mm from the origin, constraints.max_radius_mm = {largest:g}"
            )
        room = fixed_outer.shape.least_mm(_POLAR) - wall - inner
        worst = int(room.argmin())
        if room[worst] < -tolerance:
            raise ValueError(
                f"lens.fixed_outer leaves no room for the wall: {np.degrees(_POLAR[worst]):.3g} deg from the axis "
                f"they reach {inner[worst] + wall:.4g} mm from the origin (constraints.cavity_height_mm = "
                f"{limits.cavity_height_mm:g}, cavity_radius_mm = {limits.cavity_radius_mm:g}, min_thickness_mm = "
                f"{wall:g}), the surface is at {inner[worst] + wall + room[worst]:.4g}; lower one of the three"
            )


def _require_fixed_below(lens: LensSection, limits: ConstraintsSection) -> None:
    """Fixed surfaces against the largest height; of free ones the section of the limits knows all."""
    if limits.max_height_mm is None:
        return
    for name, surface, wall in (
        ("lens.fixed_inner", lens.fixed_inner, limits.min_thickness_mm),
        ("lens.fixed_outer", lens.fixed_outer, 0.0),
    ):
        if surface is None:
            continue
        height = float(((surface.shape.largest_mm(_POLAR) + wall) * np.cos(_POLAR)).max())
        if height > limits.max_height_mm:
            under = f" under a wall of constraints.min_thickness_mm = {wall:g}" if wall else ""
            raise ValueError(
                f"{name}{under} reaches {height:.6g} mm above z = 0, constraints.max_height_mm = "
                f"{limits.max_height_mm:g}; make it at least {rounded_up(height)}, or choose another surface"
            )


def _require_room_for_draft(limits: ConstraintsSection, inner: _Meridian) -> None:
    """Draft of both faces against the largest radius."""
    out = inner + limits.min_thickness_mm  # along a ray from the origin the wall is no thinner than along its normal
    at_rim = out * (np.sin(_POLAR) + np.cos(_POLAR) * tan(radians(limits.outer_draft_deg or 0.0)))
    needed = float(at_rim.max())
    if needed > limits.max_radius_mm:
        drafts = [name for name in ("inner_draft_deg", "outer_draft_deg") if getattr(limits, name)]
        given = " and ".join(f"constraints.{name} = {getattr(limits, name):g}" for name in drafts)
        raise ValueError(
            f"{given}: with cavity_height_mm = {limits.cavity_height_mm:g}, cavity_radius_mm = "
            f"{limits.cavity_radius_mm:g} and min_thickness_mm = {limits.min_thickness_mm:g} the lens is at least "
            f"{rounded_up(needed)} mm in radius at z = 0, max_radius_mm = {limits.max_radius_mm:g}: raise it, or lower "
            "the draft, the cavity's height or the wall"
        )


def _require_room_for_ball(
    lens: LensSection, limits: ConstraintsSection, manufacture: ManufactureSection, inner: _Meridian
) -> None:
    """Faces that are nowhere tighter than a ball, against the largest radius: those that must be concave.

    The air side of the cavity is concave, and that of the insert which moulds the outer face.
    """
    part, wall = manufacture.make == "part", limits.min_thickness_mm
    surface, fixed = ("inner", lens.fixed_inner) if part else ("outer", lens.fixed_outer)
    field, ball = f"constraints.{surface}_concave_radius_mm", getattr(limits, f"{surface}_concave_radius_mm")
    needed_ball = manufacture.cutter_radius_mm / manufacture.scale  # in a mould it cuts faces larger by the shrinkage
    if manufacture.required and (ball is None or ball < needed_ball):
        over = " / (1 + shrinkage)" if manufacture.shrinkage else ""
        field, ball = f"manufacture.required = true, cutter_radius_mm{over}", needed_ball
    if ball is None or fixed is not None:
        return
    height = float(inner[0]) + (0.0 if part else wall)
    outer = f"constraints.max_radius_mm = {limits.max_radius_mm:g}", limits.max_radius_mm
    if lens.fixed_outer is not None:
        outer = "lens.fixed_outer", float(lens.fixed_outer.shape.least_mm(_POLAR)[-1])
    draft = getattr(limits, f"{surface}_draft_deg") or 0.0
    needed, room = least_rim_mm(height, ball, draft), outer[1] - (wall if part else 0.0)
    if needed > room:
        drafted = f" and has constraints.{surface}_draft_deg = {draft:g}" if draft else ""
        less = f" less min_thickness_mm = {wall:g}" if part else ""
        raise ValueError(
            f"{field} = {ball:g}: an {surface} face {height:g} mm high that is nowhere tighter{drafted} is at least "
            f"{rounded_up(needed)} mm in radius at z = 0, {outer[0]}{less} leaves {room:.4g}; lower the ball's radius "
            "or constraints.cavity_height_mm, or widen the lens"
        )


def least_rim_mm(height_mm: float, ball_mm: float, draft_deg: float = 0.0) -> float:
    """Least radius (mm) of the circle about the axis that holds the rim of a dome nowhere tighter than a ball.

    The dome is closed above the plane of its rim, ``height_mm`` high, concave from inside with a radius of curvature of
    at least ``ball_mm``, and its flanks have the draft. Uphill along a geodesic its slope angle falls by at most
    1/``ball_mm`` for a unit of length, so that the slope at depth s below its top is at most that of the ball at
    depth s; the dome lies outside the ball that touches its top from within, and outside the cone below it.
    """
    draft = radians(draft_deg)
    steepest_mm = ball_mm * (1.0 - sin(draft))  # depth at which the ball is as steep as the draft allows
    if height_mm <= steepest_mm:
        return sqrt(height_mm * (2.0 * ball_mm - height_mm))
    return ball_mm * cos(draft) + (height_mm - steepest_mm) * tan(draft)


def _require_shapes_of_fixed(lens: LensSection, limits: ConstraintsSection, manufacture: ManufactureSection) -> None:
    """Limits of shape on a surface that the search does not change."""
    for surface, fixed in (("inner", lens.fixed_inner), ("outer", lens.fixed_outer)):
        draft, ball = getattr(limits, f"{surface}_draft_deg"), getattr(limits, f"{surface}_concave_radius_mm")
        if fixed is None:
            continue
        found_deg = fixed.shape.least_draft_deg
        if draft is not None and sin(radians(found_deg)) < sin(radians(draft)) - _SHAPE_TOLERANCE:
            raise ValueError(
                f"constraints.{surface}_draft_deg = {draft:g}: lens.fixed_{surface} has a draft of {found_deg:.3g} deg "
                "at least, and the search does not change it; lower the limit or choose another surface"
            )
        inside = (surface == "inner") == (manufacture.make == "part")  # of a convex body: where the air is
        least, most = fixed.shape.curvatures_per_mm
        concave = most if inside else -least
        if ball is not None and concave * ball > 1.0 + _SHAPE_TOLERANCE:
            raise ValueError(
                f"constraints.{surface}_concave_radius_mm = {ball:g}: lens.fixed_{surface} has a concave radius of "
                f"{1.0 / concave:.4g} mm, and the search does not change it; lower the limit or choose another surface"
            )


def require_base_around_cavity(lens: LensSection, limits: ConstraintsSection, base: BaseSection) -> None:
    """Raise :class:`InputError` where the smallest cavity opens wider than the base: for a part, not for its light."""
    if base.kind in ("none", "step"):
        return
    fixed = lens.fixed_inner
    opening_mm = float((smallest_inner_mm(lens, limits) if fixed is None else fixed.shape.largest_mm(_POLAR))[-1])
    cause = "the cavity of constraints.cavity_radius_mm" if fixed is None else "lens.fixed_inner"
    field, width = ("side_mm", base.side_mm) if base.kind == "square" else ("diameter_mm", base.diameter_mm)
    for name, given, across in (
        (field, width, 2.0),
        ("flat_mm", base.flat_mm, 1.0),
        ("pocket_diameter_mm", base.pocket_diameter_mm, 2.0),
    ):
        if given is not None and given <= across * opening_mm:
            raise InputError(
                f"base.{name} = {given:g}: {cause} opens to a radius of {opening_mm:.4g} mm and must fit inside; "
                f"allowed: above {rounded_up(across * opening_mm)}, or try base.kind = 'none'"
            )
