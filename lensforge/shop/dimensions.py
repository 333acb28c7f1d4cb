"""Dimensions of the lens and its base: one list without duplicates for the drawing, its DXF and the table.

All are of the exact surfaces, and a dimension that is drawn has its two ends on the part. The base of a STEP file is
measured in the section; its own file defines it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import WHOLE, Boundary, Crease, Domain, StarShaped, lens_boundaries
from lensforge.cad.cutter_room import lens_plan
from lensforge.cad.flange import ring_of
from lensforge.cad.outline import FULL_TURN
from lensforge.cad.plan import Plan, rim_radius
from lensforge.cad.section import body_outlines, other_section_deg
from lensforge.optics.face_roles import DOUBLE
from lensforge.results.refined_maximum import refined_maximum
from lensforge.scene.lens import Lens
from lensforge.shop.profile_table import is_round
from lensforge.spec import BaseSection
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface, to_chart, to_sphere

FLANGE_WIDTH = "diameter of the rim's flange"
RIM_WIDTH = "outer rim in z = 0, along x"
_SAME_MM = 1e-3  # the last digit of a drawing
_SAMPLES = 5_000  # samples 1.8 degrees apart
_REACH = 0.02  # in the chart as here
_ALONG_CREASE = 3601  # azimuths: 0.1 degrees apart
_AXIS = np.array([[0.0, 0.0, 1.0]])

Measured = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]
Scope = Literal["axis", "section", "second", "largest", "part", "flange", "base", "length"]
SCOPES: dict[Scope, str] = {
    "axis": "on the axis",
    "section": "in the section S–S",
    "second": "in the section T–T",
    "largest": "largest about the axis",
    "part": "of the whole part",
    "flange": "of the flange, all around",
    "base": "of the base, all around",
    "length": "from end to end",
}
ViewName = Literal["S", "T", "base", "dome"]
_SCOPE_OF: dict[ViewName, Scope] = {"S": "section", "T": "second"}
Ends = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Dimension:
    """A dimension (mm) with its name; ``scope``: the places that it covers.

    ``ends``: two places in ``view``: (z, across) in a section, (y, x) seen from the base, (-y, x) in the view of the
    dome; None if it is not drawn. ``upright``: measured across the axis in a section. ``sign``: "⌀" or "□" before the
    number. ``tolerance_mm``: plus and minus.
    """

    name: str
    value_mm: float
    scope: Scope
    ends: Ends | None = None
    view: ViewName = "S"
    upright: bool = False
    sign: str = ""
    tolerance_mm: float | None = None

    @property
    def scope_phrase(self) -> str:
        """Phrase for the places that it covers."""
        return SCOPES[self.scope]

    @property
    def tolerance(self) -> str:
        """Its own tolerance, "auxiliary", or "general"."""
        if self.tolerance_mm is not None:
            return f"±{self.tolerance_mm:.3f}"
        return "auxiliary" if self.is_auxiliary else "general"

    @property
    def is_auxiliary(self) -> bool:
        """True for a size that follows from others or from a freeform face: in parentheses, as the STEP defines it."""
        return self.scope not in ("base", "flange", "length") and self.tolerance_mm is None

    def repeats(self, other: "Dimension") -> bool:
        """True if ``other`` measures the same length between the same places: equal circles, or the same planes of z.

        A circle of base or flange is kept beside others, but repeats the largest width of the part.
        """
        if self.ends is None or other.ends is None or not self.is_auxiliary:
            return False
        if self.sign == other.sign == "⌀":
            as_one = other.is_auxiliary or self.scope in ("largest", "part")
            return as_one and abs(self.value_mm - other.value_mm) < _SAME_MM
        if self.sign or other.sign or (self.view, self.upright) != (other.view, other.upright):
            return False
        across = int(self.upright)
        places, other_places = (sorted(end[across] for end in ends) for ends in (self.ends, other.ends))
        return bool(np.abs(np.subtract(places, other_places)).max() < _SAME_MM)


def dimensions(lens: Lens) -> list[Dimension]:
    """Dimensions of the lens, of its base and of the whole part."""
    every = [*_lens_dimensions(lens), *_flange_dimensions(lens), *_base_dimensions(lens), *_part_dimensions(lens)]
    return without_repeats(every)


def without_repeats(every: Sequence[Dimension]) -> list[Dimension]:
    """All of these; of equal ones one is drawn: preferably a toleranced one, else one in a section."""
    drawn: list[Dimension] = []
    order = sorted(every, key=lambda size: (size.is_auxiliary, size.scope in ("largest", "part")))
    for dimension in order:
        if not any(dimension.repeats(kept) for kept in drawn):
            drawn.append(dimension)
    return [dimension if dimension in drawn else replace(dimension, ends=None) for dimension in every]


def _lens_dimensions(lens: Lens) -> Iterator[Dimension]:
    cavity, envelope = lens_boundaries(lens)
    on_axis = [] if cavity.opening is not None else list(_on_axis(lens, cavity, envelope))
    yield from on_axis[:1]
    yield Dimension("highest point above z = 0", float(highest_point_mm(envelope)[2]), "largest")
    yield from on_axis[1:]
    yield _circle(
        f"width of the {'dome' if envelope.faces[0].name == DOUBLE[-1] else 'lens'}", widest_mm(envelope), "largest"
    )
    sign = "⌀" if is_round(lens) else ""
    second_deg = other_section_deg(lens)
    sections = list[tuple[float, ViewName]]([(0.0, "S")])
    if second_deg is not None:
        sections.append((second_deg, "T"))
    for name, boundary in (("outer rim", envelope), ("opening of the cavity", cavity)):
        yield from (replace(_rim_in_section(name, boundary, *section), sign=sign) for section in sections)
    for boundary in (envelope, cavity):
        for (inner, outer), crease in zip(pairwise(boundary.faces), boundary.creases, strict=True):
            for section in sections:
                width, height = _crease_in_section(f"crease of {inner.name} and {outer.name}", crease, *section)
                yield from (replace(width, sign=sign), height)


def apex_title(face: str) -> str:
    """Words for the place in which a face of the envelope meets the axis."""
    return "outer apex" if face == DOUBLE[-1] else f"apex of the {face}"


def _on_axis(lens: Lens, cavity: Boundary[Surface], envelope: Boundary[Surface]) -> Iterator[Dimension]:
    """Heights of both apexes, and the thickness between them."""
    gap = lens.spec.part_tolerances.amount(envelope.faces[0].name, "gap_mm")
    low, high = (float(boundary.radius(_AXIS)[0]) for boundary in (cavity, envelope))
    side = -float(rim_radius(envelope)(np.array([np.pi]))[0])
    yield Dimension(f"{apex_title(envelope.faces[0].name)} above z = 0", high, "axis", ((0.0, side), (high, 0.0)))
    yield Dimension("apex of the cavity above z = 0", low, "axis", ((0.0, side), (low, 0.0)))
    ends = (low, 0.0), (high, 0.0)
    yield Dimension("thickness on the axis", high - low, "axis", ends, tolerance_mm=gap or None)


def _flange_dimensions(lens: Lens) -> Iterator[Dimension]:
    """Sizes of the flange at the exit's rim, and its heights over z = 0 and the cavity."""
    ring = ring_of(lens)
    flange = lens.spec.lens.rim_flange
    if ring is None or flange is None:
        return
    side = ring.outer_mm
    foot = ring.foot_mm
    low = ring.low_mm
    high = ring.high_mm
    stated = flange.tolerance_mm
    cap = float(lens_boundaries(lens)[0].radius(_AXIS)[0])
    for name, length_mm, ends in (
        ("thickness of the rim's flange", high - low, ((low, -foot), (high, -side))),
        ("underside of the rim's flange above z = 0", low, ((0.0, -foot), (low, -foot))),
        ("apex of the cavity to the rim's flange", abs(low - cap), ((cap, 0.0), (low, -foot))),
    ):
        yield Dimension(name, length_mm, "flange", ends, tolerance_mm=stated)
    ends = (high, -side), (high, side)
    yield Dimension(FLANGE_WIDTH, 2.0 * side, "flange", ends, upright=True, sign="⌀", tolerance_mm=stated)


