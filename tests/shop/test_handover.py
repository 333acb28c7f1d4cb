import csv
import hashlib
import io
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from round_surfaces import Ball
from shop_lenses import quick_check, small_lens

from lensforge.cad.part_export import build_part
from lensforge.errors import InputError, MissingResult
from lensforge.report.results import Results
from lensforge.results.criteria import Criterion
from lensforge.shop.check_facts import finding_groups
from lensforge.shop.check_result import Finding
from lensforge.shop.dense_table import GridRequest
from lensforge.shop.dimensions import dimensions, highest_point_mm
from lensforge.shop.handover_facts import face_groups
from lensforge.shop.shop_files import make_handover
from lensforge.surfaces.srbf import fibonacci_hemisphere

COARSE = GridRequest(spacing_mm=0.4)


@pytest.fixture(scope="module")
def results():
    lens = small_lens()
    part = build_part(lens, rings=16)
    return Results(lens, {"export": part, "check": quick_check(part)})


@pytest.fixture(scope="module")
def handed(results):
    return make_handover(results, COARSE)


def table(content):
    """Rows of a table below the lines that begin with #."""
    lines = [line for line in content.decode().splitlines(keepends=True) if not line.startswith("#")]
    return list(csv.DictReader(io.StringIO("".join(lines))))


def test_points_lie_on_the_exact_faces_with_their_normals_out_of_the_material(results, handed):
    lens, rows = results.lens, table(handed.points_csv)
    assert len(rows) == handed.points == 2 * 2593
    for name, sign in (("inner", -1.0), ("outer", 1.0)):
        values = np.array(
            [[float(v) for k, v in row.items() if k != "surface"] for row in rows if row["surface"] == name]
        )
        points, normals = values[:, :3], values[:, 3:]
        radius = np.linalg.norm(points, axis=1)
        assert np.abs(radius - getattr(lens, name).radius(points / radius[:, None])).max() < 5e-9
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=2e-9)
        assert (sign * np.sum(points * normals, axis=1) > 0.0).all()
        # The normal is what the points say: perpendicular to the chords around the ring at 45 degrees.
        ring = slice(1 + 17 * 72, 1 + 18 * 72)
        chord = np.roll(points[ring], -1, axis=0) - np.roll(points[ring], 1, axis=0)
        chord /= np.linalg.norm(chord, axis=1, keepdims=True)
        assert np.abs(np.sum(chord * normals[ring], axis=1)).max() < 0.02


def test_the_page_states_each_face_in_the_units_it_names(results):
    face = results.check.outer
    group, _ = face_groups(results.lens, results.check)
    sphere = face.best_fit_sphere
    for label, value, unit in (
        ("Best-fit sphere", sphere.radius_mm, "mm"),
        ("Departure from it", 1e3 * sphere.pv_mm, "µm"),
        ("Departure, rms", 1e3 * sphere.rms_mm, "µm"),
        ("Largest tilt", face.largest_tilt_deg, "°"),
        ("Draft, outer face", face.draft_deg.min, "°"),
    ):
        (fact,) = (each for each in group.facts if each.label == label)
        assert (fact.value, fact.unit) == (value, unit)


def test_the_sag_table_is_the_departure_from_the_sphere_of_the_check(results, handed):
    """Positive where the face is farther from the centre than the sphere; of each face from its own sphere."""
    rows = table(handed.sag_csv)
    for name in ("inner", "outer"):
        sphere = getattr(results.check, name).best_fit_sphere
        values = np.array([list(row.values())[1:] for row in rows if row["surface"] == name], dtype=float)
        polar, azimuth, radius, departure = values.T
        across, up = radius * np.sin(np.radians(polar)), radius * np.cos(np.radians(polar))
        points = np.stack([across * np.cos(np.radians(azimuth)), across * np.sin(np.radians(azimuth)), up], axis=1)
        beyond = np.linalg.norm(points - np.array(sphere.centre_mm), axis=1) - sphere.radius_mm
        assert departure == pytest.approx(beyond, abs=3e-9), "nine decimals"
        assert np.ptp(departure) == pytest.approx(sphere.pv_mm, rel=0.03)
        assert np.ptp(departure) <= sphere.pv_mm * (1.0 + 1e-3)


