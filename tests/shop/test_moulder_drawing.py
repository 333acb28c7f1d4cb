"""What a moulder takes from the drawing: sizes as in the STEP and once, datums, profiles, material, edges and notes."""

import io
import re
from dataclasses import replace
from functools import cache
from typing import Any

import ezdxf
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from shop_lenses import bare_part, boxes_of, small_lens
from tir_lenses import TIR, spot, spot_lens

from lensforge.cad.body_export import on_base
from lensforge.cad.flange import ring_of
from lensforge.cad.form_error import fit_lens
from lensforge.cad.section import other_section_deg
from lensforge.cad.step import parse_step, signed_step
from lensforge.results import Fact
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import check_facts
from lensforge.shop.check_result import Check
from lensforge.shop.datums import datum_scheme
from lensforge.shop.dimensions import Dimension, dimensions
from lensforge.shop.drawing import GENERAL_NOTE, DrawingContent, SheetName, drawing_content, make_sheet
from lensforge.shop.findings import as_finding
from lensforge.shop.handover import Handover
from lensforge.shop.mould_facts import mould_facts
from lensforge.shop.mould_halves import Moulding
from lensforge.shop.profile_table import equation
from lensforge.shop.sheet import Marks, Sheet, box_of
from lensforge.shop.sheet_marks import dimension_text
from lensforge.shop.sheet_tables import optical_table, tolerance_table
from lensforge.shop.sheet_writers import sheet_dxf
from lensforge.shop.view_drawing import GATE, PARTING_LINE, PaperView, draw_views, room_of
from lensforge.surfaces.asphere import Asphere, Biconic
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace
from lensforge.surfaces.step_file import parts_of
from lensforge.surfaces.surface import to_sphere

FLANGE = {"diameter_mm": 20.0, "thickness_mm": 1.0, "setback_mm": 0.15, "tolerance_mm": 0.04}
WORDS = {
    "material_grade": "PMMA 8N", "finish": "VDI 3400, class 18", "optical_edge_mm": 0.06, "edge_break_mm": 0.3,
    "general_tolerances": "ISO 20457 TG6",
}  # fmt: skip
HEIGHT = ("height", 2.0, "axis", ((0.0, -1.0), (2.0, 0.0)))
MOULDED = {"process": "moulded", "shrinkage": 0.006}


def flanged(**changes: Any) -> Lens:
    sections = {"base": {"kind": "none"}, "manufacture": MOULDED, "drawing": WORDS, **changes}
    return spot_lens(spot(flange=FLANGE).replace(**sections))


def check_of(lens: Lens, verdicts: tuple[Fact, ...] = ()) -> Check:
    """A check of ``lens`` with the faces of another lens, under the names of this one."""
    check = bare_part()[1]
    faces = {name: check.faces["inner" if name in ("cap", "side") else "outer"] for name in lens.spec.lens.names}
    fields = {name: getattr(check, name) for name in type(check).model_fields}
    return Check.model_construct(**{**fields, "lens": lens, "verdicts": verdicts, **faces})


@cache
def drawn(name: SheetName = "A3") -> tuple[Lens, DrawingContent, Sheet]:
    lens = flanged()
    part = bare_part()[0].model_copy(update={"lens": lens, "volume_mm3": 1234.5, "mass_g": 1.469055})
    content = drawing_content(lens, part, check_of(lens), dimensions(lens), tolerance_table(lens), lens.spec.drawing)
    return lens, content, make_sheet(content, name)


def step_of(lens: Lens, schema: str = "AP214") -> Any:
    pair = fit_lens(lens)
    solid = on_base(lens.surfaces, pair, lens.spec.base, 24, 0.0, None, ring_of(lens, pair[1])).solid
    return signed_step(solid, lens.spec, "flanged", schema)


