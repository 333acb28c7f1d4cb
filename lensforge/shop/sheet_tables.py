"""Tables of the drawing: of the optical faces and the material, and of the tolerances.

The first is in the notation of ISO 10110; conformance is not claimed. GS: a general surface of its part 19, which is
stated by a face of the STEP, its hash and its coordinates. 3/ form, 4/ centring of a face to the
first, 5/ imperfections; 0/, 1/, 2/ stress, bubbles and homogeneity of the material. Rq and RΔq: height and slope of
the roughness, rms. A dash stands where neither spec nor preset says more.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from lensforge.cad.boundary import domain_of, optical_name
from lensforge.cad.part import STEP_FILE, Part
from lensforge.errors import InputError
from lensforge.optics.material import D_LINE_NM
from lensforge.results import Group
from lensforge.results.numerals import NOTHING, percent
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import face_title
from lensforge.shop.check_measures import FLAT_MM
from lensforge.shop.check_result import Check
from lensforge.shop.dimensions import widest_mm
from lensforge.shop.drawn_views import drawn_width_mm
from lensforge.shop.profile_table import equation, has_profile
from lensforge.shop.sheet import Marks
from lensforge.shop.sheet_marks import draw_rows, row_height
from lensforge.spec import DrawingSection
from lensforge.spec.tolerances_section import Factor, amount_words, factors_of

MATERIAL = "material"  # its column
_WIDTH = 38.0  # of that, mm on A3

_OF_ASSEMBLY = ("source_", "lens_")
_RMS = ("_form_um", "_waviness_um")
_PEAK = ("_ripple_um",)
_TEXT = dict[str, str]  # lines of a column by their keys


@dataclass(frozen=True)
class OpticalTable:
    """Columns of the table by the face, the last of the envelope first, or :data:`MATERIAL`, in lines by their keys."""

    columns: dict[str, _TEXT]

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Lines of all columns side by side; shorter columns end in empty cells."""
        return list(zip_longest(*(column.values() for column in self.columns.values()), fillvalue=""))

    def height(self, width: float, unit: float) -> float:
        """Height of the table, ``width`` mm wide on A3."""
        return sum(row_height(texts, self._widths(width, unit), unit) for texts in self.rows)

    def drawn(self, right: float, top: float, width: float, unit: float) -> Marks:
        """The table, its upper right corner given, ``width`` mm wide on A3."""
        return draw_rows(self.rows, right - width * unit, top, self._widths(width, unit), unit)

    def _widths(self, width: float, unit: float) -> list[float]:
        """Widths of the columns: the faces share what the material leaves."""
        faces = len(self.columns) - 1
        return [unit * (_WIDTH if name == MATERIAL else (width - _WIDTH) / faces) for name in self.columns]


def optical_table(lens: Lens, part: Part, check: Check, drawing: DrawingSection) -> OpticalTable:
    """The table of the checked faces, with the material between those of envelope and cavity."""
    outwards, inwards = (
        {
            face.name: _face(face.name, lens, part, check, drawing)
            for face in reversed(faces)
            if face.name in check.faces
        }
        for faces in (lens.body.envelope, lens.body.cavity)
    )
    return OpticalTable({**outwards, MATERIAL: _material(lens), **inwards})


def _material(lens: Lens) -> _TEXT:
    spec = lens.spec.lens
    off = 0.0 if spec.is_opaque else lens.spec.part_tolerances.tolerance("index").amount
    index = f"n = {spec.refractive_index:g}{f' ±{off:g}' if off else ''}"
    return {
        "title": "Material",
        "name": spec.material,
        "index": NOTHING if spec.is_opaque else index,
        "wavelength": NOTHING if spec.is_opaque else index_wavelength(lens),
        "stress": f"0/ {NOTHING}",
        "bubbles": f"1/ {NOTHING}",
        "homogeneity": f"2/ {NOTHING}",
    }


