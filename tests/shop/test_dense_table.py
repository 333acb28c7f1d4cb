"""Dense tables of points, read back from their files: nodes, offset, stated interpolation error, refusals."""

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from round_surfaces import Ball

from lensforge.cad.part import Signature
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.shop.dense_table import (
    COLUMNS,
    GridRequest,
    dense_tables,
    file_name,
    make_table,
    polar_end_deg,
    table_text,
)
from lensforge.shop.offset_face import OffsetFace
from lensforge.shop.point_files import origin_lines
from lensforge.spec import parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

PART = SimpleNamespace(signature=Signature(author="", organisation="", date=None))


def rough(offset, seed):
    basis = SrbfBasis((9, 25), 1.75)
    return SrbfSurface(basis, 0.01 * offset * np.random.default_rng(seed).normal(size=basis.size), offset)


def lens_of(inner, outer, **manufacture):
    content = {
        "name": "dense",
        "source": {"kind": "square", "side_mm": 0.5},
        "lens": {"levels": [9, 25], "inner_offset_mm": 3.0, "outer_offset_mm": 6.0},
        "constraints": {
            "cavity_height_mm": 0.5,
            "cavity_radius_mm": 0.5,
            "min_thickness_mm": 0.1,
            "max_radius_mm": 8.0,
        },
        "target": {"kind": "flat_top", "distance_mm": 100.0, "receiver_mm": 100.0, "width_mm": 60.0},
        "manufacture": manufacture,
    }
    return Lens(inner, outer, parse_spec(content, "test"), 0, "draft")


def check_of(inner_mm=None, outer_mm=None):
    """The part of a check that the tables use."""
    faces = [SimpleNamespace(cutter=SimpleNamespace(largest_radius_mm=each)) for each in (inner_mm, outer_mm)]
    return SimpleNamespace(inner=faces[0], outer=faces[1])


def written(lens, request, check=None):
    """Head and rows of every table by the name of its file, as a reader has them."""
    found = {}
    for measured in dense_tables(lens, check or check_of(), request):
        lines = table_text(measured, origin_lines(lens, PART), request).splitlines()
        head = [line for line in lines if line.startswith("#")]
        assert lines[len(head)] == COLUMNS
        rows = np.array([[float(value) for value in line.split(",")] for line in lines[len(head) + 1 :]])
        found[file_name(measured.table)] = "\n".join(head), rows
    return found


@cache
def files_of(scheme, error_nm, offset):
    """A rough lens, and the tables of it as a reader has them."""
    lens = lens_of(rough(3.0, 1), rough(6.0, 2))
    request = GridRequest(error_nm=error_nm, interpolation=scheme, offset_outer_mm=offset, offset_inner_mm=offset)
    return lens, written(lens, request)


def stated_nm(head):
    return float(re.search(r"interpolation error: at most (\S+) nm", head).group(1))