@cache
def measured() -> dict[str, tuple[tuple[float, float], tuple[float, float]]]:
    """Ends (z, x) of every size, of corners of the faces in the STEP and of what meets the axis."""
    from OCP.BRep import BRep_Tool
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    solid = parse_step(step_of(flanged()).content)
    corners = {
        name: sorted((p.Z(), np.hypot(p.X(), p.Y())) for p in map(BRep_Tool.Pnt_s, parts_of(face, "VERTEX")))
        for name, face in solid.faces.items()
    }
    on_axis = IntCurvesFace_ShapeIntersector()
    on_axis.Load(solid.shape, 1e-9)
    on_axis.Perform(gp_Lin(gp_Pnt(0.0, 0.0, 0.0), gp_Dir(0.0, 0.0, 1.0)), 0.1, 100.0)
    low, high = sorted(on_axis.Pnt(k + 1).Z() for k in range(on_axis.NbPnt()))
    (opening, cap), (rim, wall) = (
        (corners[f"OPTICAL_{name}"][0], corners[f"OPTICAL_{name}"][-1]) for name in ("SIDE", "WALL")
    )
    (under, foot), (top, radius) = corners["RIM_FLANGE_SIDE"][0], corners["RIM_FLANGE_SIDE"][-1]
    assert (radius - foot) / (top - under) == pytest.approx(np.tan(np.radians(1.0))), "a moulded side leans"
    exit_ = corners["OPTICAL_EXIT"][0]

    def across(corner: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
        return (corner[0], -corner[1]), corner

    return {
        "apex of the exit above z = 0": ((0.0, -rim[1]), (high, 0.0)),
        "apex of the cavity above z = 0": ((0.0, -rim[1]), (low, 0.0)),
        "thickness on the axis": ((low, 0.0), (high, 0.0)),
        "outer rim in z = 0, along x": across(rim),
        "opening of the cavity in z = 0, along x": across(opening),
        "crease of cap and side, along x": across(cap),
        "crease of cap and side, along x, above z = 0": ((0.0, cap[1]), cap),
        "crease of exit and flange, along x": across(exit_),
        "crease of flange and wall, along x, above z = 0": ((0.0, wall[1]), wall),
        "thickness of the rim's flange": ((under, -foot), (top, -radius)),
        "underside of the rim's flange above z = 0": ((0.0, -foot), (under, -foot)),
        "apex of the cavity to the rim's flange": ((low, 0.0), (under, -foot)),
        "diameter of the rim's flange": across((top, radius)),
    }


def test_each_size_in_the_dxf_is_that_of_the_step_and_stands_there_once() -> None:
    lens, _, sheet = drawn()
    document = ezdxf.read(io.StringIO(sheet_dxf(sheet).decode("utf-8")))
    names = [dimension.name for dimension in sheet.marks.dimensions]
    by_name = dict(zip(names, document.query("DIMENSION"), strict=True))
    assert set(by_name) == set(measured()) and len(names) == len(by_name), "none is missing, and none is drawn twice"
    for name, ends in measured().items():
        upright = int(ends[0][1] == -ends[1][1] != 0.0)
        dxf, length = by_name[name].dxf, abs(ends[1][upright] - ends[0][upright])
        assert [tuple(point)[:2] for point in (dxf.defpoint2, dxf.defpoint3)] == [
            pytest.approx(end, abs=1e-4) for end in ends
        ]
        assert by_name[name].get_measurement() == pytest.approx(length, abs=2e-4)
        before, after = ("%%c" if upright else ""), " %%p0.040" if "rim's flange" in name else " %%p0.020"
        is_own = "rim's flange" in name or name == "thickness on the axis"
        assert dxf.text == (f"{before}<>{after}" if is_own else f"({before}<>)"), name
        (text,) = (dimension.text for dimension in sheet.marks.dimensions if dimension.name == name)
        assert float(re.search(r"\d+\.\d{3}", text)[0]) == pytest.approx(length, abs=5.5e-4)
    assert {dimension.name for dimension in dimensions(lens)} > set(by_name), "the others are told in the list"
    names_of_base = {dimension.name: dimension for dimension in dimensions(small_lens({"diameter_mm": 12.5}))}
    assert names_of_base["largest width"].ends is None and names_of_base["diameter of the base"].ends, "the widest"


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (HEIGHT, ("length", 2.0, "part", ((0.0, 3.0), (2.0009, 1.0))), True),
        (HEIGHT, ("length", 2.0, "part", ((0.5, 3.0), (2.5, 1.0))), False),
        (HEIGHT, ("length", 2.0, "part", ((0.0, 3.0), (2.0011, 1.0))), False),
        (("base", 5.0, "base", ((0.0, -1.0), (5.0, 0.0))), ("again", 5.0, "base", ((0.0, -1.0), (5.0, 0.0))), False),
    ],
)  # fmt: skip
def test_a_size_repeats_another_where_both_ends_are_in_the_same_planes(one: Any, other: Any, same: bool) -> None:
    assert Dimension(*other).repeats(Dimension(*one)) is same
    upright = [replace(Dimension(*fields), upright=True) for fields in (one, other)]
    assert not upright[1].repeats(upright[0]), "across they end elsewhere"
    assert not upright[1].repeats(Dimension(*one)) and not replace(Dimension(*other), view="T").repeats(Dimension(*one))


