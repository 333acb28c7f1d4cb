"""The drawing: drawn once, its sizes those of the part and of the table, read back from the DXF and from the PDF."""

import io
import re
import zlib
from dataclasses import replace

import ezdxf
import numpy as np
import pytest
from ezdxf.entitydb import EntityDB
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as PolygonPath
from matplotlib.textpath import TextPath
from shop_lenses import BASE, all_words, bare_part, boxes_of, small_lens

from lensforge.cad.form_error import fit_lens
from lensforge.cad.part import Faces
from lensforge.cad.plan import make_plan
from lensforge.cad.solid import build_solid
from lensforge.cad.step import signed_step
from lensforge.errors import InputError
from lensforge.shop.check_facts import check_facts
from lensforge.shop.datums import datum_scheme
from lensforge.shop.dimensions import dimensions
from lensforge.shop.drawing import SIZES, _notes_box, drawing_content, inside_of, make_sheet, unit_of
from lensforge.shop.sheet import TYPEFACE, Marks, Sheet, SheetText, box_of, shown
from lensforge.shop.sheet_marks import axes_mark, dimension_text, paragraphs_in, strokes_of, text_span
from lensforge.shop.sheet_tables import _texture, index_wavelength, tolerance_table
from lensforge.shop.sheet_writers import _write_text, sheet_dxf, sheet_pdf
from lensforge.shop.view_drawing import SCALES, _candidates
from lensforge.shop.view_lines import end_lines
from lensforge.spec.part_section import read_drawing
from lensforge.spec.tolerances_section import PartTolerances
from lensforge.surfaces.srbf import fibonacci_hemisphere

ROUND = {"diameter_mm": 16.0}
BASES = {
    "full": {**BASE, "relief_setback_mm": 0.25, "bore_setback_mm": 0.1},
    "none": {"kind": "none"},
    "flat": {**ROUND, "flat_mm": 7.5},
    "square": {"kind": "square", "side_mm": 15.0, "height_mm": 3.0, "pocket_diameter_mm": 7.5},
    "below the dome": {"diameter_mm": 11.0},
}


def content_of(lens, part, check, sheet="A3"):
    content = drawing_content(lens, part, check, dimensions(lens), tolerance_table(lens), lens.spec.drawing)
    return content, make_sheet(content, sheet)


@pytest.fixture(scope="module")
def check():
    """Findings on one of the parts: those of the others differ in their base only."""
    return bare_part()[1]


@pytest.fixture(scope="module")
def part_of():
    """Parts as ``build_part`` makes them, as far as a drawing shows it: faces, author, tolerances."""

    def made(lens, schema="AP214"):
        solid = build_solid(make_plan(*fit_lens(lens), lens.spec.base))
        signed = signed_step(solid, lens.spec, "shop", schema)
        faces = Faces(count=len(solid.faces), names=tuple(sorted(solid.faces)))
        written = {"faces": faces, "signature": signed.signature, "form_tolerances": signed.tolerances}
        return bare_part()[0].model_copy(update={"lens": lens, **written})

    return made


@pytest.fixture(scope="module")
def parts(check, part_of):
    lenses = {name: small_lens(base) for name, base in BASES.items()}
    return {name: (lens, part_of(lens), check) for name, lens in lenses.items()}


@pytest.fixture(scope="module")
def drawings(parts):
    return {name: content_of(*results) for name, results in parts.items()}


def read_back(sheet):
    return ezdxf.read(io.StringIO(sheet_dxf(sheet).decode("utf-8")))


