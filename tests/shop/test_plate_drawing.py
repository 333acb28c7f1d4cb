"""The drawing of the plate: its pattern found again, its sizes read back from the DXF, and its part in the handover."""

import io
import re
from dataclasses import replace
from itertools import combinations
from typing import Any

import ezdxf
import numpy as np
import pytest
import trimesh
from scenes import small_spec, sphere
from shop_lenses import small_lens

from lensforge.cad.part import Part
from lensforge.cad.part_export import build_part
from lensforge.cad.plate_layout import layout_of
from lensforge.results.numerals import quantity
from lensforge.scene.lens import Lens
from lensforge.shop.check import check_lens
from lensforge.shop.datums import labelled, plate_datums
from lensforge.shop.drawing import title_block
from lensforge.shop.plate_drawing import _below_mm, gate_of, pattern_of, place_rows, plate_notes, plate_sheet
from lensforge.shop.point_tables import GridRequest
from lensforge.shop.sheet import Sheet, box_of
from lensforge.shop.sheet_marks import dimension_text
from lensforge.shop.sheet_writers import sheet_dxf
from lensforge.shop.shop_files import make_handover
from lensforge.shop.view_lines import dome_radius, front_line
from lensforge.spec.lamps_section import GridLamps, HexagonLamps, RingLamps, TableLamps
from lensforge.surfaces.srbf import fibonacci_hemisphere

PLATE = {"thickness_mm": 2.5, "margin_mm": 3.0}
MARKS: dict[str, Any] = {
    "holes": [{"place_mm": [10.0, 0.0], "diameter_mm": 3.0}],
    "pins": [{"place_mm": [-10.0, 8.0], "diameter_mm": 2.0, "height_mm": 1.25}],
    "bosses": [
        {"place_mm": [0, 0], "diameter_mm": 5.0, "height_mm": 2.0, "bore_diameter_mm": 2.5, "bore_depth_mm": 3.0}
    ],
    "gate": {"place_mm": [-31.0, 0.0], "width_mm": 6.0},
}
L_LOOP = [
    [-10.0, -12.0, 0.0],
    [42.0, -12.0, 0.0],
    [42.0, 9.0, 0.0],
    [9.0, 9.0, 0.0],
    [9.0, 31.0, 0.0],
    [-10.0, 31.0, 0.0],
]
SLOT, DISC = (
    [[12.0, -6.0, 1.0], [14.0, -6.0, 0.0], [14.0, 2.0, 1.0], [12.0, 2.0, 0.0]],
    [[19.0, 5.0, 1.0], [16.0, 5.0, 1.0]],
)
DRAWN = {
    "kind": "step",
    "thickness_mm": 2.0,
    "outline": {"origin": "drawn.step", "loops_mm": [L_LOOP, SLOT[::-1], DISC]},
}
GRID = {"kind": "grid", "columns": 3, "rows": 2, "pitch_mm": [20.0, 25.0]}
KINDS: dict[str, tuple[dict[str, Any] | None, dict[str, Any]]] = {
    "grid": (GRID, {**PLATE, **MARKS, "corner_radius_mm": 2.0}),
    "hexagon": ({"kind": "hexagon", "rings": 1, "pitch_mm": 20.0}, {**PLATE, "kind": "round"}),
    "ring": ({"kind": "ring", "count": 5, "diameter_mm": 60.0}, {**PLATE, "kind": "round"}),
    "table": ({"kind": "table", "places_mm": [[0.0, 0.0], [17.0, 3.0], [30.0, -14.0]]}, PLATE),
    "one": (None, PLATE),
    "kinds": ({"kind": "grid", "columns": 3, "rows": 1, "pitch_mm": 20.0, "kinds": "place"}, PLATE),
    "drawn": ({"kind": "table", "places_mm": [[0.0, 0.0], [30.0, -2.0], [0.0, 20.0]]}, DRAWN),
}


def lens_on(kind: str) -> Lens:
    lamps, plate = KINDS[kind]
    lens = small_lens({"kind": "none"}, lamps=lamps, plate=plate)
    other = {"inner": sphere(2.5), "outer": sphere(5.5)}
    return replace(lens, others={kind.name: other for kind in lens.spec.all_lamps.kinds[1:]})


