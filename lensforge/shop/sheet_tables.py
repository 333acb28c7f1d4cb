"""Frame, title block, and the table of the two optical faces and the material, as the drawing has them.

The table is in the notation of ISO 10110; conformance is not claimed. 3/ form, 4/ centring of the outer face to the
inner one, 5/ imperfections; 0/, 1/, 2/ stress, bubbles and homogeneity of the material. Rq and RΔq: height and slope of
the roughness, rms. A dash stands where neither spec nor preset says more.
"""

import re

from lensforge.cad.part import Part
from lensforge.cad.plan import INNER, OUTER
from lensforge.optics.material import D_LINE_NM
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check, FaceName
from lensforge.shop.dimensions import widest_mm
from lensforge.shop.sheet import Marks
from lensforge.shop.sheet_marks import row, row_height
from lensforge.spec import DrawingSection

_WIDTHS = (71.0, 38.0, 71.0)  # mm on A3
_DASH = "–"
# Faces that the spec gives by a formula; those of files have none.
_SHAPES = {kind: kind for kind in ("sphere", "asphere", "biconic")}

Rows = list[list[str]]


def optical_table(lens: Lens, part: Part, check: Check, words: DrawingSection) -> Rows:
    """Rows of three texts: of the outer face, of the material, of the inner face."""
    outer, inner = (_face(name, lens, part, check, words) for name in ("outer", "inner"))
    spec = lens.spec.lens
    index = _amount(lens, "index")
    material = [
        "Material",
        spec.material,
        f"n = {spec.refractive_index:g}{f' ±{index:g}' if index else ''}",
        index_wavelength(lens),
        f"0/ {_DASH}",
        f"1/ {_DASH}",
        f"2/ {_DASH}",
        *[""] * (len(outer) - 7),
    ]
    return [list(texts) for texts in zip(outer, material, inner, strict=True)]


def index_wavelength(lens: Lens) -> str:
    """Wavelength at which the material has its index: of the spec's dispersion, or as the material's name says."""
    spec = lens.spec.lens
    named = re.search(r"\d+(?:\.\d+)? ?nm\b", spec.material)
    if spec.abbe_number is not None:
        return f"at {D_LINE_NM:g} nm"
    if named is not None:
        return f"at {named[0]}"
    return "wavelength not stated" if spec.dispersion is None else f"at {spec.design_wavelength_nm:g} nm"


def table_height(rows: Rows, unit: float) -> float:
    """Height of the table."""
    return sum(row_height(texts, [width * unit for width in _WIDTHS], unit) for texts in rows)


def draw_optical_table(rows: Rows, left: float, top: float, unit: float) -> Marks:
    """The table, its upper left corner given."""
    marks, widths = Marks(), [width * unit for width in _WIDTHS]
    for texts in rows:
        marks.add(row(left, top, texts, widths, unit))
        top -= row_height(texts, widths, unit)
    return marks


def _face(name: FaceName, lens: Lens, part: Part, check: Check, words: DrawingSection) -> list[str]:
    found, sphere = getattr(check, name), getattr(check, name).best_fit_sphere
    coating = getattr(lens.spec.lens, f"{name}_coating")
    return [
        f"{name.capitalize()} face, {OUTER if name == 'outer' else INNER}",
        f"{_shape(name, lens)}; best-fit R {sphere.radius_mm:.3f}, PV {sphere.pv_mm:.3f}",
        f"Effective aperture: ⌀{widest_mm(getattr(lens, name)):.3f}, whole face",
        _form(name, lens),
        _profile(name, lens, part),
        _centring(name, lens),
        f"5/ {words.imperfections or _DASH}",
        _texture(name, lens, words.roughness_nm),
        f"Coating: {_DASH if coating is None else coating.title}; {found.area_mm2:.1f} mm²",
    ]


def _shape(name: FaceName, lens: Lens) -> str:
    fixed = lens.spec.lens.fixed_inner if name == "inner" else lens.spec.lens.fixed_outer
    return "freeform" if fixed is None else _SHAPES.get(fixed.kind, "freeform")


def _form(name: FaceName, lens: Lens) -> str:
    form, waves = _amount(lens, f"{name}_form_um"), _amount(lens, f"{name}_waviness_um")
    words = f"3/ RMS form {form:g} µm" if form else f"3/ {_DASH}"
    return f"{words}; waviness {waves:g} µm" if waves else words


def _profile(name: FaceName, lens: Lens, part: Part) -> str:
    """Profile of the surface by ISO 1101, against datum A where the STEP carries it so."""
    width_um = lens.spec.manufacture.form_tolerance_um
    if width_um is None:
        return f"Profile of the surface: {_DASH}"
    face = OUTER if name == "outer" else INNER
    carried = any(each.face == face and each.datum_faces for each in part.form_tolerances)
    return f"Profile of the surface: {1e-3 * width_um:g}{' | A' if carried else ''}"


def _centring(name: FaceName, lens: Lens) -> str:
    tilt, shift = _amount(lens, "outer_tilt_deg"), _amount(lens, "outer_shift_mm")
    if name == "inner":
        return "4/ reference of the outer face" if tilt or shift else f"4/ {_DASH}"
    words = [f"±{tilt:g}°"] if tilt else []
    words += [f"±{shift:g} mm"] if shift else []
    return f"4/ {', '.join(words)} to the inner face" if words else f"4/ {_DASH}"


def _texture(name: FaceName, lens: Lens, height: float | None) -> str:
    slope, ripple = _amount(lens, f"{name}_roughness_mrad"), _amount(lens, f"{name}_ripple_um")
    words = ["polished"]
    words += [f"Rq {height:g} nm"] if height else []
    words += [f"RΔq {slope:g} mrad"] if slope else []
    words += [f"rings {1e3 * ripple:g} nm PV"] if ripple else []
    return ", ".join(words)


def _amount(lens: Lens, name: str) -> float:
    return lens.spec.tolerances.of(name).amount