@pytest.mark.parametrize("name", BASES)
def test_the_dxf_read_back_has_no_errors_and_the_sizes_of_the_table(drawings, name):
    content, sheet = drawings[name]
    document = read_back(sheet)
    assert not document.audit().errors
    assert document.units == ezdxf.units.MM
    (height,) = {dimension_text(dimension).height_mm for dimension in sheet.marks.dimensions}
    assert document.dimstyles.get("LENSFORGE").dxf.dimtxt == pytest.approx(height / sheet.scale), "as on paper"
    measured = sorted(entity.get_measurement() for entity in document.modelspace().query("DIMENSION"))
    table = sorted(dimension.value_mm for dimension in content.views.dimensions if dimension.ends is not None)
    np.testing.assert_allclose(measured, table, atol=1e-9)
    for mark in document.modelspace().query("DIMENSION"):  # what a reader sees is what it measures
        texts = [
            entity.dxf.text if entity.dxftype() == "TEXT" else entity.text
            for entity in mark.virtual_entities()
            if entity.dxftype() in ("TEXT", "MTEXT")
        ]
        assert shown(mark.get_measurement()) in "".join(texts)


@pytest.mark.parametrize("name", BASES)
def test_the_lines_of_the_outer_rim_go_where_less_of_the_section_is(drawings, name):
    """Beside a base that is wider they would cross it, beside the dome that swells a little above its rim."""
    marks = drawings[name][1].marks
    outlines = [stroke.points for stroke in marks.strokes if stroke.pen == "outline" and stroke.closed]
    rims = [mark for mark in marks.dimensions if mark.name.startswith("outer rim") and mark.turned_deg == 90]
    assert len(rims) == 2
    for rim in rims:
        section = min(outlines, key=lambda points: np.linalg.norm(points - rim.start, axis=1).min())
        x, y = np.array([rim.start, rim.end]).T
        crossed = {}
        for side in (-1.0, 1.0):
            along = x[:, None] + side * np.linspace(0.05, 30.0, 2000)
            line = np.column_stack([along.ravel(), np.repeat(y, 2000)])
            crossed[side] = int(PolygonPath(section).contains_points(line).sum())
        assert crossed[np.sign(rim.line_mm - x[0])] == min(crossed.values())


def test_the_same_sheet_is_the_same_dxf_in_whatever_order_a_set_is_walked_through(drawings, monkeypatch):
    """The order of a set of words is another one in every process."""
    _, sheet = drawings["full"]
    used = EntityDB.dxf_types_in_use
    files = set()
    for order in (sorted, lambda names: sorted(names, reverse=True)):
        monkeypatch.setattr(EntityDB, "dxf_types_in_use", lambda database, order=order: order(used(database)))
        files.add(sheet_dxf(sheet))
    assert len(files) == 1


@pytest.mark.parametrize("name", BASES)
def test_the_section_in_the_dxf_is_the_part_at_its_size_in_its_coordinates(parts, drawings, name):
    lens, _, _ = parts[name]
    document = read_back(drawings[name][1])
    chains = [
        np.array(entity.get_points("xy")) for entity in document.modelspace().query("LWPOLYLINE[layer=='OUTLINE']")
    ]
    section = max((chain for chain in chains if np.abs(chain).max() < 30.0), key=len)
    z, x = section[section[:, 0] > 1e-6].T
    directions = np.column_stack([x, np.zeros_like(x), z])
    distance = np.linalg.norm(directions, axis=1)
    directions /= distance[:, None]
    off = np.minimum(*(np.abs(face.radius(directions) - distance) for face in (lens.inner, lens.outer)))
    assert len(z) > 500
    assert off.max() < 1e-9


@pytest.mark.parametrize("name", BASES)
@pytest.mark.parametrize("size", SIZES)
def test_no_text_meets_another_nor_a_line_of_a_dimension_nor_the_edge(drawings, name, size):
    sheet = make_sheet(drawings[name][0], size)
    lines = [
        stroke.points for dimension in sheet.marks.dimensions for stroke in strokes_of(dimension) if not stroke.filled
    ]
    for left, bottom, right, top in boxes_of(sheet):
        for (x1, y1), (x2, y2) in lines:
            apart = max(x1, x2) <= left or min(x1, x2) >= right or max(y1, y2) <= bottom or min(y1, y2) >= top
            assert apart, "a line crosses a text"
    heights = {label.height_mm for label in all_words(sheet)}
    assert len(heights) == 1 and heights.pop() >= 1.75