def test_page_and_pdf_say_what_the_shop_must_know(results, handed):
    page = handed.html.decode("utf-8")
    assert "&lt;PMMA&gt; &amp; co" in page
    assert f"{results.lens.refractive_index:g}" in page
    assert "http" not in re.sub(r"http://www\.w3\.org/[^\"]*", "", page), "one page, nothing fetched"
    for group in finding_groups(results.check):
        for fact in group.facts:
            assert f"<th>{group.title}: {fact.label.lower()}</th>" in page
    content = {
        "lens.step": results.part.step,
        "lens.stl": results.part.stl,
        "lens.3mf": results.part.threemf,
        "points.csv": handed.points_csv,
        "sag.csv": handed.sag_csv,
        "drawing.dxf": handed.dxf,
    } | {grid.file: grid.content for grid in handed.grids}
    assert handed.sha256 == {name: hashlib.sha256(each).hexdigest() for name, each in content.items()}
    for digest in handed.sha256.values():
        assert digest in page
    for value in ("16.000", "0.400", "20.000", "7.000"):
        assert f">{value}</td><td>general</td>" in page
    assert handed.pdf.startswith(b"%PDF")


def test_the_same_results_give_the_same_bytes(results, handed):
    assert make_handover(results, COARSE) == handed


def test_what_is_saved_is_what_the_record_holds(handed, tmp_path):
    handed.save(tmp_path / "to_the_shop")
    written = {path.name: path.read_bytes() for path in (tmp_path / "to_the_shop").iterdir()}
    assert written == {
        "manufacturing.html": handed.html,
        "manufacturing.pdf": handed.pdf,
        "drawing.dxf": handed.dxf,
        "points.csv": handed.points_csv,
        "sag.csv": handed.sag_csv,
    } | {grid.file: grid.content for grid in handed.grids}
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be written"):
        handed.save(tmp_path / "file" / "folder")


@pytest.mark.parametrize("name", ["manufacturing.html", "manufacturing.pdf"])
def test_the_page_of_another_program_is_kept(handed, name, tmp_path):
    handed.save(tmp_path)
    handed.save(tmp_path)  # its own are replaced
    (tmp_path / name).write_bytes(b"%PDF-1.7 of another program")
    (tmp_path / "points.csv").write_bytes(b"old")
    with pytest.raises(InputError, match="move it away"):
        handed.save(tmp_path)
    assert (tmp_path / name).read_bytes() == b"%PDF-1.7 of another program"
    assert (tmp_path / "points.csv").read_bytes() == b"old", "said before anything is written"


def test_a_notebook_shows_the_page_in_a_frame(handed):
    frame = handed._repr_html_()
    assert frame.startswith('<iframe title="shop: for manufacture"')
    assert frame.count("<") == 2, "the page is an attribute"
    assert handed.html.decode("utf-8") in unescape(frame)


@pytest.fixture
def no_pdf(monkeypatch):
    """A handover without its PDF, which takes half of the time: for tests of the page and the tables."""
    monkeypatch.setattr("lensforge.shop.shop_files.pdf_of", lambda *_: b"")


@pytest.mark.usefixtures("no_pdf")
def test_what_the_shop_cannot_do_and_what_could_not_be_measured_is_said(results):
    verdicts = (
        Finding(name="cutter", surface="inner", value=1.0, sense="<=", limit=0.5, unit="mm", reason="no ball fits"),
        Finding(name="wall", surface="body", value=1.0, sense=">=", limit=0.5, unit="mm", reason="it is thick"),
    )
    unknown = Criterion(name="thinnest wall", value=None, sense=">=", limit=1.0, unit="mm", remedy="more")
    check = results.check.model_copy(update={"verdicts": verdicts, "criteria": (unknown,)})
    handed = make_handover(replace(results, found={**results.found, "check": check}), COARSE)
    assert [verdict.reason for verdict in handed.refused] == ["no ball fits"]
    page = handed.html.decode("utf-8")
    assert '<td class="no">no</td><td>no ball fits</td>' in page
    assert '<td>not measured</td><td>≥ 1 mm</td><td class="no">fail</td>' in page