@pytest.fixture(scope="module")
def part() -> Part:
    return build_part(lens_on("grid"), rings=16)


def sheet_of(part: Part, kind: str, name: str = "A3") -> Sheet:
    lens = lens_on(kind)
    layout = layout_of(lens)
    assert layout is not None
    return plate_sheet(lens, part, layout, lens.spec.drawing, name)  # type: ignore[arg-type]


def test_patterns_are_found_again() -> None:
    grid = pattern_of(GridLamps(columns=4, rows=3, pitch_mm=(20.0, 15.0)).lamps)
    assert grid is not None and (grid.pitch_mm, grid.count, grid.first) == ((20.0, 15.0), (4, 3), (-30.0, -15.0))
    hexagon = pattern_of(HexagonLamps(rings=2, pitch_mm=20.0).lamps)
    assert hexagon is not None and hexagon.count == (5, 5) and hexagon.row_mm == 0.0
    assert hexagon.pitch_mm == pytest.approx((20.0, 20.0 * np.sin(np.pi / 3.0)))
    ring = pattern_of(RingLamps(count=7, diameter_mm=50.0).lamps)
    assert ring is not None and ring.ring_mm == pytest.approx(50.0)
    assert pattern_of(TableLamps(places_mm=((0.0, 0.0), (20.0, 0.0), (45.0, 0.0))).lamps) is None
    assert pattern_of(TableLamps(places_mm=((0.0, 0.0), (20.0, 1.0), (45.0, 3.0))).lamps) is None


def test_each_place_has_its_kind_and_each_lens_its_sheet() -> None:
    """The ends of a row have one lens, turned; from above each dome and opening is that of its kind."""
    lens = lens_on("kinds")
    layout, one = layout_of(lens), build_part(lens_on("one"), rings=16)
    assert layout is not None
    assert [row.feature for row in place_rows(layout)] == ["lens edge, turned by 180.000°", "lens middle", "lens edge"]
    blocks = [title_block(kind, one.changed(plate=None), lens.spec.drawing) for kind in lens.kinds]
    assert [block["scale"] for block in blocks] == [
        ("sheet 2 of 3, manufacturing.pdf",),
        ("sheet 3 of 3, manufacturing.pdf",),
    ]
    assert blocks[1]["name"] == ("shop, lens edge of the plate",)
    sheet = plate_sheet(lens, one, layout, lens.spec.drawing)
    round_ones = [stroke.points for stroke in sheet.marks.strokes if stroke.closed and len(stroke.points) == 181]
    widths = [np.ptp(ring[:, 0]) / sheet.scale for ring in round_ones]
    assert [widths[k] for k in (0, 1, 4, 5)] == pytest.approx([11.0, 5.0, 11.0, 5.0], abs=1e-3)
    assert widths[2] > 11.5 and widths[3] > 5.5
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 4001)
    along_x = np.column_stack([np.sin(angles), np.zeros(4001), np.cos(angles)])
    top_mm = float((lens.kinds[0].surfaces["outer"].radius(along_x) * along_x[:, 2]).max())
    told = {dimension.name: dimension.text for dimension in sheet.marks.dimensions}["height of lens middle"]
    assert float(told.strip("()")) == pytest.approx(top_mm, abs=1e-3) and abs(top_mm - 5.5) > 0.1