def test_the_scale_is_one_of_iso_5455_and_the_views_have_it(parts, drawings):
    for name, (content, sheet) in drawings.items():
        assert sheet.scale in {2.0, 5.0, 10.0}, name
        points = np.concatenate(content.views.sections[0].outlines)
        low = points[:, 0].min()
        high = points[:, 0].max()
        lengths = [
            np.ptp(stroke.points[:, 0]) for stroke in sheet.marks.strokes if stroke.pen == "outline" and stroke.closed
        ]
        assert any(length == pytest.approx(sheet.scale * (high - low), abs=1e-9) for length in lengths)
        assert any(label.text == f"Scale: {sheet.scale:g} : 1" for label in sheet.marks.texts)
    content, _ = drawings["full"]
    for wanted, size in SIZES.items():
        sheet = make_sheet(content, wanted)
        assert (sheet.name, sheet.size_mm) == (wanted, size)
    assert make_sheet(content, "A4").scale <= make_sheet(content, "A3").scale


def test_a_page_of_the_pdf_is_the_sheet_in_vectors_at_its_size(drawings):
    _, sheet = drawings["square"]
    content = sheet_pdf(sheet)
    width, height = (float(v) for v in re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content).groups())
    assert (width / 72.0 * 25.4, height / 72.0 * 25.4) == pytest.approx(sheet.size_mm)
    assert b"/Subtype /Image" not in content
    matches = re.findall(rb"stream\r?\n(x.*?)\nendstream", content, re.DOTALL)
    streams = [zlib.decompressobj().decompress(stream) for stream in matches]
    page = next(stream for stream in streams if stream.count(b" l\n") > 500)
    # The base, 15 mm square: its lower edge is a straight line of that length times the scale.
    points = np.array([[float(v) for v in pair] for pair in re.findall(rb"([\d.-]+) ([\d.-]+) [ml]\n", page)])
    sides = np.abs(np.diff(points, axis=0)) / 72.0 * 25.4
    assert np.any(np.abs(sides[:, 0] - 15.0 * sheet.scale) < 1e-3)


@pytest.mark.parametrize(
    ("name", "faces", "absent"),
    [
        (
            "none",
            ["Datum A: plane z = 0, the ring RIM", "No datum feature for the axis"],
            ["Datum B", "Datum C", "flat"],
        ),
        ("flat", ["Datum A: plane z = 0, the top", "Datum B: axis", "Datum C: clocking flat"], ["no azimuth"]),
        ("square", ["Datum B: middle plane", "Datum C: middle plane", "+x is not marked"], ["flat", "axis of the"]),
        ("full", ["Datum A: bottom of the base, BASE_BOTTOM, at z = -2", "no azimuth"], ["clocking flat", "Datum C"]),
        ("below the dome", ["Datum A: bottom of the base", "Datum B: axis of the base's cylinder"], ["Datum C"]),
    ],
)
def test_the_datums_are_features_of_the_part(parts, drawings, name, faces, absent):
    lens, part, _ = parts[name]
    scheme = datum_scheme(lens, part)
    text = "\n".join(scheme.lines)
    for feature in faces:
        assert feature in text
    for feature in absent:
        assert feature not in text
    for word in re.findall(r"\b(?:BASE|RIM|OPTICAL)[A-Z_]*\b", text):
        assert any(face.startswith(word) for face in part.faces.names), word
    letters = [label.text for label in drawings[name][1].marks.texts if label.text in ("A", "B", "C")]
    assert sorted(letters) == sorted(datum.letter for datum in scheme.datums), "each symbol once"


def test_the_symbol_of_the_clocking_flat_stands_on_it(drawings):
    _, sheet = drawings["flat"]
    letter = next(label for label in sheet.marks.texts if label.text == "C")
    triangles = [stroke.points for stroke in sheet.marks.strokes if stroke.filled and len(stroke.points) == 3]
    feet = np.array([0.5 * (corners[0] + corners[1]) for corners in triangles])
    foot = feet[np.argmin(np.linalg.norm(feet - letter.at, axis=1))]
    edges = np.concatenate(
        [
            np.stack([stroke.points[:-1], stroke.points[1:]], axis=1)
            for stroke in sheet.marks.strokes
            if stroke.pen == "outline"
        ]
    )
    ways = np.linalg.norm(edges - foot, axis=2).sum(axis=1) - np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert ways.min() < 1e-9, "between the ends of an edge"