def widest_mm(surface: StarShaped, domain: Domain = WHOLE) -> float:
    """Diameter (mm) of the cylinder about the axis that encloses ``surface``, or its part over ``domain``."""
    point = _farthest(surface, lambda points: np.hypot(points[:, 0], points[:, 1]), domain)
    return 2.0 * float(np.hypot(*point[:2]))


def _circle(name: str, width_mm: float, scope: Scope) -> Dimension:
    """Diameter (mm) of a circle about the axis in the view of the dome."""
    half = width_mm / 2.0
    return Dimension(name, width_mm, scope, ((-half, 0.0), (half, 0.0)), "dome", sign="⌀")


def _rim_in_section(name: str, surface: StarShaped, azimuth_deg: float, view: ViewName) -> Dimension:
    right, left = rim_radius(surface)(np.radians(azimuth_deg) + np.array([0.0, np.pi])).tolist()
    ends = (0.0, -left), (0.0, right)
    return Dimension(f"{name} in z = 0, {_along(azimuth_deg)}", left + right, _SCOPE_OF[view], ends, view, upright=True)


def _crease_in_section(name: str, crease: Crease, azimuth_deg: float, view: ViewName) -> Iterator[Dimension]:
    points = crease.points(np.radians(azimuth_deg) + np.array([0.0, np.pi]))
    (high, low) = points[:, 2].tolist()
    (right, left) = np.hypot(points[:, 0], points[:, 1]).tolist()
    label = f"{name}, {_along(azimuth_deg)}"
    scope = _SCOPE_OF[view]
    yield Dimension(label, left + right, scope, ((low, -left), (high, right)), view, upright=True)
    yield Dimension(f"{label}, above z = 0", high, scope, ((0.0, right), (high, right)), view)


