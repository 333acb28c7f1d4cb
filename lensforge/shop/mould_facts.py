"""Facts of a moulded part: the halves of its mould, where it is filled, where it may sink, and how long it cools."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import log, pi

from lensforge.optics.face_roles import CAVITY
from lensforge.results import Fact
from lensforge.results.numerals import quantity
from lensforge.shop.check_measures import Mould, PartingLine
from lensforge.shop.check_result import Check
from lensforge.shop.findings import drawn_by
from lensforge.spec import Spec

MOST_RATIO = 3.0  # thickest over thinnest: a rule of thumb of guides for the design of moulded parts


@dataclass(frozen=True)
class Plastic:
    """Heat of a plastic as it is moulded: thermal diffusivity, and temperatures of melt, mould and ejection.

    Typical of general-purpose grades, rounded: the diffusivity, k / (rho c) at some 150 deg C, to a fifth, the mould to
    10 deg C.
    """

    diffusivity_mm2_per_s: float
    melt_c: float
    mould_c: float
    ejected_c: float

    def cooling_range_s(self, thickness_mm: float) -> tuple[float, float]:
        """Shortest and longest time over the typical ranges of diffusivity and mould temperature."""
        fast = replace(self, diffusivity_mm2_per_s=1.2 * self.diffusivity_mm2_per_s, mould_c=self.mould_c - 10.0)
        slow = replace(self, diffusivity_mm2_per_s=0.8 * self.diffusivity_mm2_per_s, mould_c=self.mould_c + 10.0)
        return fast.cooling_s(thickness_mm), slow.cooling_s(thickness_mm)

    def cooling_s(self, thickness_mm: float) -> float:
        """Seconds until the middle of a slab has cooled to the temperature of ejection (Ballman and Shusman, 1959)."""
        cooled = (self.melt_c - self.mould_c) / (self.ejected_c - self.mould_c)
        return thickness_mm**2 / (pi**2 * self.diffusivity_mm2_per_s) * log(4.0 / pi * cooled)


# Melt and mould of PS lie within those of the guide "PS materials" of Autodesk Moldflow, 180 to 280 and 20 to 70 deg C;
# no source that could be cited was at hand for the others. The data sheet of a grade goes first.
PLASTICS = {
    "pmma": Plastic(0.11, 240.0, 70.0, 95.0),
    "pc": Plastic(0.13, 300.0, 95.0, 125.0),
    "ps": Plastic(0.09, 220.0, 45.0, 80.0),
    "cop": Plastic(0.10, 280.0, 115.0, 130.0),
    "coc": Plastic(0.10, 270.0, 110.0, 125.0),
}


def plastic_of(material: str) -> Plastic | None:
    """The plastic that a material's name begins with; None if unknown, or if it cures instead."""
    return PLASTICS.get(material.lower().split(" ")[0]) if material else None


def mould_facts(mould: Mould, check: Check) -> Iterator[Fact]:
    """The halves of the mould, and the part as it fills and cools."""
    spec = check.spec
    for name, face in mould.faces.items():
        released = face.upper_fraction + face.lower_fraction
        yield Fact.share(
            f"{name}_drawn", f"Released, {name} face", released, f"of the face, by {drawn_by(face)} of the mould"
        )
    yield _parting(mould.parting)
    yield _gate(mould, spec)
    if mould.upright:
        yield Fact(
            "upright", "Without draft", upright_phrase(mould), note="keep it short, or agree on it with the moulder"
        )
    yield _inner_corners(check, mould, spec)
    thickest = mould.thickest.diameter_mm
    thinnest = check.min_wall_mm
    yield Fact("thickest_ball", "Thickest place", thickest, "mm", note="diameter of the largest inscribed ball")
    if thinnest > 0.0:
        sinks = "risk of sink marks and voids at its thickest place" if thickest > MOST_RATIO * thinnest else ""
        note = f"largest inscribed ball/thinnest wall; rule of thumb: at most {MOST_RATIO:g}"
        yield Fact("thickness_ratio", "Max/min thickness", thickest / thinnest, note=note, notice=sinks, digits=3)
    yield _cooling(mould, spec.lens.material)