def test_notes_begin_beside_the_top_of_the_table(drawings):
    content, sheet = drawings["full"]
    rows = {label.text: label.at[1] for label in sheet.marks.texts}
    first = next(row for text, row in rows.items() if text.startswith(f"1. {content.notes[0][:20]}"))
    assert first == pytest.approx(rows[content.table.columns["outer"]["title"]], abs=1.0)


def test_arrows_name_the_axes_and_margins_of_a_smaller_sheet_are_smaller(drawings):
    for towards, given in ((1.0, ()), (-1.0, (-1.0,))):  # to the right by default
        mark = axes_mark((3.0, 4.0), "z", "x", 0.5, *given)
        lines = [stroke.points.tolist() for stroke in mark.strokes if not stroke.filled]
        assert lines == [[[3.0, 4.0], [3.0 + 3.5 * towards, 4.0]], [[3.0, 4.0], [3.0, 7.5]]]
        assert {label.text: label.at for label in mark.texts} == {"z": (3.0 + 4.5 * towards, 4.0), "x": (3.0, 8.5)}
    content, _ = drawings["full"]
    wide, small = (np.subtract(_notes_box(content, name), inside_of(name))[:3] / unit_of(name) for name in ("A3", "A4"))
    assert small == pytest.approx(wide)


def test_texts_of_a_dimension_are_tried_in_its_middle_near_both_ends_and_beyond_both(drawings):
    dimension = replace(drawings["full"][1].marks.dimensions[0], start=(0.0, 0.0), end=(80.0, 80.0))
    candidates = list(_candidates(dimension, 0.0, []))
    (low, high) = sorted(dimension.ends_mm)
    middle, right, left, above, below = (sum(text_span(candidate)) / 2.0 for candidate in candidates)
    assert middle == pytest.approx(0.5 * (low + high)) and right - middle == pytest.approx(middle - left)
    assert all(
        low < end < high for candidate in candidates[:3] for end in text_span(candidate)
    ) and left < middle - 0.1 * (high - low)
    assert (
        text_span(candidates[3])[0] > high
        and text_span(candidates[4])[1] < low
        and above - high == pytest.approx(low - below)
    )


def test_the_plane_that_the_step_carries_is_datum_a(parts, part_of):
    lens = small_lens(BASES["full"], {"form_tolerance_um": 2.0})
    part = part_of(lens, "AP242")
    assert part.form_tolerances[0].datum_faces
    content, _ = content_of(lens, part, parts["full"][2])
    plane = content.views.datums.find("A")
    assert plane.z_mm == 0.0 and all(face in plane.feature for face in part.form_tolerances[0].datum_faces)
    assert content.table.columns["outer"]["profile"] == "Profile of the surface: 0.002 | A"


def test_sizes_of_freeform_faces_are_auxiliary_and_the_others_bare(drawings):
    texts = {dimension.name: dimension.text for dimension in drawings["full"][1].marks.dimensions}
    assert texts["diameter of the base"] == "⌀16.000 general"
    assert texts["diameter of the pocket"] == "⌀7.000 general"
    assert texts["depth of the relief step below z = 0"] == "0.400 general"
    assert re.fullmatch(r"\(\d+\.\d{3}\)", texts["outer rim in z = 0, along x"])
    assert re.fullmatch(r"\d+\.\d{3} ±0\.020", texts["thickness on the axis"]), "the preset's gap_mm"