def index_wavelength(lens: Lens) -> str:
    """Wavelength of the material's index: of the spec's dispersion, or as the material's name says."""
    spec = lens.spec.lens
    named = re.search(r"\d+(?:\.\d+)? ?nm\b", spec.material)
    if spec.abbe_number is not None:
        return f"at {D_LINE_NM:g} nm"
    if named is not None:
        return f"at {named[0]}"
    return "wavelength not stated" if spec.dispersion is None else f"at {spec.design_wavelength_nm:g} nm"


def _face(name: str, lens: Lens, part: Part, check: Check, drawing: DrawingSection) -> _TEXT:
    face = check.faces[name]
    return {
        "title": f"{face_title(name)}, {'GS: ' if is_general(name, lens) else ''}{optical_name(name)}",
        "shape": _shape(name, lens, check),
        "aperture": f"Effective aperture: {_aperture(name, lens)}, whole face",
        "form": _form(name, lens),
        "profile": _profile(name, lens, part),
        "centring": _centring(name, lens),
        "imperfections": f"5/ {drawing.imperfections or NOTHING}",
        "texture": _texture(name, lens, drawing.roughness_nm),
        "coating": f"Coating: {_coating(name, lens)}; {face.area_mm2 / check.scale**2:.1f} mm²",
    }


def _aperture(name: str, lens: Lens) -> str:
    length_mm = lens.spec.lens.drawn_mm
    if length_mm is None:
        return f"⌀{widest_mm(lens.surfaces[name], domain_of(lens, name)):.3f}"
    return f"{drawn_width_mm(lens, name):.3f} × {length_mm:.3f}"


def _coating(name: str, lens: Lens) -> str:
    face = lens.spec.lens.faces[name]
    if face.mirror is not None:
        return f"mirror, reflects {percent(face.mirror)}"
    return NOTHING if face.coating is None else face.coating.title


def _shape(name: str, lens: Lens, check: Check) -> str:
    """The equation of a known form, else the best-fit sphere of the part (not of a tool)."""
    if lens.spec.lens.drawn_mm is not None:
        return "drawn along y, profile in the table"
    sphere = check.faces[name].best_fit_sphere
    radius_mm = sphere.radius_mm / check.scale
    pv_mm = sphere.pv_mm / check.scale
    fitted = f"R {radius_mm:.3f}" if sphere.radius_mm < FLAT_MM else "plane"
    form = "of revolution, profile in the table" if lens.spec.lens.is_revolved(name) else "freeform"
    return equation(lens.surfaces[name]) or f"{form}; best-fit {fitted}, PV {pv_mm:.3f}"


def is_general(name: str, lens: Lens) -> bool:
    """True for a face that neither an equation nor a profile on the sheet gives."""
    return not (has_profile(lens, name) or equation(lens.surfaces[name]))


def _form(name: str, lens: Lens) -> str:
    form = _amount(lens, name, "form_um")
    waves = _amount(lens, name, "waviness_um")
    form_note = f"3/ RMS form {form:g} µm" if form else f"3/ {NOTHING}"
    return f"{form_note}; waviness {waves:g} µm" if waves else form_note


def _profile(name: str, lens: Lens, part: Part) -> str:
    """Profile of the surface by ISO 1101, against datum A if the STEP states it so."""
    width_um = lens.spec.manufacture.form_tolerance_um
    if width_um is None:
        return f"Profile of the surface: {NOTHING}"
    carried = [tolerance for tolerance in part.form_tolerances if tolerance.face == optical_name(name)]
    if not carried:
        return f"Profile of the surface: {1e-3 * width_um:g} (none in {STEP_FILE})"
    return f"Profile of the surface: {1e-3 * width_um:g}{' | A' if carried[0].datum_faces else ''}"


def _centring(name: str, lens: Lens) -> str:
    """Place against the first face, to which the others are centred."""
    first, *other_faces = lens.spec.lens.names
    if name == first:
        referring = [face for face in other_faces if _centred(face, lens)]
        reference = f"reference of the {' and '.join(referring)} face" if referring else ""
        flange = lens.spec.lens.rim_flange
        tied = "" if flange is None or flange.tolerance_mm is None else f"±{flange.tolerance_mm:g} mm to A and B"
        return f"4/ {'; '.join(filter(None, (tied, reference))) or NOTHING}"
    centring = _centred(name, lens)
    return f"4/ {', '.join(centring)} to the {first} face" if centring else f"4/ {NOTHING}"