def test_a_circle_of_the_base_is_its_own_but_the_largest_width_is_one_of_the_others() -> None:
    base, rim, wide = (
        Dimension(scope, 7.0, scope, ((0.0, -3.5), (0.0, 3.5)), view, upright=upright, sign="⌀")
        for scope, view, upright in (("base", "S", True), ("section", "S", True), ("part", "dome", False))
    )
    assert wide.repeats(base) and wide.repeats(rim) and not rim.repeats(base) and not base.repeats(rim)
    assert not wide.repeats(replace(rim, value_mm=7.0011)) and wide.repeats(replace(rim, value_mm=7.0009))


def test_lines_of_dimensions_leave_room_for_their_letters_and_no_more() -> None:
    """The less they take, the larger the scale: letters 2.5 mm high stand on a line, and clear of that above."""
    _, _, sheet = drawn()
    below = [
        dimension.line_mm
        for dimension in sheet.marks.dimensions
        if dimension.turned_deg == 0 and dimension.line_mm < sheet.origin[1]
    ]
    apart = np.diff(sorted(set(np.round(below, 6))))
    assert len(apart) >= 3 and 1.85 * 2.5 < apart.min() < 6.0


def test_the_datums_of_a_flange_are_on_it_and_those_of_a_body_of_revolution_its_axis() -> None:
    _, content, sheet = drawn()
    (_, _), (low, _) = measured()["underside of the rim's flange above z = 0"]
    assert [datum.letter for datum in content.views.datums.datums] == ["A", "B"]
    assert f"Datum A: underside of the rim's flange, RIM_FLANGE_BOTTOM, at z = {low:.3f}." in content.notes
    assert "Datum B: axis of the rim's flange, RIM_FLANGE_SIDE; the optical axis z." in content.notes
    triangles = [stroke.points for stroke in sheet.marks.strokes if stroke.filled and len(stroke.points) == 3]
    feet = [0.5 * (p + q) for p, q, _ in triangles if abs(np.linalg.norm(p - q) - 2.6) < 0.01]  # no arrows
    letters = {label.text: np.array(label.at) for label in sheet.marks.texts if label.text in ("A", "B", "C")}
    near = {name: min(feet, key=lambda foot: np.linalg.norm(foot - at)) for name, at in letters.items()}
    assert set(near) == {"A", "B"}
    assert near["A"][0] == pytest.approx(sheet.origin[0] + sheet.scale * low, abs=1e-3)
    (width,) = (dimension for dimension in sheet.marks.dimensions if dimension.name == "diameter of the rim's flange")
    assert near["B"] == pytest.approx((width.line_mm, sheet.origin[1] + 10.0 * sheet.scale)), "in line with the size"
    assert width.line_mm > sheet.origin[0] + 11.0 * sheet.scale, "beside the part, whose exit is 10.8 mm above z = 0"
    bare = spot_lens(spot().replace(base={"kind": "none"}))
    lines = datum_scheme(bare, bare_part()[0].model_copy(update={"lens": bare})).lines
    assert lines == (
        "Datum A: plane z = 0, the ring RIM between the rims of the optical faces",
        "Datum B: axis of revolution of OPTICAL_WALL; the optical axis z",
    )
    carried = flanged(manufacture={**MOULDED, "form_tolerance_um": 5.0})
    assert {tolerance.datum_faces for tolerance in step_of(carried, "AP242").tolerances} == {("RIM_FLANGE_BOTTOM",)}


