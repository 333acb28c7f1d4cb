"""Datums of the drawing: features that the part has, and where it has none, words that say so.

A is a plane that can be touched: the base's top or the rim where it lies in z = 0, else the bottom, on which the part
sits. B is the axis of a round base, or the middle plane of two sides of a square one; C stops the part from turning.
A STEP with tolerances on its faces names its own plane A, in z = 0: then that is A here, too.
"""

from dataclasses import dataclass
from math import floor
from typing import Literal

from lensforge.drawings.dimensions import widest_mm
from lensforge.geometry.base_profile import BOTTOM, RIM, SIDE, TOP
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.part import Part
from lensforge.geometry.plan import lay_out
from lensforge.geometry.section import other_section_deg
from lensforge.lens import Lens
from lensforge.spec import BaseSection

Letter = Literal["A", "B", "C"]


@dataclass(frozen=True)
class Datum:
    """A datum: its letter, its feature in words, and where the drawing has its symbol.

    ``dimension``: the name of the dimension at whose line the symbol is, for an axis or a middle plane; "" for a plane,
    at ``z_mm`` in the section, or where that is None at the flat in the view of the end.
    """

    letter: Letter
    words: str
    dimension: str = ""
    z_mm: float | None = None


@dataclass(frozen=True)
class DatumScheme:
    """The datums that the part has, and a line on each, or on why there is none."""

    datums: tuple[Datum, ...]
    lines: tuple[str, ...]

    def find(self, letter: Letter) -> Datum | None:
        """The datum of that letter; None where the part has none."""
        return next((datum for datum in self.datums if datum.letter == letter), None)


def datum_scheme(lens: Lens, part: Part) -> DatumScheme:
    """The datums of a lens with its base."""
    base = base_with_room(lens)
    found = [datum for datum in (_plane(lens, part, base), _centre(base), _turn(base)) if datum is not None]
    missing = []
    if base.kind in ("none", "step"):
        missing.append("No datum feature for the axis: z through the origin of lens.step, aligned by the optical faces")
    if len(found) < 3:
        flat = clocking_flat(lens, base)
        proposed = f"; base.flat_mm = {flat:g} would, a flat across +x" if flat else ""
        missing.append(f"Nothing on the part marks the azimuth, which counts from +x of lens.step{proposed}")
    if base.kind == "step":
        missing[-1] = "The azimuth is that of the base in its own file"
    lines = *(f"Datum {datum.letter}: {datum.words}" for datum in found), *missing
    return DatumScheme(tuple(found), lines)


def clocking_flat(lens: Lens, base: BaseSection) -> float | None:
    """Distance (mm) of a flat that would mark +x of a part that is not round; None where none is missing or fits."""
    if base.kind != "cylinder" or base.flat_mm is not None or other_section_deg(lens) is None:
        return None
    inside, half = widest_mm(lens.outer) / 2.0, base.diameter_mm / 2.0
    flat = floor(10.0 * (half - 0.25 * (half - inside))) / 10.0
    return flat if inside < flat < half else None


def _plane(lens: Lens, part: Part, base: BaseSection) -> Datum:
    carried = [name for tolerance in part.form_tolerances for name in tolerance.datum_faces]
    if carried:
        faces = " and ".join(dict.fromkeys(carried))
        return Datum("A", f"plane z = 0, {faces}, as lens.step carries it", z_mm=0.0)
    if base.kind == "none":
        return Datum("A", f"plane z = 0, the ring {RIM} between the rims of the optical faces", z_mm=0.0)
    if base.kind == "step":
        return Datum("A", "plane z = 0, the top of the base", z_mm=0.0)
    plan = lay_out(lens.inner, lens.outer, base)
    if plan.relief_mm == 0.0 and all(arc.relation == "ledge" for arc in plan.arcs):
        return Datum("A", f"plane z = 0, the top of the base, {TOP}", z_mm=0.0)
    words = f"bottom of the base, {BOTTOM}, at z = {-base.height_mm:g}; no face to be touched lies in z = 0"
    return Datum("A", words, z_mm=-base.height_mm)


def _centre(base: BaseSection) -> Datum | None:
    if base.kind == "cylinder":
        return Datum("B", f"axis of the base's cylinder, {SIDE}; the optical axis z", "diameter of the base")
    if base.kind == "square":
        return Datum("B", "middle plane of the base's sides across x", "side of the base across x")
    return None


def _turn(base: BaseSection) -> Datum | None:
    if base.kind == "square":
        words = "middle plane of the base's sides across y; B and C meet in the optical axis z; +x is not marked"
        return Datum("C", words, "side of the base across y")
    if base.kind == "cylinder" and base.flat_mm is not None:
        return Datum("C", "clocking flat of the base, across +x")
    return None