def test_the_title_block_and_the_notes_say_what_the_spec_says_and_else_that_it_does_not(check, part_of):
    fields = {
        "part_name": "Kerbside lens",
        "part_number": "LF-0042",
        "revision": "C",
        "checked_by": "C. Checker",
        "general_tolerances": "ISO 2768-m",
        "edge_break_mm": 0.2,
        "roughness_nm": 4.0,
        "imperfections": "5 x 0.16",
        "sheet": "A3",
    }
    shop = {"author": "A. Author", "date": "2026-03-31", "organisation": "Works"}
    lens = small_lens(ROUND, shop, drawing=fields)
    tolerances = PartTolerances(faces={"outer": {"gap_mm": 0.07, "form_um": 0.4}})
    lens = replace(lens, spec=lens.spec.with_tolerances(tolerances))
    content, sheet = content_of(lens, part_of(lens), check, "A3")
    stated = "\n".join(label.text for label in all_words(sheet)).replace("\n", " ")
    for text in (
        "Number: LF-0042", "Revision: C", "Checked: C. Checker", "Drawn: A. Author", "Date: 2026-03-31",
        "Organisation: Works", "Sizes “general”: ISO 2768-m", "radius or chamfer 0.2 at most",
        "Rq 4 nm", "5/ 5 x 0.16", "±0.070",
        "3/ RMS form 0.4 µm", "3/ RMS form 1 µm", "Material: <PMMA> & co", "First angle",
        "the specification (outer face against inner, gap; form, outer face), the others preset",
    ):  # fmt: skip
        assert text in stated, text
    assert content.title == "Kerbside lens, LF-0042, revision C"
    _, bare = content_of(small_lens(ROUND), part_of(small_lens(ROUND)), check)
    stated = " ".join(label.text for label in all_words(bare))
    for text in (
        "Number: not stated",
        "Date: not stated",
        "Sizes “general”: no tolerance stated",
        "All other edges: largest break not stated",
        "5/ –",
    ):
        assert text in stated, text


def test_long_words_are_cut_to_their_cells_and_notes_that_do_not_fit_say_so(check, part_of):
    long = "x" * 200
    lens = small_lens(ROUND, {"author": long}, drawing={"part_name": long, "general_tolerances": long})
    content, _ = content_of(lens, part_of(lens), check)
    sheet = make_sheet(replace(content, notes=[*content.notes, *[long] * 20]))
    for text in sheet.marks.texts:
        left, _, right, _ = box_of(text)
        assert left > 20.0 and right < sheet.size_mm[0] - 10.0, text.text
    assert any(label.text.endswith("…") and label.text.startswith("Drawn: x") for label in sheet.marks.texts)
    assert sum(label.text.startswith("More notes") for label in sheet.marks.texts) == 1


@pytest.mark.parametrize("count", [1, 9, 10, 40])
def test_paragraphs_stay_in_their_box_and_the_last_line_tells_of_those_that_do_not_fit(count):
    """Nine lines of 2.5 mm fit into 42 mm."""
    lines = paragraphs_in((30.0, 100.0, 130.0, 142.0), [f"note {number}" for number in range(1, count + 1)], 1.0)
    shown = [f"{number}. note {number}" for number in range(1, count + 1)]
    if count > 9:
        shown[8:] = ["More notes: on manufacturing.html."]
    assert [line.text for line in lines] == shown
    heights = [line.at[1] for line in lines]
    assert sorted(heights, reverse=True) == heights and heights[-1] > 100.0 and heights[0] < 142.0 - lines[0].height_mm


def test_the_second_section_is_cut_where_the_part_differs_and_named_where_it_is_cut(parts, drawings):
    lens, _, _ = parts["none"]
    content, sheet = drawings["none"]
    first, second = content.views.sections
    assert (first.azimuth_deg, second.azimuth_deg) == (0.0, 90.0)
    for section, axis in ((first, 0), (second, 1)):
        z, across = np.concatenate(section.outlines).T
        upper = (z > 1e-6) & (across > 0.1)
        directions = np.zeros((upper.sum(), 3))
        directions[:, 2] = z[upper]
        directions[:, axis] = across[upper]
        distance = np.linalg.norm(directions, axis=1)
        radii = [face.radius(directions / distance[:, None]) for face in (lens.inner, lens.outer)]
        assert np.minimum(*(np.abs(radius - distance) for radius in radii)).max() < 1e-9
    texts = [label.text for label in sheet.marks.texts]
    assert texts.count("S") == texts.count("T") == 2 and "S–S" in texts and "T–T" in texts
    level = [label.at for label in sheet.marks.texts if label.text == "T"]
    assert level[0][1] == pytest.approx(level[1][1]), "the plane x = 0 is level in the view from the base"