def rows_on(sheet: Sheet, face: str) -> list[np.ndarray]:
    """Numbers of the two rows, or columns, of a face, read from the sheet."""
    numbers = [text for text in sheet.marks.texts if re.fullmatch(r"-?\d+\.\d{4}", text.text)]
    begins = (f"{face.capitalize()} face: r", face.capitalize())  # of a row, and of a column, in which it is folded
    (head,) = (np.array(text.at) for text in sheet.marks.texts if text.text in begins)
    axis = int(min(abs(head[1] - number.at[1]) for number in numbers) < 0.01)  # in a row, or below each other
    lines = sorted({round(number.at[axis], 3) for number in numbers}, reverse=axis == 1)
    (start,) = (k for k, line in enumerate(lines) if abs(line - head[axis]) < 0.01)
    ordered = sorted(numbers, key=lambda number: number.at[0] - number.at[1])
    return [
        np.array([float(number.text) for number in ordered if abs(number.at[axis] - line) < 0.01])
        for line in lines[start : start + 2]
    ]


@pytest.mark.parametrize("size", ["A3", "A4"])
def test_the_profiles_on_the_sheet_give_the_exported_faces_within_what_they_state(size: SheetName) -> None:
    lens, content, sheet = drawn(size)
    cavity, envelope = fit_lens(lens)
    patches = {face.name: face.shape for pair in (cavity, envelope) for face in pair.faces}
    stated = [float(re.search(r"within ([\d.]+) µm", row[0])[1]) for row in content.profiles[1::2]]
    boxes_of(sheet)
    listed = [name for name in reversed(TIR) if equation(lens.surfaces[name]) is None]
    assert listed == ["exit", "wall", "cap"] and len(stated) == 3
    for name, most_um in zip(listed, stated, strict=True):
        r, z = rows_on(sheet, name)
        assert len(r) == len(z) == 17 and np.ptp(np.hypot(np.diff(r), np.diff(z))) < 0.01, "evenly"
        chords = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))])
        x, height = CubicSpline(chords, np.column_stack([r, z]))(np.linspace(0.0, chords[-1], 4001)).T
        away = np.hypot(x, height)
        u = np.column_stack([x / away, 0.0 * x, height / away])
        normal = lens.surfaces[name].normal(u)
        off_um = 1e3 * np.abs((away - patches[name].radius(u)) * np.sum(normal * u, axis=1)).max()
        assert 0.8 * most_um < off_um < most_um + 0.005, name
        ends = {"cap": (0.0, None), "exit": (0.0, None), "wall": (None, 0.0)}[name]
        assert ends[0] in (None, r[0]) and ends[1] in (None, z[-1]), "from the axis, or to the rim"
    sizes = {dimension.name: dimension.value_mm for dimension in dimensions(lens)}
    assert 2.0 * rows_on(sheet, "cap")[0][-1] == pytest.approx(sizes["crease of cap and side, along x"], abs=2e-4)
    assert 2.0 * rows_on(sheet, "wall")[0][-1] == pytest.approx(sizes["outer rim in z = 0, along x"], abs=2e-4)