def test_frames_of_datums_lie_on_no_lens_and_a_moulded_plate_shows_where_it_is_filled(part: Part) -> None:
    """Holes between lenses: below them the next lens is in the way. The gate is in the middle of a longest side."""
    sheet, layout = sheet_of(part, "grid"), layout_of(lens_on("grid"))
    assert layout is not None
    letters = {label.text: np.array(label.at) for label in sheet.marks.texts if label.text in ("B", "C")}
    assert set(letters) == {"B", "C"}
    middles = np.array(sheet.origin) + sheet.scale * np.array(layout.lenses.places_mm)
    dome_mm = float(dome_radius(lens_on("grid"), np.zeros(1))[0])
    for letter, at in letters.items():
        assert np.linalg.norm(middles - at, axis=1).min() > sheet.scale * dome_mm, letter
    unplaced = {**PLATE, "holes": MARKS["holes"]}
    lens = small_lens({"kind": "none"}, lamps=GRID, plate=unplaced)
    bare = layout_of(lens)
    assert bare is not None and lens.spec.manufacture.process == "moulded"
    gate, (low, high) = gate_of(lens, bare), bare.box_mm
    assert gate is not None
    wide, tall = high[0] - low[0], high[1] - low[1]
    assert min(abs(abs(gate[0]) - wide / 2.0), abs(abs(gate[1]) - tall / 2.0)) < 1e-9 and 0.0 in np.round(gate, 9)
    assert any(note.startswith("G, gate: proposed") for note in plate_notes(lens, bare, lens.spec.drawing))
    milled = small_lens({"kind": "none"}, {"process": "milled"}, lamps=GRID, plate=unplaced)
    assert gate_of(milled, bare) is None


@pytest.mark.parametrize("name", ["A3", "A4"])
def test_sizes_read_back_from_the_dxf_are_those_of_the_design(part: Part, name: str) -> None:
    """Also those of the section of one lens, which is drawn at another scale; with eight millimetres of a lens."""
    sheet = sheet_of(part, "grid", name)
    document = ezdxf.read(io.StringIO(sheet_dxf(sheet).decode("utf-8")))
    assert not document.audit().errors
    pens = [document.layers.get(pen).dxf.lineweight for pen in ("OUTLINE", "HIDDEN", "HATCH")]
    assert pens == {"A3": [50, 25, 9], "A4": [35, 18, 9]}[name], "hundredths of a millimetre, as a DXF has them"
    lengths = {}
    for dimension, mark in zip(sheet.marks.dimensions, document.modelspace().query("DIMENSION"), strict=True):
        factor = mark.override().get("dimlfac", 1.0)
        lengths[dimension.name] = mark.get_measurement() * factor
        assert lengths[dimension.name] == pytest.approx(dimension.length_mm, abs=1e-9), dimension.name
        texts = [
            e.dxf.text if e.dxftype() == "TEXT" else e.text for e in mark.virtual_entities() if "TEXT" in e.dxftype()
        ]
        assert f"{dimension.length_mm:.3f}" in "".join(texts)
    lens = lens_on("grid")
    around = 2.0 * (8.0 + 3.0)  # constraints.max_radius_mm and the margin
    x = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    wanted = {
        "width of the plate": 40.0 + around, "height of the plate": 25.0 + around,
        "pitch of the lenses along x": 40.0, "pitch of the lenses along y": 25.0,
        "edge to the first lens along x": 11.0, "edge to the first lens along y": 11.0,
        "thickness of the plate": 2.5, "height below the plate": 2.0,
        "rim of a lens in z = 0": lens.outer.radius(x).sum(), "opening of a lens in z = 0": lens.inner.radius(x).sum(),
    }  # fmt: skip
    assert {key: lengths[key] for key in wanted} == pytest.approx(wanted, abs=1e-6)
    assert lengths["height of a lens"] > lengths["height of a cavity"] > 2.0
    seen = [
        stroke.points / sheet.scale for stroke in sheet.marks.strokes if len(stroke.points) == 4 and not stroke.closed
    ]
    wide = 2.5 + 6.0 * np.tan(np.radians(1.0))  # of the bore at its mouth, by the draft
    pin, boss, bore = seen  # from the front: widths and heights, and the pin 10 mm to the left of the boss
    assert [np.ptp(outline, axis=0) for outline in seen] == [pytest.approx(xy) for xy in ([2, 1.25], [5, 2], [wide, 3])]
    assert [np.mean(circle - pin, axis=0)[0] for circle in (boss, bore)] == pytest.approx([10.0, 10.0])
    below = [dimension.length_mm for dimension in sheet.marks.dimensions if dimension.name == "height below the plate"]
    assert sorted(below) == [1.25, 2.0]  # of the pin, and of the boss
    for axis, outermost in ((0, 20.0), (1, 12.5)):
        (pitch,) = (
            dimension
            for dimension in sheet.marks.dimensions
            if dimension.name == f"pitch of the lenses along {'xy'[axis]}"
        )
        ends = [(np.array(end) - sheet.origin) / sheet.scale for end in (pitch.start, pitch.end)]
        assert [end[axis] for end in ends] == pytest.approx([-outermost, outermost]), "the outermost axes"
        places = np.array(lens.spec.all_lamps.places_mm)
        assert all(np.abs(places - end).sum(axis=1).min() < 1e-9 for end in ends), "both at lenses"
    texts = {dimension.name: dimension.text for dimension in sheet.marks.dimensions}
    assert texts["pitch of the lenses along x"] == "2 × 20.000 = 40.000"
    assert texts["pitch of the lenses along y"] == "25.000"