def _along(azimuth_deg: float) -> str:
    return {0.0: "along x", 90.0: "along y"}.get(azimuth_deg, f"at {azimuth_deg:g}°")


def _part_dimensions(lens: Lens) -> Iterator[Dimension]:
    """Length and width of the part with its base, the length from the bottom to the highest point of the dome."""
    base = lens_plan(lens).base
    envelope = lens_boundaries(lens)[1]
    across, _, highest = highest_point_mm(envelope).tolist()
    bottom = 0.0
    side = -float(rim_radius(envelope)(np.array([np.pi]))[0])
    wide = widest_mm(envelope)
    if base.file is not None:
        from lensforge.cad.custom_base import mesh_of_base

        vertices, _ = mesh_of_base(base.file)
        lowest = vertices[np.argmin(vertices[:, 2])]
        bottom = float(lowest[2])
        side = float(lowest[0])
        wide = max(wide, 2.0 * float(np.hypot(vertices[:, 0], vertices[:, 1]).max()))
    elif base.kind != "none":
        bottom = -base.seat_mm
        side = -_half_width(base)
        wide = max(wide, (2.0**0.5 if base.kind == "square" else 1.0) * 2.0 * _half_width(base))
        wide = max(wide, base.flange_diameter_mm or 0.0)
    wide = max(wide, 0.0 if (ring := ring_of(lens)) is None else 2.0 * ring.outer_mm)
    yield Dimension("overall length", highest - bottom, "part", ((bottom, side), (highest, across)))
    yield _circle("largest width", wide, "part")


def highest_point_mm(surface: StarShaped) -> Float[np.ndarray, " 3"]:
    """Highest point (mm) of ``surface``, which need not be its apex."""
    return _farthest(surface, lambda points: points[:, 2])


