"""Frame, title block, and the table of the two optical faces and the material, as the drawing has them.

The table is in the notation of ISO 10110; conformance is not claimed. 3/ form, 4/ centring of the outer face to the
inner one, 5/ imperfections; 0/, 1/, 2/ stress, bubbles and homogeneity of the material. Rq and RΔq: height and slope of
the roughness, rms. A dash stands where neither spec nor preset says more.
"""

import re
from dataclasses import dataclass

import numpy as np

from lensforge.cad.part import STEP_FILE, Part
from lensforge.cad.plan import INNER, OUTER
from lensforge.optics.material import D_LINE_NM
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check, FaceName
from lensforge.shop.dimensions import widest_mm
from lensforge.shop.sheet import Box, Marks, Stroke, Words, first_angle
from lensforge.shop.sheet_text import cell, frame_of, row, row_height
from lensforge.spec import DrawingSection

WIDTH, ROW = 180.0, 5.6  # mm on A3
HEIGHT = 8.0 * ROW
_NONE = "not stated"


@dataclass(frozen=True)
class TitleBlock:
    """Words of the title block."""

    name: str
    number: str
    revision: str
    material: str
    mass: str
    author: str
    date: str
    checked: str
    organisation: str
    step: str
    general: str

    @property
    def title(self) -> str:
        """Name, number and revision in one line."""
        found = [self.name, *(text for text in (self.number,) if text != _NONE)]
        return ", ".join([*found, *(f"revision {text}" for text in (self.revision,) if text != _NONE)])


def title_block(lens: Lens, part: Part, words: DrawingSection) -> TitleBlock:
    """Words for the shop, and from the record of the part: author and date are those of its files."""
    spec, signature = lens.spec, part.signature
    stamp = part.files[STEP_FILE]
    return TitleBlock(
        name=words.part_name or spec.name,
        number=words.part_number or _NONE,
        revision=words.revision or _NONE,
        material=spec.lens.material or _NONE,
        mass=f"{part.volume_mm3:.1f} mm³" if part.mass_g is None else f"{part.mass_g:.3f} g",
        author=signature.author or _NONE,
        date=signature.date or _NONE,
        checked=words.checked_by or _NONE,
        organisation=signature.organisation or _NONE,
        step=f"{STEP_FILE}, SHA-256 {stamp.sha256[:16]}…",
        general=words.general_tolerances or f"{_NONE}, to be agreed",
    )


def scale_words(scale: float) -> str:
    """The scale as ISO 5455 writes it."""
    return f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"


def draw_title_block(words: TitleBlock, corner: tuple[float, float], unit: float, scale: float, sheet: str) -> Marks:
    """The block, its lower right corner at ``corner``."""
    left, bottom = corner[0] - WIDTH * unit, corner[1]
    height = ROW * unit
    quantity = "Mass" if words.mass.endswith("g") else "Volume"
    rows = [
        [words.name],
        [f"Number: {words.number}", f"Revision: {words.revision}"],
        [f"Material: {words.material}", f"{quantity}: {words.mass}"],
        [f"Drawn: {words.author}", f"Date: {words.date}"],
        [f"Checked: {words.checked}", f"Organisation: {words.organisation}"],
        [f"Sizes “general”: {words.general}", "Units: mm, degrees"],
        [f"Scale: {scale_words(scale)}", f"First angle; {sheet}, sheet 1 of 1"],
        [f"Defined by: {words.step}"],
    ]
    top = bottom + HEIGHT * unit
    strokes: list[Stroke] = []
    texts: list[Words] = []
    for number, each in enumerate(rows):
        low, wide = top - (number + 1) * height, WIDTH * unit / len(each)
        for k, text in enumerate(each):
            more = cell((left + k * wide, low, left + (k + 1) * wide, low + height), text, unit)
            strokes, texts = [*strokes, *more[0]], [*texts, *more[1]]
    symbol = first_angle((corner[0] - 14.0 * unit, bottom + 1.5 * height), 0.7 * unit)
    outside = frame_of((left, bottom, corner[0], top), "outline")
    return [*strokes, *symbol[0], outside], texts


def sheet_frame(size: tuple[float, float], inside: Box) -> list[Stroke]:
    """The frame of the drawing, and the marks at the middle of its sides."""
    left, bottom, right, top = inside
    width, height = size
    found = [frame_of(inside, "outline")]
    for start, end in (
        ((width / 2.0, 0.0), (width / 2.0, bottom)),
        ((width / 2.0, top), (width / 2.0, height)),
        ((0.0, height / 2.0), (left, height / 2.0)),
        ((right, height / 2.0), (width, height / 2.0)),
    ):
        found.append(Stroke(np.array([start, end]), "outline"))
    return found


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
    strokes: list[Stroke] = []
    words: list[Words] = []
    widths = [width * unit for width in _WIDTHS]
    for texts in rows:
        more = row(left, top, texts, widths, unit)
        strokes, words, top = [*strokes, *more[0]], [*words, *more[1]], top - row_height(texts, widths, unit)
    return strokes, words


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
