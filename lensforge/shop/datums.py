"""Datums of the lens and of the plate: features of the part, and a note on each, or on why it is missing.

Of a lens with a flange, by which a holder takes it, A is the flange's underside and B its axis. Else A is a plane that
can be touched: the base's top or the rim where it lies in z = 0, else the bottom. B is the axis of a round base or of a
body of revolution, or the middle plane of two sides of a square base; C stops the part from turning. Of a linear lens A
is the plane of its feet, B the middle between them, C that of its ends. A of a plate is its top, B and C are the axes
of the pins and holes by which it is placed, or of its outline.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.cutter_room import lens_plan
from lensforge.cad.drawn_body import END_FACE
from lensforge.cad.flange import ring_of
from lensforge.cad.part import Part
from lensforge.cad.plan import BOTTOM, RIM, RIM_FLANGE_BOTTOM, RIM_FLANGE_SIDE, SIDE, TOP, Plan
from lensforge.cad.plate_layout import PlateLayout
from lensforge.scene.lens import Lens
from lensforge.shop.dimensions import FLANGE_WIDTH, RIM_WIDTH
from lensforge.shop.drawn_views import LENGTH, WIDTH
from lensforge.shop.profile_table import is_round
from lensforge.shop.sheet import shown
from lensforge.spec import BaseSection
from lensforge.spec.plate_section import PlateBoss, PlateHole, PlateMark, PlatePin
from lensforge.surfaces.surface import Surface

Letter = Literal["A", "B", "C"]
PLATE_SIZES = ("width of the plate", "height of the plate")
ROUND_PLATE = "diameter of the plate"


@dataclass(frozen=True)
class Datum:
    """A datum: its letter, a phrase for its feature, and where the drawing has its symbol.

    ``dimension``: the name of the dimension at whose line the symbol is, for an axis or a middle plane, or the label of
    a pin or hole; "" for a plane, drawn at ``z_mm`` in the section, or, if that is None, at the flat in the view from
    the base.
    """

    letter: Letter
    feature: str
    dimension: str = ""
    z_mm: float | None = None


@dataclass(frozen=True)
class DatumScheme:
    """The datums of the part, and a note on each, or on why it is missing."""

    datums: tuple[Datum, ...]
    lines: tuple[str, ...]

    def find(self, letter: Letter) -> Datum | None:
        """The datum ``letter``; None if the part has none."""
        return next((datum for datum in self.datums if datum.letter == letter), None)

    @staticmethod
    def of(datums: list[Datum], missing: list[str]) -> "DatumScheme":
        """The scheme of these datums; ``missing``: notes on the others."""
        return DatumScheme(tuple(datums), (*(f"Datum {datum.letter}: {datum.feature}" for datum in datums), *missing))


def datum_scheme(lens: Lens, part: Part) -> DatumScheme:
    """The datums of a lens with its base or its flange."""
    if lens.spec.lens.drawn_mm is not None:
        return _of_linear_lens()
    plan = lens_plan(lens)
    base = plan.base
    candidates = _plane(lens, plan, part), _centre(lens, base), _turn(base)
    datums = [datum for datum in candidates if datum is not None]
    missing = list[str]()
    if lens.spec.plate is not None:
        missing.append("The axis z of each lens, and its +x, stand where the drawing of the plate has them")
        return DatumScheme.of(datums, missing)
    if candidates[1] is None:
        missing.append("No datum feature for the axis: z through the origin of lens.step, aligned by the optical faces")
    if candidates[2] is None and base.kind == "step":
        missing.append("The azimuth is the base's, as in its own file")
    elif candidates[2] is None and not (is_round(lens) and base.feet is None):
        missing.append("The part has no azimuth mark; azimuths are from +x of lens.step")
    return DatumScheme.of(datums, missing)


def _of_linear_lens() -> DatumScheme:
    plane = Datum("A", f"plane z = 0, the two strips {RIM} between the feet of the profiles", z_mm=0.0)
    across = Datum("B", "middle plane of the feet of the outer profile, across x", WIDTH)
    return DatumScheme.of([plane, across, Datum("C", f"middle plane of the ends {END_FACE}, across y", LENGTH)], [])


def _plane(lens: Lens, plan: Plan[Surface], part: Part) -> Datum:
    ring = ring_of(lens)
    if ring is not None:
        feature = f"underside of the rim's flange, {RIM_FLANGE_BOTTOM}, at z = {shown(ring.low_mm)}"
        return Datum("A", feature, z_mm=ring.low_mm)
    carried = [name for tolerance in part.form_tolerances for name in tolerance.datum_faces]
    if carried:
        faces = " and ".join(dict.fromkeys(carried))
        return Datum("A", f"plane z = 0, {faces}, as lens.step carries it", z_mm=0.0)
    base = plan.base
    if lens.spec.plate is not None:
        return Datum("A", "plane z = 0, the top of the plate", z_mm=0.0)
    if base.kind == "none":
        return Datum("A", f"plane z = 0, the ring {RIM} between the rims of the optical faces", z_mm=0.0)
    if base.kind == "step":
        return Datum("A", "plane z = 0, the top of the base", z_mm=0.0)
    if plan.relief_mm == 0.0 and all(arc.relation == "ledge" for arc in plan.arcs):
        return Datum("A", f"plane z = 0, the top of the base, {TOP}", z_mm=0.0)
    feature = f"bottom of the base, {BOTTOM}, at z = {-base.height_mm:g}; no accessible face in z = 0"
    return Datum("A", feature, z_mm=-base.height_mm)


def _centre(lens: Lens, base: BaseSection) -> Datum | None:
    if lens.spec.lens.rim_flange is not None:
        return Datum("B", f"axis of the rim's flange, {RIM_FLANGE_SIDE}; the optical axis z", FLANGE_WIDTH)
    if base.kind == "cylinder":
        return Datum("B", f"axis of the base's cylinder, {SIDE}; the optical axis z", "diameter of the base")
    if base.kind == "square":
        return Datum("B", "middle plane of the base's sides across x", "side of the base across x")
    if base.kind == "none" and is_round(lens):
        outermost = lens_boundaries(lens)[1].faces[-1].label
        return Datum("B", f"axis of revolution of {outermost}; the optical axis z", RIM_WIDTH)
    return None


def _turn(base: BaseSection) -> Datum | None:
    if base.kind == "square":
        feature = "middle plane of the base's sides across y; B and C meet in the optical axis z; +x is not marked"
        return Datum("C", feature, "side of the base across y")
    if base.kind == "cylinder" and base.flat_mm is not None:
        return Datum("C", "clocking flat of the base, across +x")
    return None


def labelled(layout: PlateLayout) -> Iterator[tuple[str, PlateMark]]:
    """Holes, pins and bosses with their labels on the drawing: a letter for each type, and numbers."""
    counts: dict[str, int] = {}
    for _, mark in layout.plate.marks:
        letter = {PlateHole: "H", PlatePin: "P", PlateBoss: "B"}[type(mark)]
        counts[letter] = counts.get(letter, 0) + 1
        yield f"{letter}{counts[letter]}", mark


def plate_datums(layout: PlateLayout) -> DatumScheme:
    """The datums of a plate: its top, and two axes of pins, or else of holes, or else of its outline."""
    placing = [(label, mark) for label, mark in labelled(layout) if not isinstance(mark, PlateBoss)]
    placing.sort(key=lambda labelled_mark: not isinstance(labelled_mark[1], PlatePin))
    axes = [(f"axis of {label}, {'pin' if isinstance(mark, PlatePin) else 'hole'}", label) for label, mark in placing]
    if layout.plate.kind == "rectangle":
        axes += [(f"middle plane of the {name}", name) for name in PLATE_SIZES[min(len(axes), 1) :]]
    elif layout.plate.kind == "round" and not axes:
        axes = [("axis of the outline", ROUND_PLATE)]
    letters: tuple[Letter, Letter] = ("B", "C")
    datums = [Datum("A", "plane z = 0, the top of the plate", z_mm=0.0)]
    datums += [Datum(letter, feature, name) for letter, (feature, name) in zip(letters, axes, strict=False)]
    missing = [] if axes else ["No datum feature for x and y: they count from the origin of the outline's file"]
    return DatumScheme.of(datums, missing)