@pytest.mark.parametrize(
    ("surface", "form", "zero"),
    [
        (Asphere(6.1, -5.3), "sphere", lambda r, z, s: np.hypot(r, z - s["z"]) - s["R"]),
        (
            Asphere(6.1, -5.3, -0.4, (1.3e-4, -2e-6)),
            "asphere",
            lambda r, z, s: s["z_v"] + (r**2 / s["R"]) / (1 + np.sqrt(1 - (1 + s["k"]) * r**2 / s["R"] ** 2))
            + s["A4"] * r**4 + s["A6"] * r**6 - z,
        ),
        (PlaneFace(60.0, 7.4), "plane", lambda r, z, s: z - s["z"]),
        (ConeFace(20.0, 3.3, -0.0349), "cone", lambda r, z, s: s["r"] - 0.0349 * z - r),
        (ConicFace(60.0, 3.1, 0.7), "conic", lambda r, z, s: np.hypot(r, z) - s["e"] * z - s["p"]),
        (
            Biconic(6.1, -5.3, -4.4, 0.1, 0.2),
            "biconic",
            lambda r, z, s: s["z_v"] + (r**2 / s["Rx"]) / (1 + np.sqrt(1 - (1 + s["kx"]) * r**2 / s["Rx"] ** 2)) - z,
        ),
    ],
)  # fmt: skip
def test_an_equation_holds_on_its_face_to_a_nanometre(surface: Any, form: str, zero: Any) -> None:
    text = equation(surface)
    sizes = {name: float(value) for name, value in re.findall(r"(\w+) = ([-\d.e]+)", text)}
    chart = np.column_stack([np.linspace(0.3, 0.6, 40), np.zeros(40)])
    points = surface.radius(to_sphere(chart))[:, None] * to_sphere(chart)
    assert text.startswith(form) and np.abs(zero(points[:, 0], points[:, 2], sizes)).max() < 2e-7
    if form == "cone":
        assert "3.3 − 0.0349 z, 1.999° to the axis" in text
    if form == "plane":
        assert equation(PlaneFace(60.0, 7.4, (0.1, 0.0, 1.0))) is None, "tilted"


def test_the_title_block_and_notes_are_in_the_words_of_a_toolmaker() -> None:
    lens, content, sheet = drawn()
    assert content.block["material"] == ("Material: PMMA at 564 nm", "Grade: PMMA 8N", "Process: moulded")
    assert content.block["mass"] == ("Density: 1.19 g/cm³", "Mass: 1.469 g; Volume: 1234.5 mm³")
    assert {*content.block["material"], *content.block["mass"]} < {label.text for label in sheet.marks.texts}
    assert content.notes[-2].startswith("Draft of the rim's flange: 1°; size at its top")
    assert content.notes[-5:-2] == [
        "Rims and creases of the optical faces: R 0.06 at most. "
        "All other edges: radius or chamfer 0.3 at most; without flash.",
        "Optical faces: polished, without marks of gate, ejector or parting line. All other faces: VDI 3400, class 18.",
        "Sizes are those of the moulded part; the faces of the mould inserts are these times 1.006 about the origin.",
    ]
    spec = flanged(drawing={}, manufacture={"process": "moulded"}).spec.replace(
        {"lens.material": "own", "lens.refractive_index": 1.5}
    )
    part = bare_part()[0].model_copy(update={"lens": replace(lens, spec=spec), "mass_g": None})
    bare = drawing_content(part.lens, part, check_of(lens), [], tolerance_table(lens), spec.drawing)
    assert bare.block["mass"] == ("Density: not stated", f"Volume: {part.volume_mm3:.1f} mm³")
    for phrase in ("faces: largest radius not", "edges: largest break not", "faces: finish not", "Shrinkage: not"):
        assert sum(f"{phrase} stated" in note for note in bare.notes) == 1, phrase
    shapes = {name: column.get("shape", "") for name, column in content.table.columns.items()}
    assert shapes["side"] == equation(lens.surfaces["side"]) and shapes["wall"].startswith("of revolution, profile in")
    assert not any("GS" in column["title"] for column in content.table.columns.values())
    assert GENERAL_NOTE not in content.notes
    general = drawing_content_of_spheres()
    titles = {name: column["title"] for name, column in general.table.columns.items()}
    assert titles["outer"] == "Outer face, GS: OPTICAL_OUTER" and titles["inner"] == "Inner face, GS: OPTICAL_INNER"
    assert GENERAL_NOTE in general.notes and "lens.step, SHA-256 " in general.block["defined"][0]
    assert general.table.columns["outer"]["shape"].startswith("freeform; best-fit R")
    assert not any("spline" in note or "Asphere" in note for note in drawing_content_of_spheres().notes[:3])