def test_the_second_section_of_a_square_part_is_along_its_diagonal(parts, monkeypatch):
    monkeypatch.setattr("lensforge.shop.drawing.other_section_deg", lambda lens: 45.0)
    content, _ = content_of(*parts["none"])
    assert [section.azimuth_deg for section in content.views.sections] == [0.0, 45.0]


def test_the_dome_is_seen_from_above_to_the_left_and_its_circle_holds_it(parts, drawings):
    lens, _, _ = parts["none"]
    content, sheet = drawings["none"]
    dome = max(content.views.dome, key=lambda line: len(line.points)).points
    sizes = {dimension.name: dimension.value_mm for dimension in content.views.dimensions}
    assert 2.0 * np.hypot(*dome.T).max() == pytest.approx(sizes["width of the dome"], abs=2e-3)
    turn = np.arctan2(dome[:, 1], -dome[:, 0])  # -y to the right, x up
    directions = fibonacci_hemisphere(200_000)
    points = lens.outer.radius(directions)[:, None] * directions
    at = np.arctan2(points[:, 0], points[:, 1])
    for k in range(0, 360, 36):
        near = np.abs(np.angle(np.exp(1j * (at - turn[k])))) < 0.02
        assert np.hypot(points[near, 0], points[near, 1]).max() == pytest.approx(np.hypot(*dome[k]), abs=0.03)
    lines = {dimension.name: dimension for dimension in sheet.marks.dimensions}
    assert lines["width of the dome"].end[0] < lines["outer apex above z = 0"].start[0], "first angle"


def test_the_base_is_seen_at_its_size(parts):
    """Areas within the outlines of the view from the base; a flat takes a segment of the circle."""
    segment = 64.0 * np.arccos(7.5 / 8.0) - 7.5 * np.sqrt(64.0 - 7.5**2)
    for name, wanted in {"flat": 64.0 * np.pi - segment, "square": 225.0, "below the dome": 30.25 * np.pi}.items():
        loops = [line.points.T for line in end_lines(parts[name][0])]
        areas = [0.5 * abs(np.sum(x * np.roll(y, 1) - y * np.roll(x, 1))) for x, y in loops]
        assert np.abs(np.array(areas) / wanted - 1.0).min() < 1e-3, name


@pytest.mark.parametrize("factor", [0.02, 60.0])
def test_a_part_of_any_size_has_a_scale_that_fills_the_sheet(drawings, factor):
    content, usual = drawings["none"]
    sections = [
        replace(section, outlines=[factor * outline for outline in section.outlines], lines=[])
        for section in content.views.sections
    ]
    base, dome = (
        [replace(line, points=factor * line.points) for line in lines]
        for lines in (content.views.base, content.views.dome)
    )
    views = replace(content.views, sections=sections, base=base, dome=dome, dimensions=[])
    sheet = make_sheet(replace(content, views=views))
    assert sheet.scale in SCALES and 0.2 < sheet.scale * factor / usual.scale < 5.0