def thick_line(mould: Mould, check: Check) -> str:
    """The note of a drawing on what a moulder prices first: the thickest place, and the cooling time."""
    place = mould.thickest
    cooling = _cooling(mould, check.spec.lens.material)
    where = ", ".join(f"{round(value, 1) + 0.0:g}" for value in place.centre_mm)
    wall = f"{quantity(check.min_wall_mm, 'mm', digits=3)}, the thinnest wall" if check.min_wall_mm > 0.0 else "no wall"
    thick = f"a ball of {quantity(place.diameter_mm, 'mm', digits=3)} about ({where}), beside {wall}"
    estimate = cooling.text if mould.cooling_s is not None else f"{cooling.text}, {cooling.note}"
    return f"Thickest place: {thick}. Cooling time: {estimate}{', an estimate' if mould.cooling_s is not None else ''}."


def mould_line(mould: Mould, spec: Spec) -> str:
    """The note of a drawing on parting line and gate, by their labels there."""
    parting = _parting(mould.parting)
    gate = _gate(mould, spec)
    where = ", ".join(filter(None, (gate.text, gate.note)))
    return f"PL, parting line: {parting.text}, {parting.note}. G, gate: {where}."


def upright_phrase(mould: Mould) -> str:
    """Phrase for the upright cylinder beside the flange: its diameter, and its heights."""
    heights = " and ".join(f"{cylinder.low_mm:.3f} to {cylinder.high_mm:.3f}" for cylinder in mould.upright)
    return f"cylinder ⌀{2.0 * mould.upright[0].radius_mm:.3f} beside the flange, z = {heights} mm"


def _parting(line: PartingLine) -> Fact:
    low, high = (quantity(round(height, 3) + 0.0, digits=4) for height in (line.low_mm, line.high_mm))
    if line.radius_mm is None:
        note = f"z = {low} mm; all below it is in the lower half"
        return Fact("parting", "Parting line", "the edge of the plate’s top", note=note)
    first, *more = line.places
    where = f"where {first} and {' and '.join(more)} meet" if more else f"the widest of the {first}"
    heights = low if low == high else f"{low} to {high}"
    note = f"{quantity(line.radius_mm, 'mm', digits=4)} from the axis at most, z = {heights} mm"
    return Fact("parting", "Parting line", where, note=note)


def _gate(mould: Mould, spec: Spec) -> Fact:
    if mould.gate is None:
        holders = "a base, a flange or a plate" if spec.lens.drawn_from_below is None else "a flange"
        lacks = f"give it {holders}: all its sides are optical faces"
        return Fact("gate", "Gate", "none", notice=lacks)
    marked = spec.plate is not None and spec.plate.gate is not None
    note = "as marked on its drawing" if marked else "away from the optical faces"
    return Fact("gate", "Gate", f"at the side of the {mould.gate}", note=note)


def _inner_corners(check: Check, mould: Mould, spec: Spec) -> Fact:
    """Concave edges of the mould: those of the core, and at the foot of base, flange or plate."""
    sides = [(spec.lens.role(edge.faces[0]), " and ".join(edge.faces)) for edge in check.edges]
    corners = [pair for first, pair in sides if first.before == CAVITY and not first.is_open]
    if mould.gate == "flange" or mould.gate in mould.parting.places:
        corners.append(f"{mould.gate} and {'lens' if mould.gate == 'flange' else spec.lens.outward}")
    note = "the mould wears there: agree on a radius with the moulder" if corners else ""
    return Fact("inner_corners", "Sharp inner corners", ", ".join(corners) or "none", note=note)


def _cooling(mould: Mould, material: str) -> Fact:
    """The estimate of the cooling time, or why there is none."""
    plastic = plastic_of(material)
    if mould.cooling_s is None or plastic is None:
        cures = material.lower().startswith("silicone")
        why = "it cures in the mould" if cures else f"thermal data of {material or 'the material'} not known"
        return Fact("cooling", "Cooling time", "no estimate", note=why)
    temperatures = f"{plastic.melt_c:g} °C of the melt, {plastic.mould_c:g} of the mould, {plastic.ejected_c:g} ejected"
    low, high = (quantity(time_s, digits=2) for time_s in plastic.cooling_range_s(mould.thickest.diameter_mm))
    typical = f"{low} to {high} s for ±20 % diffusivity and ±10 °C of the mould"
    note = f"estimate for a slab of {material} as thick as the largest ball; {temperatures}; {typical}"
    return Fact("cooling", "Cooling time", mould.cooling_s, "s", note=note, digits=2)