def drawing_content_of_spheres() -> DrawingContent:
    part, check = bare_part()
    return drawing_content(part.lens, part, check, [], tolerance_table(part.lens), part.lens.spec.drawing)


def test_figures_of_the_faces_are_the_parts_though_the_record_is_of_an_insert_that_is_larger() -> None:
    lens, part = flanged(), bare_part()[0]
    part_check, insert = check_of(lens), check_of(lens)
    for name, face in part_check.faces.items():
        sphere = face.best_fit_sphere.changed(
            radius_mm=1.006 * face.best_fit_sphere.radius_mm, pv_mm=1.006 * face.best_fit_sphere.pv_mm
        )
        larger = face.changed(best_fit_sphere=sphere, area_mm2=1.006**2 * face.area_mm2)
        insert.__pydantic_extra__[name] = larger
    insert = insert.model_copy(update={"scale": 1.006})
    of_part, of_insert = (optical_table(lens, part, check, lens.spec.drawing) for check in (part_check, insert))
    assert of_part == of_insert
    (first,) = re.findall(r"best-fit R ([0-9.]+)", of_insert.columns["wall"]["shape"])
    assert float(first) == pytest.approx(part_check.faces["wall"].best_fit_sphere.radius_mm, abs=5.1e-4)
    told = {fact.key: fact.note for group in check_facts(insert) for fact in group.facts}
    for key in ("sphere", "departure", "departure_rms", "area", "concave"):
        assert "of the mould insert" in told[f"wall_{key}"], key
    cut = {
        fact.key: fact.note
        for group in check_facts(part_check.model_copy(update={"lens": flanged(manufacture={})}))
        for fact in group.facts
    }
    assert not any("insert" in note for note in cut.values())


def test_what_the_flange_leaves_of_its_cylinder_has_no_draft_and_is_said() -> None:
    """From the wall to the underside, and from the top to the exit, as the corners in the STEP have it."""
    lens, sizes = flanged(), measured()
    mould = Moulding.of(lens, fit_lens(lens)).mould()
    (under, _), (top, _) = sizes["thickness of the rim's flange"]
    (wall, radius), (exit_, _) = (
        sizes["crease of flange and wall, along x, above z = 0"][1],
        sizes["crease of exit and flange, along x"][1],
    )
    heights = [(cylinder.low_mm, cylinder.high_mm) for cylinder in mould.upright]
    within_mm = 5e-5  # form error of either fit of the faces
    assert heights == [pytest.approx((wall, under), abs=within_mm), pytest.approx((top, exit_), abs=within_mm)]
    assert [cylinder.radius_mm for cylinder in mould.upright] == pytest.approx([radius] * 2, abs=within_mm)
    text = (
        f"cylinder ⌀{2.0 * radius:.3f} beside the flange, z = {wall:.3f} to {under:.3f} and {top:.3f} to {exit_:.3f} mm"
    )
    told = {fact.key: fact.value for fact in mould_facts(mould, check_of(lens))}
    assert told["upright"] == text
    part, check = bare_part()[0].model_copy(update={"lens": lens}), check_of(lens).model_copy(update={"mould": mould})
    notes = drawing_content(lens, part, check, dimensions(lens), tolerance_table(lens), lens.spec.drawing).notes
    assert f"Without draft: {text}." in notes
    bare = Moulding.of(spot_lens(), fit_lens(spot_lens())).mould()
    assert bare.upright == () and "upright" not in {fact.key for fact in mould_facts(bare, check)}