def test_another_revision_is_read_from_a_file_and_wrong_ones_are_a_line(tmp_path):
    path = tmp_path / "revision.toml"
    path.write_text('[drawing]\nrevision = "D"\n[other]\nx = 1\n', encoding="utf-8")
    assert read_drawing(path).revision == "D"
    for content, line in (
        ("[other]\n", "has no \\[drawing\\]; add one"),
        ("[drawing]\nrevison = 'D'\n", "drawing: revison.*revision"),
        ("[drawing]\nroughness_nm = -1\n", "drawing: roughness_nm = -1"),
    ):
        path.write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match=line) as caught:
            read_drawing(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("material", "phrase"),
    [
        ({"material": "PMMA at 564 nm", "refractive_index": 1.49}, "at 564 nm"),
        ({"material": "PMMA"}, "at 587.56"),
        ({"material": "PMMA", "design_wavelength_nm": 620.0}, "at 620 nm"),
        ({"material": "own", "refractive_index": 1.5}, "wavelength not stated"),
        ({"material": "own", "refractive_index": 1.5, "abbe_number": 50.0}, "at 587.56"),
    ],
)
def test_the_index_has_its_wavelength(material, phrase):
    lens = small_lens(lens={"levels": [9, 25], "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}, **material})
    assert index_wavelength(lens).startswith(phrase)


@pytest.mark.parametrize(("turned", "place"), [(0, (50.0, 35.0)), (90, (55.0, 40.0))])
def test_capitals_have_their_middle_where_the_words_are(turned, place):
    """The base line is half of their height below it, as the turned text sees it."""
    axes = Figure().add_subplot()
    _write_text(axes, SheetText((50.0, 40.0), "H", 10.0, "left", turned))
    assert axes.texts[0].get_position() == place


def test_words_in_the_dxf_stand_turned_and_as_large_as_on_paper_at_the_size_of_the_part():
    """At 2:1, about the part's origin in the section: half of the distances and of the heights on paper."""
    labels = [SheetText((50.0, 40.0), "H", 3.5, "left", 90), SheetText((120.0, 90.0), "K", 5.0, "right")]
    sheet = Sheet("A4", (297.0, 210.0), 1.0, 2.0, "two letters", (100.0, 80.0), Marks(texts=labels))
    document = ezdxf.read(io.StringIO(sheet_dxf(sheet).decode("utf-8")))
    texts = [(t.dxf.text, t.dxf.rotation, t.dxf.height, *t.get_placement()[:2]) for t in document.query("TEXT")]
    (high, level) = texts
    assert high[:3] == ("H", 90.0, 1.75) and level[:3] == ("K", 0.0, 2.5)
    assert [high[3].name, level[3].name] == ["MIDDLE_LEFT", "MIDDLE_RIGHT"]
    assert [tuple(high[4])[:2], tuple(level[4])[:2]] == [(-25.0, -20.0), (10.0, 5.0)]


def test_departures_are_in_micrometres(check) -> None:
    facts = {fact.key: fact for group in check_facts(check) for fact in group.facts}
    for name, face in check.faces.items():
        assert facts[f"{name}_departure"].value == pytest.approx(1e3 * face.best_fit_sphere.pv_mm)
    lens = bare_part()[0].lens
    uneven = lens.spec.replace({"lens.outer.ripple_um": 0.05, "lens.outer.roughness_mrad": 0.3})
    texture = _texture("outer", replace(lens, spec=uneven), 4.0)
    assert texture == "polished, Rq 4 nm, RΔq 0.3 mrad, rings 50 nm PV"


@pytest.mark.parametrize("height_mm", [3.5, 1.75])
def test_capitals_in_the_pdf_are_as_high_as_is_asked_for(height_mm):
    """The size of the type in the PDF's own words, times the height of an H in the typeface."""
    label = SheetText((50.0, 50.0), "H", height_mm)
    sheet = Sheet("A4", (297.0, 210.0), 1.0, 1.0, "one letter", (0.0, 0.0), Marks(texts=[label]))
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", sheet_pdf(sheet), re.DOTALL)
    written = b"".join(zlib.decompress(stream) for stream in streams if stream[:1] == b"x")
    (points,) = (float(size) for size in re.findall(rb"/F\S+ ([\d.]+) Tf", written))
    of_em = TextPath((0.0, 0.0), "H", size=1.0, prop=FontProperties(family=TYPEFACE)).get_extents().height
    assert points * of_em * 25.4 / 72.0 == pytest.approx(height_mm, rel=0.01)