def lagrange(fraction, count):
    """Weights of the polynomial through ``count`` nodes at -1, 0, 1, 2 (or 0, 1), written out by its definition."""
    nodes = np.arange(count) - (count // 2 - 1)
    return np.stack([np.prod([(fraction - o) / (n - o) for o in nodes if o != n], axis=0) for n in nodes], axis=-1)


def off_surface_nm(points, surface, offset):
    """Distance of points from the offset of a face, by the nearest point of the face itself: Newton over directions."""
    u = points / np.linalg.norm(points, axis=1, keepdims=True)
    for _ in range(200):  # the foot of the perpendicular: moves towards the direction of point - offset * normal
        foot = surface.radius(u)[:, None] * u
        normal = surface.normal(u)
        height = np.sum((points - foot) * normal, axis=1, keepdims=True)
        tangent = points - foot - height * normal
        u = foot + 0.7 * tangent
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        if np.abs(tangent).max() < 1e-12:
            break
    assert np.abs(tangent).max() < 1e-9
    return 1e6 * np.abs(height[:, 0] - offset)


@pytest.mark.parametrize(("scheme", "error_nm"), [("bicubic", 50.0), ("linear", 5000.0)])
@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_a_table_read_back_and_interpolated_is_within_its_stated_error_down_to_the_rim(scheme, error_nm, offset):
    lens, files = files_of(scheme, error_nm, offset)
    for name, side in (("outer", 1.0), ("inner", -1.0)):
        head, rows = files[f"grid_{name}.csv"]
        assert stated_nm(head) <= error_nm
        surface = getattr(lens, name)
        turns, rim = int(re.search(r"; (\d+) azimuths", head).group(1)), int(re.search(r"ring (\d+) is", head).group(1))
        assert rows[0, :2].tolist() == [0.0, 0.0] and rows[0, 6:].tolist() == [0.0, 0.0] and rows[1, 6] > 0.0, "once"
        rings = rows[1:].reshape(-1, turns, 8)
        on_face = rings[: rim if offset else rim + 1].reshape(-1, 8)
        assert off_surface_nm(on_face[:, :3], surface, side * offset).max() < 2e-3
        across = np.linalg.norm(on_face[:, :2], axis=1)
        assert np.abs(np.degrees(np.arctan2(across, on_face[:, 2])) - on_face[:, 6]).max() < 1e-6
        turned = np.degrees(np.arctan2(on_face[:, 1], on_face[:, 0])) - on_face[:, 7]
        assert np.abs((turned + 180.0) % 360.0 - 180.0).max() < 1e-5
        end = rings[rim - 1, 0, 6]
        assert end >= 90.0 - 1e-9 or offset > 0.0
        values = np.stack([np.linalg.norm(rings[..., :2], axis=-1), rings[..., 2]], axis=-1)
        apex = np.tile([0.0, rows[0, 2]], (1, turns, 1))
        through = np.roll(values[:1], turns // 2, axis=1) * [-1.0, 1.0]
        table = np.concatenate([through, apex, values])  # its second ring is the apex
        rng, count = np.random.default_rng(4), {"bicubic": 4, "linear": 2}[scheme]
        t, turn = rim * rng.random(400) ** 0.5, turns * rng.random(400)
        cell, sector = np.minimum(np.floor(t).astype(int), rim - 1), np.floor(turn).astype(int)
        around = np.arange(count) - (count // 2 - 1)
        near = table[(cell[:, None] + around + 1)[:, :, None], ((sector[:, None] + around) % turns)[:, None, :]]
        r, z = np.einsum("nabc,na,nb->cn", near, lagrange(t - cell, count), lagrange(turn - sector, count))
        azimuth = 2.0 * np.pi / turns * turn
        between = np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), z])
        found = off_surface_nm(between, surface, side * offset).max()
        assert 0.2 * stated_nm(head) < found <= 1.05 * stated_nm(head)


@pytest.mark.parametrize(("air", "size"), [(1, 5.5), (-1, 4.5)])
def test_the_offset_of_a_sphere_is_a_sphere_larger_or_smaller_by_the_ball(air, size):
    """Closed form: centres of a ball of 0.5 mm, outside of a sphere of 5 mm off the axis, or inside."""
    centre = np.array([0.3, -0.2, 0.4])
    face = OffsetFace("outer", Ball(tuple(centre), 5.0), air, 0.5)
    points = make_table(face, polar_end_deg(face), 0.5, "bicubic").rows[:, :3]
    assert np.abs(np.linalg.norm(points - centre, axis=1) - size).max() < 1e-9


def test_the_error_falls_with_the_order_of_the_interpolation():
    face = OffsetFace("outer", rough(6.0, 2), 1, 0.2)
    end = polar_end_deg(face)
    for scheme, order in (("bicubic", 4.0), ("linear", 2.0)):
        coarse, fine = (make_table(face, end, step, scheme).errors_nm(scheme, 10**6).max() for step in (0.3, 0.15))
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.7)


def test_a_given_spacing_is_kept_and_its_error_stated():
    lens = lens_of(rough(3.0, 1), rough(6.0, 2))
    for measured in dense_tables(lens, check_of(), GridRequest(spacing_mm=0.5, error_nm=1.0)):
        assert measured.error_nm > 1.0, "the spacing decides"
        assert 0.3 < measured.table.spacing_mm < 0.6


def test_the_stated_error_is_that_of_the_interpolation_and_of_the_spline(monkeypatch):
    lens, request = lens_of(rough(3.0, 1), rough(6.0, 2)), GridRequest(spacing_mm=0.5, error_nm=1.0)
    before = dense_tables(lens, check_of(), request)
    splines = [measured.table.face.spline_error_nm for measured in before]
    monkeypatch.setattr(OffsetFace, "spline_error_nm", property(lambda _: 5e4))
    for one, other, spline in zip(before, dense_tables(lens, check_of(), request), splines, strict=True):
        assert other.error_nm - one.error_nm == pytest.approx(5e4 - spline)


def test_the_tables_of_a_mould_are_scaled_and_their_air_is_where_the_lens_has_material():
    plain = lens_of(Ball((0.0, 0.0, 0.0), 3.0), Ball((0.0, 0.0, 0.0), 6.0), make="insert")
    shrunk = replace(plain, spec=plain.spec.replace({"manufacture.shrinkage": 0.005}))
    request = GridRequest(spacing_mm=0.5, offset_inner_mm=0.25, offset_outer_mm=0.25)
    for scale, lens in ((1.0, plain), (1.005, shrunk)):
        for measured in dense_tables(lens, check_of(), request):
            face = measured.table.face
            rows = measured.table.rows[:, :3]
            size = scale * {"inner": 3.0, "outer": 6.0}[face.name] + {"inner": 0.25, "outer": -0.25}[face.name]
            assert np.abs(np.linalg.norm(rows, axis=1) - size).max() < 1e-11


