"""Dense tables of points, read back from their files: nodes, normals, stated interpolation error, refusals."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from nightly import first_by_day
from presets import CHECKED
from scenes import random_surface, sphere
from shop_lenses import between_nodes, rows_of, small_lens

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.shop.point_tables import FaceToCut, GridRequest, dense_tables, faces_to_cut, make_table

ROUGH = random_surface(1, 3.0, 0.01, (9, 25)), random_surface(2, 6.0, 0.01, (9, 25))


def lens_of(inner, outer, **manufacture):
    return Lens.double(inner, outer, small_lens({"kind": "none"}, manufacture).spec, 0, CHECKED)


def written(lens, request):
    """Head and rows of every table by the name of its face."""
    return {grid.face: rows_of(grid) for grid in dense_tables(lens, ["lens: dense"], request)}


def stated_nm(head):
    return float(re.search(r"interpolation error: at most (\S+) nm", head).group(1))


def off_surface_nm(points, surface):
    """Distance of points from a face, by its nearest point: Newton over directions."""
    u = points / np.linalg.norm(points, axis=1, keepdims=True)
    for _ in range(200):  # the foot of the perpendicular
        foot = surface.radius(u)[:, None] * u
        normal = surface.normal(u)
        height = np.sum((points - foot) * normal, axis=1, keepdims=True)
        tangent = points - foot - height * normal
        u = foot + 0.7 * tangent
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        if np.abs(tangent).max() < 1e-12:
            break
    assert np.abs(tangent).max() < 1e-9
    return 1e6 * np.abs(height[:, 0])


@pytest.mark.parametrize(
    ("scheme", "error_nm"), first_by_day(2, [("bicubic", 50.0), ("linear", 5000.0)], "a second each")
)
def test_a_table_read_back_and_interpolated_is_within_its_stated_error_down_to_the_rim(scheme, error_nm):
    lens = lens_of(*ROUGH)
    for name, (head, rows) in written(lens, GridRequest(error_nm=error_nm, interpolation=scheme)).items():
        assert stated_nm(head) <= error_nm
        surface = getattr(lens, name)
        assert rows[0, :2].tolist() == [0.0, 0.0] and rows[0, 6:].tolist() == [0.0, 0.0] and rows[1, 6] > 0.0, "once"
        between, rings = between_nodes(head, rows, {"bicubic": 4, "linear": 2}[scheme])
        on_face = rings.reshape(-1, 8)
        assert off_surface_nm(on_face[:, :3], surface).max() < 2e-3
        across = np.linalg.norm(on_face[:, :2], axis=1)
        assert np.abs(np.degrees(np.arctan2(across, on_face[:, 2])) - on_face[:, 6]).max() < 1e-6
        turned = np.degrees(np.arctan2(on_face[:, 1], on_face[:, 0])) - on_face[:, 7]
        assert np.abs((turned + 180.0) % 360.0 - 180.0).max() < 1e-5
        assert rings[-1, 0, 6] == 90.0 and np.abs(rings[-1, :, 2]).max() < 1e-9
        assert 0.2 * stated_nm(head) < off_surface_nm(between, surface).max() <= 1.05 * stated_nm(head)


@pytest.mark.nightly("two seconds; by day tables are within their errors")
def test_the_error_falls_with_the_order_of_the_interpolation():
    face = FaceToCut("outer", ROUGH[1], 1)
    for scheme, order in (("bicubic", 4.0), ("linear", 2.0)):
        coarse, fine = (make_table(face, step, scheme).errors_nm(scheme, 10**6).max() for step in (0.3, 0.15))
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.7)


def test_a_given_spacing_is_kept_and_its_error_stated():
    for grid in dense_tables(lens_of(*ROUGH), [], GridRequest(spacing_mm=0.5, error_nm=1.0)):
        assert grid.error_nm > 1.0, "the spacing decides"
        assert 0.3 < grid.spacing_mm < 0.6
        _, rows = rows_of(grid)
        rings = [rows[rows[:, 6] == polar, :3] for polar in np.unique(rows[:, 6])[1:]]  # without the apex
        along = max(np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(rings))
        around = max(np.linalg.norm(np.diff(ring, axis=0), axis=1).max() for ring in rings)
        assert grid.spacing_mm == pytest.approx(max(along, around), rel=5e-3)


def test_the_tables_of_a_mould_are_scaled_and_their_air_is_where_the_lens_has_material():
    plain = lens_of(sphere(3.0), sphere(6.0), process="moulded")
    shrunk = replace(plain, spec=plain.spec.replace({"manufacture.shrinkage": 0.005}))
    for scale, lens in ((1.0, plain), (1.005, shrunk)):
        for name, size, air in (("inner", 3.0, 1.0), ("outer", 6.0, -1.0)):
            _, rows = written(lens, GridRequest(spacing_mm=0.5))[name]
            assert np.abs(np.linalg.norm(rows[:, :3], axis=1) - scale * size).max() < 2e-9
            assert np.abs(air * rows[:, :3] / (scale * size) - rows[:, 3:6]).max() < 2e-9


@pytest.mark.parametrize(
    ("request_of", "line"),
    [
        ({"spacing_mm": 1e-3}, r"^spacing = 0\.001 mm: the table of the inner face would have .* larger spacing$"),
        ({"error_nm": 0.01, "interpolation": "linear"}, r"^error = 0\.01 nm: .* larger error, or bicubic"),
        ({"spacing_mm": 0.0}, r"^spacing = 0\.0: a number of mm from 0\.0001 to 1000$"),
        ({"error_nm": None}, r"^error = None: a number of nm"),
        ({"interpolation": "spline"}, r"^interpolation = 'spline': one of bicubic, linear$"),
    ],
)
def test_a_request_that_cannot_be_met_is_one_line(request_of, line):
    lens = lens_of(sphere(3.0), sphere(6.0))
    with pytest.raises(InputError, match=line) as caught:
        dense_tables(lens, [], GridRequest(**request_of))
    assert "\n" not in str(caught.value)


def test_the_table_has_the_whole_face_with_its_normals_and_the_extension_is_on_the_face():
    """Of a coarse table six rings of 15 degrees would not do: the next one would lie far below the rim."""
    for face in faces_to_cut(lens_of(*ROUGH)):
        for spacing in (0.3, 3.0):
            table = make_table(face, spacing, "bicubic")
            rows = table.rows
            directions = rows[:, :3] / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
            assert np.abs(face.surface.radius(directions)[:, None] * directions - rows[:, :3]).max() < 1e-9
            assert np.abs(face.air * face.surface.normal(directions) - rows[:, 3:6]).max() < 1e-8
            assert table.step_deg <= 6.0 and rows[-1, 6] == pytest.approx(90.0 + table.step_deg)