def _centred(name: str, lens: Lens) -> list[str]:
    tilt = _amount(lens, name, "tilt_deg")
    shift = _amount(lens, name, "shift_mm")
    return ([f"±{tilt:g}°"] if tilt else []) + ([f"±{shift:g} mm"] if shift else [])


def _texture(name: str, lens: Lens, height: float | None) -> str:
    slope = _amount(lens, name, "roughness_mrad")
    ripple = _amount(lens, name, "ripple_um")
    notes = ["polished"]
    notes += [f"Rq {height:g} nm"] if height else []
    notes += [f"RΔq {slope:g} mrad"] if slope else []
    notes += [f"rings {1e3 * ripple:g} nm PV"] if ripple else []
    return ", ".join(notes)


def _amount(lens: Lens, face: str, field: str) -> float:
    return lens.spec.part_tolerances.amount(face, field)


@dataclass(frozen=True)
class ToleranceRow:
    """A tolerance: its amount, its source, and the largest amount at which enough parts pass ("" if unknown)."""

    name: str
    amount: str
    source: str
    at_most: str


@dataclass(frozen=True)
class ToleranceTable:
    """Tolerances of the ``lens``, which its maker keeps, and of the ``assembly``: LED, and the lens on its board.

    ``passing``: share of the parts that pass with them, "" where that has not been computed.
    """

    sentence: str
    passing: str
    lens: tuple[ToleranceRow, ...]
    assembly: tuple[ToleranceRow, ...]


def tolerance_table(lens: Lens, studied: Sequence[Group] = ()) -> ToleranceTable:
    """The tolerances of the spec; ``studied``: facts of the yield under them, empty if it has not been computed."""
    try:
        factors = factors_of(lens.spec.part_tolerances)
    except InputError:  # all of them are 0
        factors = ()
    budget = {group.title: group for group in studied if group.key == "budget"}
    rows = {factor.name: _row(lens, factor, budget.get(factor.phrase)) for factor in factors}
    assembly = tuple(row for name, row in rows.items() if name.startswith(_OF_ASSEMBLY))
    of_lens = tuple(row for name, row in rows.items() if not name.startswith(_OF_ASSEMBLY))
    passing = _passing(studied)
    sentence = _sentence(studied, passing) if rows else "The specification sets no tolerances."
    return ToleranceTable(sentence, passing, of_lens, assembly)


def _row(lens: Lens, factor: Factor, budget: Group | None) -> ToleranceRow:
    tolerances = lens.spec.part_tolerances
    is_given = tolerances.given(factor.name) is not None
    amount = amount_words(factor.name, factor.amount, factor.unit)
    if factor.name.endswith(_RMS):
        amount = f"{amount} rms"
    elif factor.name.endswith(_PEAK):
        amount = f"{amount} peak to valley"
    elif factor.kind == "spread":
        amount = f"± {amount}"
    at_most = ""
    if budget is not None:
        most = budget.fact("at_most").text
        at_most = budget.fact("interval").text if most == NOTHING else most
    return ToleranceRow(
        factor.phrase, amount, "specification" if is_given else f"preset “{tolerances.preset}”", at_most
    )


def _sentence(studied: Sequence[Group], passing: str) -> str:
    if not passing:
        return "Amounts of the specification and its preset. Their yield is not computed yet: `lensforge yield`."
    wanted = [fact.text for group in studied for fact in group.select("wanted").facts]
    if not wanted:
        return f"{passing}."
    return f"{passing}. At most: amount for a yield of {wanted[0]}, the others as they are."


def _passing(studied: Sequence[Group]) -> str:
    passed = next((group for group in studied if group.key == "yield"), None)
    if passed is None:
        return ""
    return f"Yield {passed.fact('pass_rate').text} of {passed.fact('parts').text} parts with these tolerances"
