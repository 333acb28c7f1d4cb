import csv
import hashlib
import io
import re
from html import unescape
from math import nan

import numpy as np
import pytest
import trimesh
from shop_lenses import small_lens

from lensforge.cad.mesh_files import parse_named_3mf
from lensforge.cad.part_export import build_part
from lensforge.errors import InputError
from lensforge.report.results import Results, handover
from lensforge.results import Fact
from lensforge.results.criteria import at_least
from lensforge.shop.check import check_lens
from lensforge.shop.check_facts import finding_groups
from lensforge.shop.findings import as_finding
from lensforge.shop.part_models import _rays_by_end
from lensforge.shop.point_tables import GridRequest
from lensforge.shop.shop_files import make_handover

COARSE = GridRequest(spacing_mm=0.4)


@pytest.fixture(scope="module")
def results():
    lens = small_lens()
    part = build_part(lens, rings=16)
    return Results(lens, {"export": part, "check": check_lens(part.lens, part.nodes)})


def files_of(results, request=COARSE):
    return make_handover(results.part, results.check, [], request)


@pytest.fixture(scope="module")
def handed(results):
    return files_of(results)


def table(content):
    """Rows of a table below the lines that begin with #."""
    lines = [line for line in content.decode().splitlines(keepends=True) if not line.startswith("#")]
    return list(csv.DictReader(io.StringIO("".join(lines))))


def numbers_of(rows, name):
    return np.array([list(row.values())[1:] for row in rows if row["surface"] == name], dtype=float)


def test_page_and_pdf_say_what_the_shop_must_know(results, handed):
    page = handed.html.decode("utf-8")
    assert "http" not in re.sub(r"http://www\.w3\.org/[^\"]*", "", page), "one page, nothing fetched"
    for group in finding_groups(results.check):
        for fact in group.facts:
            assert f"<th>{group.title}: {fact.label.lower()}</th>" in page
    content = {
        "lens.step": results.part.step,
        "lens.stl": results.part.stl,
        "lens.3mf": results.part.threemf,
        "points.csv": handed.points_csv,
        "drawing.dxf": handed.dxf,
        **handed.models,
    } | {grid.file: grid.content for grid in handed.grids}
    assert list(handed.models) == ["lens.glb"]
    assert handed.sha256 == {name: hashlib.sha256(data).hexdigest() for name, data in content.items()}
    for digest in handed.sha256.values():
        assert digest in page
    for value in ("16.000", "0.400", "20.000", "7.000"):
        assert f">{value}</td><td>general</td>" in page
    assert handed.pdf.startswith(b"%PDF")


@pytest.mark.nightly("four seconds; by day the same sheet is the same DXF")
def test_the_same_results_give_the_same_bytes(results, handed):
    assert files_of(results) == handed


def test_what_is_saved_is_what_the_record_holds(handed, tmp_path):
    handed.save(tmp_path / "to_the_shop")
    written = {path.name: path.read_bytes() for path in (tmp_path / "to_the_shop").iterdir()}
    assert written == {
        "manufacturing.html": handed.html,
        "manufacturing.pdf": handed.pdf,
        "drawing.dxf": handed.dxf,
        "points.csv": handed.points_csv,
        "lens.glb": handed.models["lens.glb"],
    } | {grid.file: grid.content for grid in handed.grids}
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be written"):
        handed.save(tmp_path / "file" / "folder")


@pytest.mark.parametrize("name", ["manufacturing.html", "manufacturing.pdf", "plate.pdf"])
def test_the_page_of_another_program_is_kept(handed, name, tmp_path):
    handed = handed.model_copy(update={"plate_pdf": handed.pdf})
    handed.save(tmp_path)
    handed.save(tmp_path)  # its own are replaced
    (tmp_path / name).write_bytes(b"%PDF-1.7 of another program")
    (tmp_path / "points.csv").write_bytes(b"old")
    with pytest.raises(InputError, match="move it away"):
        handed.save(tmp_path)
    assert (tmp_path / name).read_bytes() == b"%PDF-1.7 of another program"
    assert (tmp_path / "points.csv").read_bytes() == b"old", "said before anything is written"


def test_what_the_shop_cannot_do_and_what_could_not_be_measured_is_said(results):
    verdicts = (
        as_finding(Fact("cutter", "", 1.0, "mm", limit=0.5, note="no ball fits", place="inner")),
        as_finding(Fact("wall", "", 1.0, "mm", sense=">=", limit=0.5, note="it is thick", place="body")),
    )
    unknown = at_least("thinnest wall", nan, 1.0, "mm", "more")
    check = results.check.model_copy(update={"verdicts": verdicts, "criteria": (unknown,)})
    handed = make_handover(results.part, check, [], COARSE)
    assert [verdict.note for verdict in handed.refused] == ["no ball fits"]
    page = handed.html.decode("utf-8")
    assert '<td class="no">no</td><td>no ball fits</td>' in page
    assert '<td>not measured</td><td>≥ 1 mm</td><td class="no">fail</td>' in page