@pytest.mark.parametrize("kind", KINDS)
def test_no_text_meets_another_or_the_frame(part: Part, kind: str) -> None:
    sheet = sheet_of(part, kind)
    boxes = [box_of(text) for text in (*sheet.marks.texts, *map(dimension_text, sheet.marks.dimensions))]
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    left, bottom, right, top = np.array(boxes).T
    assert left.min() > 20.0 and bottom.min() > 10.0 and right.max() < 410.0 and top.max() < 287.0
    drawn = {dimension.name for dimension in sheet.marks.dimensions}
    assert ("circle of the axes" in drawn) == (kind == "ring")
    rows = place_rows(layout_of(lens_on(kind)))  # type: ignore[arg-type]
    assert [row.label for row in rows] == {
        "grid": ["H1", "P1", "B1", "G"], "ring": ["L1", "L2", "L3", "L4", "L5"], "table": ["L1", "L2", "L3"],
        "kinds": ["L1", "L2", "L3"], "drawn": ["L1", "L2", "L3", "H1"]
    }.get(kind, [])  # fmt: skip


def test_lenses_of_the_drawing_stand_where_they_are(part: Part) -> None:
    """Circles in the view from above, about the plate's middle, at the places and as wide as the lenses."""
    sheet = sheet_of(part, "ring")
    lens = lens_on("ring")
    middles = []
    for stroke in sheet.marks.strokes:
        points = (stroke.points - sheet.origin) / sheet.scale
        width = float(np.ptp(points[:, 0]))
        if stroke.closed and stroke.pen == "outline" and 11.0 < width < 14.0 and len(points) > 100:
            middles.append(points[:-1].mean(axis=0))
    assert len(middles) == 5
    places = np.array(lens.spec.all_lamps.places_mm)
    away = np.linalg.norm(np.array(middles)[:, None] - places, axis=2)
    assert (away.min(axis=0) < 0.2).all()
    labels = {label.text: (np.array(label.at) - sheet.origin) / sheet.scale for label in sheet.marks.texts[::-1]}
    for number, place in enumerate(places, start=1):  # to the right and above of the lens, beside its circle
        across, up = labels[f"L{number}"] - place
        assert across == pytest.approx(up) and 7.0 < np.hypot(across, up) < 14.0


