"""Limits that no lens can keep together, refused where the spec is made: on the meridian, in closed form.

Of all inner surfaces that keep the limits there is a smallest one: the paraboloid of the cavity or, where that is
steeper than the draft allows, a cone from where the two touch. A face with draft ``d`` is a height over the plane
z = 0 whose slope is nowhere above ``cot d``, so that outwards from any of its points, at height z, it reaches the
plane no earlier than ``z tan d`` further out. Lenses of any symmetry keep to these bounds.
"""

from collections.abc import Iterator
from math import radians, sin, tan

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY
from lensforge.spec.face_section import FlangeSection
from lensforge.spec.fixed_surface import FixedFace
from lensforge.spec.lens_section import LensShape
from lensforge.spec.part_section import BaseSection, ManufactureSection
from lensforge.spec.processes import PROCESSES, Process
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import rounded_up

_POLAR = np.linspace(0.0, 0.5 * np.pi, 2001)  # rad, from the axis to the horizon
_SHAPE_TOLERANCE = 1e-3  # of a concave radius, and of the sine of a draft: what the search's own limits tolerate

_Meridian = Float[np.ndarray, " k"]


def require_feasible(lens: LensShape, limits: ConstraintsSection, manufacture: ManufactureSection) -> None:
    """Raise ``ValueError`` where no lens keeps all limits: the fields, their values, and what is allowed."""
    _require_below_glass(lens, limits)
    if limits.min_edge_angle_deg is not None and not lens.has_creases:
        raise ValueError(
            f"constraints.min_edge_angle_deg = {limits.min_edge_angle_deg:g}: the faces of a lens of kind "
            f"{lens.kind!r} meet in no edge; leave it out, or take lens.kind = 'tir'"
        )
    if lens.rim_flange is not None:
        _require_around_lens(lens.rim_flange, limits)
    if lens.has_creases:
        return  # its start, and its faces together, are checked where they are made
    for name, face in lens.faces.items():
        for fault in () if face.fixed is None else _faults(lens, name, face.fixed, limits, manufacture):
            raise ValueError(f"lens.{name}.fixed {fault}; change the limit, or choose another surface")
    outer = lens.names[-1]
    if (fixed := lens.faces[outer].fixed) is not None:
        _require_room_for_wall(outer, fixed, limits, smallest_cavity_mm(lens, limits))


def _require_below_glass(lens: LensShape, limits: ConstraintsSection) -> None:
    highest = lens.highest_mm(limits)
    if lens.cover_glass is not None and lens.cover_glass.distance_mm < highest:
        raise ValueError(
            f"lens.cover_glass.distance_mm = {lens.cover_glass.distance_mm:g}: the lens may be {highest:g} mm high "
            "(constraints.max_radius_mm, max_height_mm); move the glass away"
        )


def _require_around_lens(flange: FlangeSection, limits: ConstraintsSection) -> None:
    if flange.diameter_mm <= 2.0 * limits.max_radius_mm:
        raise ValueError(
            f"lens.flange.diameter_mm = {flange.diameter_mm:g}: must exceed that of the lens, twice "
            f"constraints.max_radius_mm: above {2.0 * limits.max_radius_mm:g}"
        )
    if limits.max_height_mm is not None and flange.room_mm >= limits.max_height_mm:
        raise ValueError(
            f"lens.flange.thickness_mm = {flange.thickness_mm:g}: with its setbacks it must be below "
            f"constraints.max_height_mm = {limits.max_height_mm:g}"
        )


def smallest_cavity_mm(lens: LensShape, limits: ConstraintsSection) -> _Meridian:
    """Distance (mm) of the smallest inner surface from the origin, from the axis to the horizon.

    That of a fixed one is its own, the least all around.
    """
    cavity = [lens.faces[role.name].fixed for role in lens.roles if (role.before, role.behind) == (CAVITY, BODY)]
    if all(fixed is not None for fixed in cavity):
        return np.min([fixed.shape.least_mm(_POLAR) for fixed in cavity if fixed is not None], axis=0)
    height = limits.cavity_height_mm
    radius = limits.cavity_radius_mm
    sine = np.sin(_POLAR)
    cosine = np.cos(_POLAR)
    paraboloid: _Meridian = 2.0 * height / (cosine + np.sqrt(cosine**2 + (2.0 * height / radius * sine) ** 2))
    first = lens.roles[0]
    tangent = 0.0 if first.widens else tan(radians(lens.faces[first.name].draft_deg or 0.0))
    if 2.0 * height * tangent <= radius:  # its steepest slope, at the rim, has the draft
        return paraboloid
    touches_mm = radius**2 / (2.0 * height * tangent)
    rim_mm = 0.5 * touches_mm + height * tangent
    cone: _Meridian = rim_mm / (sine + cosine * tangent)
    return np.where(paraboloid * sine <= touches_mm, paraboloid, cone)


