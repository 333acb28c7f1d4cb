"""The part in three dimensions: rendered pictures, and the small mesh that the page carries."""

import base64
import io
import re
from collections import Counter

import numpy as np
import pytest
import pyvista as pv
import trimesh
from page_text import Page
from PIL import Image
from result_folders import make_results
from undrawn import without_figures

from lensforge.errors import InputError
from lensforge.report import solid_view
from lensforge.report.lens_page import render_report


@pytest.fixture(autouse=True)
def other_pictures():
    """None: the part in three dimensions is all that is looked at here."""
    with without_figures():
        yield


def unpack(data):
    vertices, triangles = np.frombuffer(data, "<u4", 2)
    unit, half, centre = np.frombuffer(data, "<f4", 3, 8)
    points = np.frombuffer(data, "<i2", 3 * vertices, 20).reshape(-1, 3) * float(unit)
    faces = np.frombuffer(data, "<u2", 3 * triangles, 20 + 6 * vertices).reshape(-1, 3)
    normals = np.frombuffer(data, "i1", 3 * vertices, 20 + 6 * vertices + 6 * triangles).reshape(-1, 3) / 127.0
    assert len(data) == 20 + 9 * vertices + 6 * triangles
    return points, faces, normals, (float(half), float(centre))


def test_a_sphere_of_many_triangles_becomes_few_and_stays_a_sphere():
    sphere = pv.Icosphere(radius=7.0, nsub=6)
    data = solid_view.small_mesh(sphere, 9.0, 1.5)
    points, faces, normals, view = unpack(data)
    assert sphere.n_cells > 6 * solid_view.MOST_TRIANGLES
    assert len(faces) <= solid_view.MOST_TRIANGLES
    assert len(data) * 4 / 3 < 300e3, "in base64"
    assert np.linalg.norm(points, axis=1) == pytest.approx(7.0, rel=2e-3)
    assert normals == pytest.approx(points / 7.0, abs=0.03)
    assert view == pytest.approx((9.0, 1.5))
    corners = points[faces]
    volume = np.sum(np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * 343.0, rel=2e-3), "all triangles turn outwards"


def test_edges_stay_sharp():
    points, faces, normals, _ = unpack(solid_view.small_mesh(pv.Cube().triangulate(), 1.0, 0.0))
    assert len(points) == 24
    for face in faces:
        corners = points[face]
        outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        for normal in normals[face]:
            assert normal == pytest.approx(outward / np.linalg.norm(outward), abs=0.01)


@pytest.mark.nightly("a renderer; by day the page in a browser has its pictures")
def test_the_part_is_shown_from_three_sides(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the renderer finds lensforge wherever its caller stands
    markup = render_report(make_results(("export",)))
    if "No 3-D picture" in markup:
        pytest.skip("no off-screen renderer here")
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)', markup)
    assert len(pictures) == 3
    flat = [np.asarray(Image.open(io.BytesIO(base64.b64decode(picture)))).reshape(-1, 4) for picture in pictures]
    faces = [Counter(map(tuple, view[view[:, 3] == 255].tolist())).most_common(1)[0][1] / len(view) for view in flat]
    assert faces[1] > 0.1 > max(faces[0], faces[2]), "the face of the cut, in a colour without shades"
    for picture in pictures:
        alpha = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))))[..., 3]
        assert 0.05 < (alpha > 0).mean() < 0.95, "a part before a transparent ground"
        rows, columns = np.nonzero(alpha)
        assert rows.min() > 0 and columns.min() > 0, "all of it"
        assert rows.max() < alpha.shape[0] - 1 and columns.max() < alpha.shape[1] - 1
        assert max(np.ptp(rows) / alpha.shape[0], np.ptp(columns) / alpha.shape[1]) > 0.6, "and not far away"
    assert "10 × 10 × 10 mm over all" in markup
    assert "script" in Page(markup).tags, "it can be turned"


def test_only_the_picture_of_the_cut_lacks_a_half():
    """A cube is in the middle of its picture."""
    views = solid_view.solid_views(trimesh.creation.box(extents=(6.0, 6.0, 6.0)).export(file_type="stl"), 6.0)
    if views.problem:
        pytest.skip("no off-screen renderer here")
    middles = {}
    for name, picture in views.pictures.items():
        alpha = np.asarray(Image.open(io.BytesIO(picture)))[..., 3]
        middles[name] = [0.5 * (indices.min() + indices.max() + 1) for indices in np.nonzero(alpha)] / np.array(
            alpha.shape
        )
    assert np.abs([middles["above"], middles["below"]] - np.array(0.5)).max() < 0.005
    assert np.abs(middles["cut"] - 0.5).max() > 0.02


@pytest.mark.nightly("a renderer")
def test_a_plate_is_shown_with_one_lens_of_it():
    stl = [trimesh.creation.box(extents=size).export(file_type="stl") for size in ((6.0, 6.0, 6.0), (90.0, 60.0, 2.0))]
    views = solid_view.solid_views(stl[0], 3.0, stl[1])
    if views.problem:
        pytest.skip("no off-screen renderer here")
    assert set(views.pictures) == {"above", "cut", "below", "plate"} and views.bounds_mm[1] == 3.0
    alpha = np.asarray(Image.open(io.BytesIO(views.pictures["plate"])))[..., 3]
    rows, columns = np.nonzero(alpha)
    assert np.ptp(columns) > 0.6 * alpha.shape[1] and np.ptp(rows) < np.ptp(columns), "all of it, flat as it is"


def test_without_a_renderer_the_page_says_so(tmp_path, monkeypatch):
    script = tmp_path / "renderer.py"
    script.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n", encoding="utf-8")
    whole = solid_view.Child
    monkeypatch.setattr(solid_view, "Child", lambda _, *rest: whole(script, *rest))
    markup = render_report(make_results(("export",)))
    assert "No 3-D picture: this machine has no off-screen renderer (OpenGL)." in markup


def test_a_mesh_that_is_none_is_one_line():
    with pytest.raises(InputError, match=r"lens\.stl: not readable as STL .* run `lensforge export` again"):
        render_report(make_results(("export",), export={"stl": b"not a mesh"}))