def test_the_handover_has_both_drawings(part: Part) -> None:
    check = check_lens(part.lens, part.nodes)
    made = make_handover(part, check, [], GridRequest(spacing_mm=1.0))
    assert {"plate.pdf", "plate.dxf", "lens.glb", "plate.glb"} < set(made.files) and made.files["plate.pdf"].startswith(
        b"%PDF"
    )
    largest = {}
    for name in ("plate.dxf", "drawing.dxf"):
        sizes = ezdxf.read(io.StringIO(made.files[name].decode("utf-8"))).modelspace().query("DIMENSION")
        largest[name] = max(size.get_measurement() * size.override().get("dimlfac", 1.0) for size in sizes)
    plate = trimesh.load_scene(io.BytesIO(made.models["plate.glb"]), file_type="glb")
    low, high = np.array(part.plate.bounds_mm if part.plate else [])
    np.testing.assert_allclose(1e3 * plate.bounds[1], [high[0], high[2], -low[1]], atol=1e-5)
    assert largest["plate.dxf"] == pytest.approx(max(high - low), abs=1e-3) and largest["drawing.dxf"] < 0.7 * max(high)
    page = made.html.decode("utf-8")
    assert page.count('<figure class="drawing">') == 2 and made.sha256["plate.dxf"] in page
    assert page.index("plate of 6 lenses") < page.index("sheet 1 of 2") < page.index("sheet 2 of 2"), "the plate first"
    assert "one lens of the plate" in page and "plate.step alone defines the part" in page
    shown = dict(re.findall(r"<th[^>]*>([^<]*)</th><td[^>]*>([^;<]*)", page))
    assert part.plate is not None and shown["Volume of the plate"] == quantity(part.plate.volume_mm3, "mm³", digits=5)
    assert "Volume" not in shown and "Mass" not in shown, "nobody makes the lens alone"
    for text in ("2 × 20.000 = 40.000", "hole ⌀3.000, through", "pin ⌀2.000, 1.250 below", "plate of 6 lenses"):
        assert text in page
    assert "boss ⌀5.000, 2.000 below; bore ⌀2.500, 3.000 deep" in page and "gate, 6.000 wide" in page


def test_a_drawn_outline_stands_as_it_is_drawn(part: Part) -> None:
    """Its loops in the axes of the file, and its bounding size."""
    sheet = sheet_of(part, "drawn")
    closed = [(stroke.points - sheet.origin) / sheet.scale for stroke in sheet.marks.strokes if stroke.closed]
    for loop in (L_LOOP, SLOT):
        corners = np.array(loop)[:, :2]
        assert any(np.abs(points[:, None] - corners).sum(axis=2).min(axis=0).max() < 1e-9 for points in closed)
    sizes = {dimension.name: dimension.length_mm for dimension in sheet.marks.dimensions}
    assert (sizes["width of the plate"], sizes["height of the plate"]) == pytest.approx((52.0, 43.0))
    notes = " ".join(text.text for text in sheet.marks.texts)
    assert "from the origin of drawn.step" in " ".join(notes.split())


@pytest.mark.parametrize("turn_deg", [0.0, 70.0])
def test_the_front_of_a_turned_lens_is_its_silhouette(turn_deg: float) -> None:
    """By all points of the dome, turned: the farthest of them in each direction of the plane across the view."""
    lens, (c, s) = small_lens(), (np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)))
    u = fibonacci_hemisphere(400_000)
    x, y, z = (lens.surfaces["outer"].radius(u)[:, None] * u).T
    seen, drawn = np.stack([c * x - s * y, z]), front_line(lens, turn_deg).T
    farthest = [np.zeros(90), np.zeros(90)]
    for radii, (across, up) in zip(farthest, (seen, drawn), strict=True):
        sector = np.clip((np.degrees(np.arctan2(across, up)) + 90.0) // 2.0, 0, 89).astype(int)
        np.maximum.at(radii, sector, np.hypot(across, up))
    np.testing.assert_allclose(farthest[1], farthest[0], rtol=0.0, atol=2e-3)


def test_the_height_over_all_begins_at_the_longest_pin() -> None:
    pins = [{"place_mm": [x, 0.0], "diameter_mm": 1.0, "height_mm": height} for x, height in ((9.0, 1.25), (-9.0, 2.0))]
    plate = {"thickness_mm": 1.5, "width_mm": 30.0, "height_mm": 30.0, "pins": pins}
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec(base={"kind": "none"}, plate=plate), 0, "draft")
    assert _below_mm(layout_of(lens)) == 3.5