def _faults(
    lens: LensShape, name: str, fixed: FixedFace, limits: ConstraintsSection, manufacture: ManufactureSection
) -> Iterator[str]:
    """Limits that a surface breaks which the search does not change, in words."""
    of_cavity = lens.role(name).before == CAVITY
    face = lens.faces[name]
    shape = fixed.shape
    wall = limits.min_thickness_mm if of_cavity else 0.0
    under = f" under a wall of constraints.min_thickness_mm = {wall:g}" if wall else ""
    reached = float(shape.radii_mm.max()) + wall
    if reached > limits.max_radius_mm + limits.tolerance_mm:
        yield (
            f"reaches {reached:.6g} mm from the origin{under}, constraints.max_radius_mm = {limits.max_radius_mm:g}: "
            f"at least {rounded_up(reached)}"
        )
    height = float(((shape.largest_mm(_POLAR) + wall) * np.cos(_POLAR)).max())
    if limits.max_height_mm is not None and height > limits.max_height_mm + limits.tolerance_mm:
        yield (
            f"reaches {height:.6g} mm above z = 0{under}, constraints.max_height_mm = {limits.max_height_mm:g}: at "
            f"least {rounded_up(height)}"
        )
    inside = shape.clearance_mm(limits.cavity_height_mm, limits.cavity_radius_mm)
    if of_cavity and inside < -limits.tolerance_mm:
        yield (
            f"cuts {-inside:.3g} mm into the paraboloid of constraints.cavity_height_mm = {limits.cavity_height_mm:g} "
            f"and cavity_radius_mm = {limits.cavity_radius_mm:g}"
        )
    draft = face.draft_deg
    ball = face.concave_radius_mm
    if draft is not None and sin(radians(shape.least_draft_deg)) < sin(radians(draft)) - _SHAPE_TOLERANCE:
        yield f"has a draft of {shape.least_draft_deg:.3g} deg at least, lens.{name}.draft_deg = {draft:g}"
    turned = manufacture.making.cutting(lens.is_revolved(name)) == "turned"
    least, most = shape.meridian_curvatures_per_mm if turned else shape.curvatures_per_mm
    concave = most if of_cavity == (manufacture.cuts != "inserts") else -least  # of a convex body: where the air is
    if ball is not None and concave * ball > 1.0 + _SHAPE_TOLERANCE:
        yield f"has a concave radius of {1.0 / concave:.4g} mm, lens.{name}.concave_radius_mm = {ball:g}"


def _require_room_for_wall(name: str, outer: FixedFace, limits: ConstraintsSection, inner: _Meridian) -> None:
    wall = limits.min_thickness_mm
    room = outer.shape.least_mm(_POLAR) - wall - inner
    worst = int(room.argmin())
    if room[worst] < -limits.tolerance_mm:
        raise ValueError(
            f"lens.{name}.fixed leaves no room for the wall: {np.degrees(_POLAR[worst]):.3g} deg from the axis "
            f"they reach {inner[worst] + wall:.4g} mm from the origin (constraints.cavity_height_mm = "
            f"{limits.cavity_height_mm:g}, cavity_radius_mm = {limits.cavity_radius_mm:g}, min_thickness_mm = "
            f"{wall:g}), the surface is at {inner[worst] + wall + room[worst]:.4g}; lower one of the three"
        )


def require_base_around_cavity(lens: LensShape, limits: ConstraintsSection, base: BaseSection) -> None:
    """Raise :class:`InputError` where the smallest cavity opens wider than the base: for a part, not for its light."""
    if base.kind in ("none", "step"):
        return
    name = lens.names[0]
    fixed = lens.faces[name].fixed
    opening_mm = float((smallest_cavity_mm(lens, limits) if fixed is None else fixed.shape.largest_mm(_POLAR))[-1])
    cause = "the cavity of constraints.cavity_radius_mm" if fixed is None else f"lens.{name}.fixed"
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


def require_drawn_over_plate(lens: LensShape, manufacture: ManufactureSection) -> None:
    """Raise ``ValueError`` for a face that no mould half releases, as the plate lies below it and it faces that."""
    if (hidden := lens.drawn_from_below) is not None and manufacture.process == "moulded":
        raise ValueError(
            f"plate: the {hidden} of lens.kind = {lens.kind!r} widens above it, and neither mould half releases it; "
            "give the lens a [lens.flange] at its rim instead of [plate], or take lens.kind = 'double', or "
            "manufacture.process = 'printed'"
        )


def base_warnings(lens: LensShape, limits: ConstraintsSection, base: BaseSection, process: Process | None) -> list[str]:
    """A line on a base as wide as the lens under a face that a half of the mould or a tool reaches from below."""
    hidden = lens.drawn_from_below
    cut = process is not None and PROCESSES[process].comes_from_below
    if hidden is None or not cut or base.kind in ("none", "step") or base.widest_mm < 2.0 * limits.max_radius_mm:
        return []
    return [
        f"base: the {hidden} of lens.kind = {lens.kind!r} widens above it, where neither a tool nor a mould reaches it "
        f"from below; try base.kind = 'none', or a base narrower than the {hidden} at z = 0"
    ]