def test_lamps_without_a_plate_stand_in_a_model_of_all():
    places = [[0.0, 0.0, 0.0], [30.0, -2.0, 1.5], [-4.0, 25.0, 0.0]]
    lens = small_lens({"kind": "none"}, lamps={"kind": "table", "places_mm": places, "turns_deg": [0.0, 40.0, 0.0]})
    part = build_part(lens, rings=12)
    models = make_handover(part, check_lens(lens, part.nodes), [], COARSE, rays=40).models
    assert list(models) == ["lens.glb", "lens_rays.glb", "lamps.glb"]
    scene = trimesh.load_scene(io.BytesIO(models["lamps.glb"]), file_type="glb")
    for number, (x, y, z) in enumerate(places, 1):
        np.testing.assert_allclose(scene.graph[f"shop {number}"][0][:3, 3], [1e-3 * x, 1e-3 * z, -1e-3 * y], atol=1e-12)


def test_the_model_with_rays_has_each_ray_of_the_led_in_the_lines_of_its_end():
    """A sphere about a shifted LED: rays that leave end at three times the part's largest distance from the origin."""
    led = {"kind": "square", "side_mm": 1.0, "position_mm": [0.4, -0.3, 0.0]}
    lens = small_lens({"kind": "none"}, source=led)
    part = build_part(lens, rings=12)
    lines = _rays_by_end(lens, parse_named_3mf(part.threemf), 64)
    assert sum(len(line.places_mm) for line in lines.values()) == 64
    starts = np.array([places[0] for line in lines.values() for places in line.places_mm])
    half = 0.5 * lens.spec.source.side_mm
    assert (np.abs(starts - [0.4, -0.3, 0.0]) <= [half, half, 0.0]).all() and len(np.unique(starts, axis=0)) == 64
    reach_mm = 3.0 * np.linalg.norm(parse_named_3mf(part.threemf).vertices, axis=1).max()
    ends = np.array([places[-1] for places in lines["rays: leaves"].places_mm])
    assert np.linalg.norm(ends, axis=1) == pytest.approx(reach_mm)
    assert len({line.colour for line in lines.values()}) == len(lines)


@pytest.fixture(scope="module")
def moulded():
    """Results of a moulded lens with all that a mould takes."""
    shop = {
        "process": "moulded",
        "shrinkage": 0.0125,
        "author": "A. Author",
        "date": "2026-03-31",
        "form_tolerance_um": 2.5,
    }
    lens = small_lens(manufacture=shop)
    part = build_part(lens, rings=16, extension_deg=5.0)
    return Results(lens, {"export": part, "check": check_lens(part.lens, part.nodes)})


def require_faces(lens, handed, scale, into_air):
    """Assert that points of each face lie on it times ``scale``, and its normals away from the axis (1) or to it."""
    for name, sign in into_air.items():
        values = numbers_of(table(handed.points_csv), name)
        points = values[:, :3]
        normals = values[:, 3:6]
        radius = np.linalg.norm(points, axis=1)
        assert np.abs(radius - scale * getattr(lens, name).radius(points / radius[:, None])).max() < 5e-9
        assert (sign * np.sum(points * normals, axis=1) > 0.0).all()


def test_a_prototype_of_a_moulded_lens_has_the_sheet_and_the_tables_of_its_own_process(moulded):
    """Turned it is the lens itself: of its size, its normals into its own air, and no faces that a mould would have."""
    handed = handover(moulded, process="turned", spacing_mm=0.4)
    lens = moulded.lens
    assert handed.scale is None and handed.notes == ()
    require_faces(lens, handed, 1.0, {"inner": -1.0, "outer": 1.0})
    for name in ("points.csv", *(grid.file for grid in handed.grids)):
        head = "".join(line for line in handed.files[name].decode().splitlines(True) if line.startswith("# "))
        assert "shrinkage: none; the points are those of the lens itself" in head, name
    text = unescape(handed.html.decode("utf-8"))
    assert "Process: turned" in text and "This part is turned, other than it was designed for" in text
    assert "Process: moulded" not in text and "1.0125" not in text and "lens_surfaces.step" not in text
    assert {"lens.step", "lens.stl"} <= handed.sha256.keys() and "lens_surfaces.step" not in handed.sha256
    assert handed.sha256["lens.step"] == moulded.part.files["lens.step"].sha256, "the body is that of the export"
    assert "Process: moulded" in unescape(files_of(moulded).html.decode("utf-8"))


def test_page_and_tables_name_author_date_tolerance_and_shrinkage(moulded):
    lens = moulded.lens
    part = moulded.part
    handed = files_of(moulded)
    text = unescape(handed.html.decode("utf-8"))
    for phrase in ("0.0125;", "the lens times 1.0125", "0.0025"):
        assert phrase in text
    assert "lens_surfaces.step, the tables" in text
    assert f"form error {part.untrimmed_surfaces.form_error_nm:.2g} nm" in text
    for name in ("points.csv", *(grid.file for grid in handed.grids)):
        head = [line for line in handed.files[name].decode().splitlines() if line.startswith("# ")]
        for phrase in ("A. Author", "2026-03-31", "0.0125", lens.sha256, "units: mm", "the lens times 1.0125"):
            assert any(phrase in line for line in head), (name, phrase)
    require_faces(lens, handed, 1.0125, {"inner": 1.0, "outer": -1.0})  # a mould's material is where the lens has none