def _farthest(surface: StarShaped, measured: Measured, domain: Domain = WHOLE) -> Float[np.ndarray, " 3"]:
    """Point (mm) of ``surface`` over ``domain`` and its edge with the largest ``measured``, refined between samples."""

    def points(chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        directions = to_sphere(chart)
        return np.asarray(surface.radius(directions)[:, None] * directions)

    def figure(chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        return measured(points(chart))

    chart = to_chart(np.concatenate([_AXIS, fibonacci_hemisphere(_SAMPLES)]))
    chart = domain.within(chart) if domain.edges else chart
    place, most = refined_maximum(figure, chart, figure(chart), _REACH, rounds=24, within=domain.within)
    farthest = points(place[None])[0]
    for crease in surface.creases if isinstance(surface, Boundary) else ():  # where it bends, and often is widest
        along = crease.points(np.linspace(0.0, FULL_TURN, _ALONG_CREASE))
        best = int(np.argmax(measured(along)))
        if measured(along)[best] > most:
            farthest = along[best]
            most = float(measured(along)[best])
    return np.asarray(farthest)


def _base_dimensions(lens: Lens) -> list[Dimension]:
    plan = lens_plan(lens)
    if plan.base.file is not None:
        return list(_in_section_of_file(lens))
    return [*_depths(plan), *_widths(plan), *_feet(plan.base)] if plan.has_base else []


def _depths(plan: Plan[Surface]) -> Iterator[Dimension]:
    """Lengths of a built-in base along the axis."""
    base = plan.base
    bottom = -plan.base.height_mm
    half = _half_width(plan.base)
    yield Dimension("height of the base below z = 0", base.height_mm, "base", ((bottom, -half), (0.0, -half)))
    if plan.relief_mm > 0.0:
        ends = (-plan.relief_mm, -half), (0.0, -half)
        yield Dimension("depth of the relief step below z = 0", plan.relief_mm, "base", ends)
    for name, length_mm, diameter_mm in (
        ("depth of the pocket", base.pocket_depth_mm, base.pocket_diameter_mm),
        ("height of the flange", base.flange_height_mm, base.flange_diameter_mm),
    ):
        if diameter_mm is not None:
            side = -diameter_mm / 2.0
            yield Dimension(name, length_mm, "base", ((bottom, side), (bottom + length_mm, side)))


def _feet(base: BaseSection) -> Iterator[Dimension]:
    if (feet := base.feet) is None:
        return
    x, y = feet.places_mm[0]
    half = feet.diameter_mm / 2.0
    reach = feet.circle_diameter_mm / 2.0
    label = "feet" if feet.number == 1 else f"{feet.number} feet"
    yield Dimension(f"height of the {label}", feet.height_mm, "base")
    ends = (y - half, x), (y + half, x)
    yield Dimension(f"diameter of the {label}", feet.diameter_mm, "base", ends, "base", sign="⌀")
    ends = (-reach, 0.0), (reach, 0.0)
    yield Dimension(f"circle of the {label}", feet.circle_diameter_mm, "base", ends, "base", sign="⌀")


def _half_width(base: BaseSection) -> float:
    return (base.side_mm if base.kind == "square" else base.diameter_mm) / 2.0


def _widths(plan: Plan[Surface]) -> Iterator[Dimension]:
    base = plan.base
    half = _half_width(plan.base)
    upright = not plan.base.draft_deg
    foot = -plan.shoulder_mm if upright else -plan.relief_mm  # where a drafted side is as wide as stated
    if base.kind == "square":
        yield Dimension(
            "side of the base across x", 2.0 * half, "base", ((foot, -half), (foot, half)), upright=True, sign="□"
        )
        yield Dimension("side of the base across y", 2.0 * half, "base", ((-half, -half), (half, -half)), "base")
    elif base.flat_mm is None:
        yield Dimension(
            "diameter of the base", 2.0 * half, "base", ((foot, -half), (foot, half)), upright=True, sign="⌀"
        )
    else:  # the flat takes a piece from the section
        yield Dimension("diameter of the base", 2.0 * half, "base", ((-half, 0.0), (half, 0.0)), "base", sign="⌀")
        ends = (foot, 0.0), (foot, base.flat_mm)
        yield Dimension("clocking flat across +x, from the axis", base.flat_mm, "base", ends, upright=True)
    for name, z, circle in (
        ("diameter of the step's wall", 0.0, plan.ring),
        ("diameter of the bore", -plan.bore_mm if upright else 0.0, plan.bore),
        ("diameter of the pocket", -base.height_mm if upright else -plan.bore_mm, plan.pocket),
        ("diameter of the flange", -base.height_mm if upright else -plan.shoulder_mm, plan.flange),
    ):
        if circle is not None:
            radius = float(circle.radius(np.zeros(1))[0])
            yield Dimension(name, 2.0 * radius, "base", ((z, -radius), (z, radius)), upright=True, sign="⌀")


def _in_section_of_file(lens: Lens) -> Iterator[Dimension]:
    outlines = body_outlines(lens, 0.0)[1:]  # the first is that of the lens
    if not outlines:
        return
    below = np.concatenate(outlines)
    low = below[np.argmin(below[:, 1])]
    left = below[np.argmin(below[:, 0])]
    right = below[np.argmax(below[:, 0])]
    ends = (float(low[1]), float(low[0])), (0.0, float(low[0]))
    yield Dimension("base below z = 0, in the section", -ends[0][0], "section", ends)
    across = (float(left[1]), float(left[0])), (float(right[1]), float(right[0]))
    yield Dimension("base along x, in the section", across[1][1] - across[0][1], "section", across, upright=True)