@pytest.mark.parametrize(
    ("request_of", "line"),
    [
        ({"offset_outer_mm": 0.6}, r"^offset of the outer face = 0\.6 mm: the ball does not fit .* has 0\.5 mm$"),
        ({"offset_inner_mm": -0.1}, r"^offset of the inner face = -0\.1: 0, or the radius of a ball"),
        ({"offset_inner_mm": float("nan")}, r"^offset of the inner face = nan"),
        ({"spacing_mm": 1e-3}, r"^spacing = 0\.001 mm: the table of the inner face would have .* larger spacing$"),
        ({"error_nm": 0.01, "interpolation": "linear"}, r"^error = 0\.01 nm: .* larger error, or bicubic"),
        ({"spacing_mm": 0.0}, r"^spacing = 0\.0: a number of mm from 0\.0001 to 1000$"),
        ({"error_nm": None}, r"^error = None: a number of nm"),
        ({"interpolation": "spline"}, r"^interpolation = 'spline': one of bicubic, linear$"),
    ],
)
def test_a_request_that_cannot_be_met_is_one_line(request_of, line):
    lens = lens_of(Ball((0.0, 0.0, 0.0), 3.0), Ball((0.0, 0.0, 0.0), 6.0))
    with pytest.raises(InputError, match=line) as caught:
        dense_tables(lens, check_of(None, 0.5), GridRequest(**request_of))
    assert "\n" not in str(caught.value)


def test_a_ball_larger_than_the_hollow_crosses_its_own_centres_and_is_refused():
    """A cavity of 3 mm and a ball of 3.2 mm: the check allows any ball here, the centres themselves do not."""
    face = OffsetFace("inner", Ball((0.0, 0.0, 0.0), 3.0), -1, 3.2)
    with pytest.raises(InputError, match="do not surround the origin") as caught:
        polar_end_deg(face)
    assert "\n" not in str(caught.value)


def test_centres_that_are_all_one_point_are_refused_in_one_line():
    """A ball of the radius of the hollow sphere that it touches: every centre is that of the sphere."""
    face = OffsetFace("inner", Ball((0.0, 0.0, 0.0), 3.0), -1, 3.0)
    with pytest.raises(InputError, match="no smooth surface; give a smaller ball") as caught:
        face.found(np.array([[0.5, 0.2]]), lambda points: points[:, :2])
    assert "\n" not in str(caught.value)


def test_a_coarse_polar_table_has_its_run_out_on_the_face():
    """Of 3 mm, 0.8 mm apart: six rings of 15 degrees, of which one more would lie at 105 degrees, beyond the spline."""
    face = OffsetFace("inner", Ball((0.0, 0.0, 0.0), 3.0), -1, 0.0)
    polar = make_table(face, polar_end_deg(face), 0.8, "bicubic")
    assert polar.step_deg <= 6.0
    assert np.abs(np.hypot(polar.values[..., 0], polar.values[..., 1]) - 3.0).max() < 1e-9


@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_the_table_has_the_whole_face_with_its_normals(offset):
    """Normals of a sphere about the origin in closed form, of a rough face by its own."""
    rough_lens = lens_of(rough(3.0, 1), rough(6.0, 2))
    round_lens = lens_of(Ball((0.0, 0.0, 0.0), 3.0), Ball((0.0, 0.0, 0.0), 6.0))
    request = GridRequest(spacing_mm=0.3, offset_inner_mm=offset, offset_outer_mm=offset)
    for lens in (rough_lens, round_lens):
        for table in (measured.table for measured in dense_tables(lens, check_of(), request)):
            surface, air, turns = table.face.surface, table.face.air, len(table.azimuths_deg)
            rows = table.rows[: 1 + table.rim * turns]
            points, normals = rows[:, :3], rows[:, 3:6]
            feet = points - offset * normals
            radius = np.linalg.norm(feet, axis=1)
            assert np.abs(surface.radius(feet / radius[:, None]) - radius).max() < 1e-8
            assert np.abs(air * surface.normal(feet / radius[:, None]) - normals).max() < 1e-6
            if lens is round_lens:
                assert np.abs(air * points / np.linalg.norm(points, axis=1)[:, None] - normals).max() < 1e-8
            lowest = feet[-turns:, 2]
            assert lowest.min() <= 1e-9 if offset else np.abs(lowest).max() < 1e-8, "down to the rim"
