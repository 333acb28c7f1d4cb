"""Dimensions of the lens and its base: one list for the drawing, its DXF and the table.

All are of the exact surfaces. A dimension that is drawn has its two ends on the part.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.geometry.custom_base import read_custom_base, tessellated
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.outline import Outline
from lensforge.geometry.plan import lay_out, rim_directions, rim_radius
from lensforge.geometry.section import body_outlines
from lensforge.lens import Lens
from lensforge.spec import BaseSection
from lensforge.surfaces.chart import to_chart, to_sphere
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

_SAMPLES, _STARTS = 5_000, 8  # samples 1.8 degrees apart; searches from the highest of them
_RIM_AZIMUTHS = 1440
_AXIS = np.array([[0.0, 0.0, 1.0]])

Scope = Literal["axis", "section", "largest", "base", "box"]
SCOPES: dict[Scope, str] = {
    "axis": "on the axis",
    "section": "in the section S–S",
    "largest": "largest about the axis",
    "base": "of the base, all around",
    "box": "of the box around the base",
}
View = Literal["section", "end"]
Ends = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Dimension:
    """One dimension (mm) with its name, and ``scope``: of which places it is.

    ``ends``: two places on the part, (z, x) in the section or (y, x) in the view of the end; None where it is not
    drawn. ``along``: the axis along which it is measured. ``sign``: "⌀" or "□" before it. ``tolerance_mm``: either way.
    """

    name: str
    value_mm: float
    scope: Scope
    ends: Ends | None = None
    along: Literal["x", "y", "z"] = "z"
    sign: str = ""
    tolerance_mm: float | None = None

    @property
    def view(self) -> View:
        """The view that shows it."""
        return "end" if self.along == "y" else "section"

    @property
    def scope_words(self) -> str:
        """Words on the places of which it is, and on its tolerance."""
        if self.is_auxiliary:
            return f"{SCOPES[self.scope]}; auxiliary"
        return SCOPES[self.scope] + ("" if self.tolerance_mm is None else f"; ±{self.tolerance_mm:.3f}")

    @property
    def is_auxiliary(self) -> bool:
        """True for a size that follows from a freeform face: it stands in parentheses, and the STEP defines it."""
        return self.scope in ("axis", "section", "largest") and self.tolerance_mm is None


def dimensions(lens: Lens) -> list[Dimension]:
    """Dimensions of the lens and of its base; those that are drawn are in the section at y = 0, or across y."""
    return [*_lens_dimensions(lens), *_base_dimensions(lens)]


def _lens_dimensions(lens: Lens) -> Iterator[Dimension]:
    inner, outer = (float(surface.radius(_AXIS)[0]) for surface in (lens.inner, lens.outer))
    gap = lens.spec.tolerances.of("gap_mm").amount
    side = -float(rim_radius(lens.outer)(np.array([np.pi]))[0])
    yield Dimension("outer apex above z = 0", outer, "axis", ((0.0, side), (outer, 0.0)))
    yield Dimension("highest point above z = 0", highest_point_mm(lens.outer), "largest")
    yield Dimension("apex of the cavity above z = 0", inner, "axis", ((0.0, side), (inner, 0.0)))
    ends = (inner, 0.0), (outer, 0.0)
    yield Dimension("thickness on the axis", outer - inner, "axis", ends, tolerance_mm=gap or None)
    dome = fibonacci_hemisphere(20_000)
    across = lens.outer.radius(dome) * np.hypot(dome[:, 0], dome[:, 1])
    yield Dimension("width of the dome", 2.0 * float(across.max()), "largest", sign="⌀")
    for name, surface in (("outer rim", lens.outer), ("opening of the cavity", lens.inner)):
        yield _rim_in_section(name, surface)
        turn = np.linspace(0.0, 2.0 * np.pi, _RIM_AZIMUTHS, endpoint=False)
        widest = 2.0 * float(surface.radius(rim_directions(turn)).max())
        yield Dimension(f"{name} in z = 0, circle about the axis that holds it", widest, "largest", sign="⌀")


def _rim_in_section(name: str, surface: Surface) -> Dimension:
    right, left = rim_radius(surface)(np.array([0.0, np.pi])).tolist()
    return Dimension(f"{name} in z = 0, along x", left + right, "section", ((0.0, -left), (0.0, right)), "x")


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
        return [*_in_section_of_file(lens), *_box_of_file(base.file)]
    return [*_depths(lens, base), *_widths(lens, base)]


def _depths(lens: Lens, base: BaseSection) -> Iterator[Dimension]:
    """Lengths of a built-in base along the axis."""
    plan, bottom = lay_out(lens.inner, lens.outer, base), -base.height_mm
    half = _half_width(base)
    yield Dimension("height of the base below z = 0", base.height_mm, "base", ((bottom, -half), (0.0, -half)))
    if plan.relief_mm > 0.0:
        ends = (-plan.relief_mm, -half), (0.0, -half)
        yield Dimension("depth of the relief step below z = 0", plan.relief_mm, "base", ends)
    if base.pocket_diameter_mm is not None:
        side = -base.pocket_diameter_mm / 2.0
        ends = (bottom, side), (bottom + base.pocket_depth_mm, side)
        yield Dimension("depth of the pocket", base.pocket_depth_mm, "base", ends)
    if base.flange_diameter_mm is not None:
        side = -base.flange_diameter_mm / 2.0
        ends = (bottom, side), (bottom + base.flange_height_mm, side)
        yield Dimension("height of the flange", base.flange_height_mm, "base", ends)


def _half_width(base: BaseSection) -> float:
    return (base.side_mm if base.kind == "square" else base.diameter_mm) / 2.0


def _widths(lens: Lens, base: BaseSection) -> Iterator[Dimension]:
    """Widths of a built-in base."""
    plan, half = lay_out(lens.inner, lens.outer, base), _half_width(base)
    foot = -plan.shoulder_mm
    if base.kind == "square":
        yield Dimension("side of the base across x", 2.0 * half, "base", ((foot, -half), (foot, half)), "x", "□")
        yield Dimension("side of the base across y", 2.0 * half, "base", ((-half, -half), (half, -half)), "y")
    elif base.flat_mm is None:
        yield Dimension("diameter of the base", 2.0 * half, "base", ((foot, -half), (foot, half)), "x", "⌀")
    else:  # the flat takes a piece from the section
        yield Dimension("diameter of the base", 2.0 * half, "base", ((-half, 0.0), (half, 0.0)), "y", "⌀")
        ends = (foot, 0.0), (foot, base.flat_mm)
        yield Dimension("clocking flat across +x, from the axis", base.flat_mm, "base", ends, "x")
    for name, z, circle in (
        ("diameter of the step's wall", 0.0, plan.ring),
        ("diameter of the bore", -plan.bore_mm, plan.bore),
        ("diameter of the pocket", -base.height_mm, plan.pocket),
        ("diameter of the flange", -base.height_mm, plan.flange),
    ):
        if circle is not None:
            radius = _radius(circle)
            yield Dimension(name, 2.0 * radius, "base", ((z, -radius), (z, radius)), "x", "⌀")


def _radius(circle: Outline) -> float:
    return float(circle.radius(np.zeros(1))[0])


def _in_section_of_file(lens: Lens) -> Iterator[Dimension]:
    """Width and height of the base where the section cuts it."""
    outlines = body_outlines(lens, 0.0)[1:]  # the first is that of the lens
    if not outlines:
        return
    below = np.concatenate(outlines)
    low = below[np.argmin(below[:, 1])]
    left, right = below[np.argmin(below[:, 0])], below[np.argmax(below[:, 0])]
    ends = (float(low[1]), float(low[0])), (0.0, float(low[0]))
    yield Dimension("base below z = 0, in the section", -ends[0][0], "section", ends)
    across = (float(left[1]), float(left[0])), (float(right[1]), float(right[0]))
    yield Dimension("base along x, in the section", across[1][1] - across[0][1], "section", across, "x")


def _box_of_file(path: Path) -> list[Dimension]:
    """Bounding box of a base from a STEP file; its round faces are tessellated to a hundredth of a millimetre."""
    vertices, _ = tessellated(read_custom_base(path).solid, 1e-2)
    sizes = np.ptp(vertices, axis=0).tolist()
    names = ("width along x", "width along y", "height below z = 0")
    return [Dimension(f"base of {path.name}, {name}", size, "box") for name, size in zip(names, sizes, strict=True)]