def test_the_room_of_a_dimension_holds_its_text() -> None:
    for dimension in drawn()[2].marks.dimensions:
        left, bottom, right, top = room_of(Marks(dimensions=[dimension]))
        text = box_of(dimension_text(dimension))
        assert left <= text[0] and bottom <= text[1] and text[2] <= right and text[3] <= top, dimension.name


def test_the_parting_line_is_where_the_section_along_x_is_widest() -> None:
    lens = small_lens({"kind": "none"}, MOULDED)
    check = bare_part()[1].model_copy(update={"mould": Moulding.of(lens, fit_lens(lens)).mould()})
    part = bare_part()[0].model_copy(update={"lens": lens})

    def widest(azimuth_deg: float) -> tuple[float, float]:
        angles = np.linspace(0.0, 0.5 * np.pi, 20_001)
        along = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))])
        directions = np.column_stack([np.sin(angles)[:, None] * along, np.cos(angles)])
        radius_mm = lens.surfaces["outer"].radius(directions)
        place = int(np.argmax(radius_mm * np.sin(angles)))
        return radius_mm[place] * np.cos(angles[place]), radius_mm[place] * np.sin(angles[place])

    views = drawing_content(lens, part, check, dimensions(lens), tolerance_table(lens), lens.spec.drawing).views
    height_mm, across_mm = views.mould[PARTING_LINE]
    assert across_mm == pytest.approx(widest(0.0)[1], abs=1e-3) and height_mm == pytest.approx(widest(0.0)[0], abs=0.1)
    second_deg = other_section_deg(lens)
    assert second_deg is not None and abs(widest(second_deg)[1] - across_mm) > 0.01
    view = PaperView(2.0, 0.7, (150.0, 90.0))
    marks = draw_views(replace(views, mould={**views.mould, GATE: (1.0, 5.0)}), view)
    labels = {label.text: box_of(label) for label in marks.texts}
    assert labels[PARTING_LINE][0] > view.at((height_mm, across_mm))[0], "right of its arrow"
    assert labels[GATE][2] < view.at((1.0, 5.0))[0], "left of its arrow"


def test_findings_are_on_the_drawing_where_they_do_not_hold_and_matter() -> None:
    lens = flanged()
    draft = as_finding(Fact("draft", "", 1.25, "deg", sense=">=", limit=2.0, note="", place="wall"))
    ball, held = (
        replace(as_finding(replace(draft, key="cutter", sense="<=", limit=1.0)), place="cap"),
        replace(draft, value=3.0),
    )
    part = bare_part()[0].model_copy(update={"lens": lens})

    def open_findings(of: Lens, *verdicts: Fact) -> list[str]:
        content = drawing_content(of, part, check_of(of, verdicts), [], tolerance_table(of), of.spec.drawing)
        return [note for note in content.notes if note.startswith("Open")]

    told = "Open, see manufacturing.html: wall face, draft large enough: no, 1.25 deg (required ≥ 2 deg)"
    assert open_findings(lens, as_finding(held)) == []
    assert open_findings(lens, draft, ball) == [f"{told}."], "no tool of a moulded part"
    (cut,) = open_findings(flanged(manufacture={}), draft, ball)
    assert cut == f"{told}; cap face, ball reaches the face: no, 1.25 deg (required ≤ 1 deg)."
    assert open_findings(lens, *[draft] * 5)[0].endswith("; 2 more.")


def test_the_screen_says_of_what_the_points_are() -> None:
    bare = dict.fromkeys(("html", "pdf", "dxf", "points_csv"), b"")
    inserts = "for a measuring machine: points of the mould inserts"
    phrases = {1.006: f"{inserts} (the lens times 1.006)", 1.0: f"{inserts} (no shrinkage stated)"}
    for scale, note in {**phrases, None: "for a measuring machine"}.items():
        made = Handover(name="a lens", points=5, scale=scale, grids=(), sha256={}, refused=(), **bare)
        assert made.facts.fact("points").note == note