@pytest.mark.parametrize(
    ("kind", "features"),
    [
        ("grid", ["axis of P1, pin", "axis of H1, hole"]),
        ("one", ["middle plane of the width of the plate", "middle plane of the height of the plate"]),
        ("hexagon", ["axis of the outline"]),
        ("drawn", ["axis of H1, hole"]),
    ],
)
def test_datums_of_a_plate_are_the_axes_that_place_it_or_its_outline(
    part: Part, kind: str, features: list[str]
) -> None:
    layout, sheet = layout_of(lens_on(kind)), sheet_of(part, kind)
    scheme = plate_datums(layout)  # type: ignore[arg-type]
    assert scheme.lines == (
        "Datum A: plane z = 0, the top of the plate",
        *(f"Datum {letter}: {feature}" for letter, feature in zip("BC", features, strict=False)),
    )
    triangles = [stroke.points for stroke in sheet.marks.strokes if stroke.filled and len(stroke.points) == 3]
    feet = np.array([0.5 * (p + q) for p, q, _ in triangles if abs(np.linalg.norm(p - q) - 2.6) < 0.01])  # no arrows
    letters = {text.text: np.array(text.at) for text in sheet.marks.texts if text.text in ("A", "B", "C")}
    assert len(feet) == len(letters) == 1 + len(features)
    at = {letter: feet[np.argmin(np.linalg.norm(feet - place, axis=1))] for letter, place in letters.items()}
    marks = dict(labelled(layout))  # type: ignore[arg-type]
    lines = {dimension.name: dimension for dimension in sheet.marks.dimensions}
    for datum in scheme.datums[1:]:
        if datum.dimension in marks:  # at the lowest place of its circle
            mark = marks[datum.dimension]
            below = np.array(mark.place_mm) - (0.0, mark.diameter_mm / 2.0)
            assert at[datum.letter] == pytest.approx(below * sheet.scale + sheet.origin)
        else:  # at the upper end of the dimension line
            line = lines[datum.dimension]
            assert at[datum.letter] == pytest.approx(line.at(line.ends_mm[1], line.line_mm))
    thickness = lines["thickness of the plate"]
    assert at["A"][1] == pytest.approx(max(thickness.start[1], thickness.end[1])), "level with the top"
    above = {letter: letters[letter][1] > at[letter][1] for letter in letters}
    assert above["A"] and not any(above[datum.letter] for datum in scheme.datums if datum.dimension in marks)


def test_one_hole_leaves_the_turn_to_the_outline() -> None:
    lens = small_lens({"kind": "none"}, lamps=GRID, plate={**PLATE, "holes": MARKS["holes"]})
    assert [datum.dimension for datum in plate_datums(layout_of(lens)).datums] == ["", "H1", "height of the plate"]  # type: ignore[arg-type]


def test_a_slotted_outline_without_axes_has_no_datums_across() -> None:
    lens = small_lens({"kind": "none"}, lamps=KINDS["drawn"][0], plate={**DRAWN, "outline": {"loops_mm": [L_LOOP]}})
    assert plate_datums(layout_of(lens)).lines[1].startswith("No datum feature for x and y")  # type: ignore[arg-type]


def test_tolerances_of_holes_and_pins_stand_in_the_table_against_the_datums_before_them() -> None:
    marks = {
        "holes": [
            {"place_mm": [10.0, 0.0], "diameter_mm": 3.0, "tolerance_mm": 0.05, "place_tolerance_mm": 0.08},
            {"place_mm": [10.0, 9.0], "diameter_mm": 2.0, "place_tolerance_mm": 0.2},
        ],
        "pins": [{"place_mm": [-10.0, 8.0], "diameter_mm": 2.0, "height_mm": 1.25, "tolerance_mm": 0.02,
                  "place_tolerance_mm": 0.1}],
    }  # fmt: skip
    lens = small_lens({"kind": "none"}, lamps=GRID, plate={**PLATE, **marks})
    rows = {row.label: row.feature for row in place_rows(layout_of(lens))}  # type: ignore[arg-type]
    assert rows == {
        "H1": "hole ⌀3.000 ±0.050, through; position ⌀0.08 | A | B; datum C",
        "H2": "hole ⌀2.000, through; position ⌀0.2 | A | B | C",
        "P1": "pin ⌀2.000 ±0.020, 1.250 below; position ⌀0.1 | A; datum B",
    }