@pytest.mark.parametrize(("absent", "command"), [("export", "export"), ("check", "check")])
def test_without_part_or_check_one_line_says_what_to_run(results, absent, command):
    found = {stem: result for stem, result in results.found.items() if stem != absent}
    with pytest.raises(MissingResult, match=f"run `lensforge {command}`") as caught:
        make_handover(Results(results.lens, found))
    assert "\n" not in str(caught.value)


def test_the_highest_point_is_found_off_the_apex_and_between_the_samples():
    """A sphere whose centre lies off the axis is highest above its centre; that of a batwing is on a ring."""
    ball = Ball((0.7, -0.4, 0.3), 5.0)
    assert highest_point_mm(ball)[2] == pytest.approx(5.3, abs=1e-10)
    assert ball.radius(np.array([[0.0, 0.0, 1.0]]))[0] < 5.3 - 0.05
    centred = Ball((0.0, 0.0, 0.3), 5.0)
    assert highest_point_mm(centred)[2] == pytest.approx(5.3, abs=1e-12)
    lens = small_lens()
    apex = lens.outer.radius(np.array([[0.0, 0.0, 1.0]]))[0]
    stated = {d.name: d.value_mm for d in dimensions(lens)}
    dense = fibonacci_hemisphere(400_000)
    assert stated["highest point above z = 0"] >= max(apex, (lens.outer.radius(dense) * dense[:, 2]).max())


@pytest.mark.usefixtures("no_pdf")
def test_page_and_tables_name_author_date_tolerance_and_shrinkage():
    shop = {
        "make": "insert",
        "shrinkage": 0.0125,
        "author": "A. Author",
        "date": "2026-03-31",
        "form_tolerance_um": 2.5,
    }
    lens = small_lens(manufacture=shop)
    part = build_part(lens, rings=16, runout_deg=5.0)
    results = Results(lens, {"export": part, "check": quick_check(part)})
    handed = make_handover(results, COARSE)
    text = unescape(handed.html.decode("utf-8"))
    for words in ("A. Author", "2026-03-31", "0.0125;", "the lens times 1.0125", "2.5 µm", "its schema carries none"):
        assert words in text
    assert "lens_surfaces.step, the tables" in text
    assert f"form error {part.untrimmed_surfaces.form_error_nm:.2g} nm" in text
    for name in ("points.csv", "sag.csv", *(grid.file for grid in handed.grids)):
        head = [line for line in handed.files[name].decode().splitlines() if line.startswith("# ")]
        for words in ("A. Author", "2026-03-31", "0.0125", lens.sha256, "units: mm", "the lens times 1.0125"):
            assert any(words in line for line in head), (name, words)
    for name, into_air in (("inner", 1.0), ("outer", -1.0)):  # the mould's material is where the lens has none
        rows = [row for row in table(handed.points_csv) if row["surface"] == name]
        points = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
        normals = np.array([[float(row[f"n{axis}"]) for axis in "xyz"] for row in rows])
        radius = np.linalg.norm(points, axis=1)
        exact = 1.0125 * getattr(lens, name).radius(points / radius[:, None])
        assert np.abs(radius - exact).max() < 5e-9
        assert (into_air * np.sum(points * normals, axis=1) > 0.0).all()
    sphere = results.check.outer.best_fit_sphere
    departures = [float(row["departure_mm"]) for row in table(handed.sag_csv) if row["surface"] == "outer"]
    assert np.ptp(departures) <= sphere.pv_mm * (1.0 + 1e-3)
