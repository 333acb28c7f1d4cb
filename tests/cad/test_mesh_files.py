"""Meshes of a part: closed or not and where, and their files, read back."""

import io
import zipfile

import numpy as np
import pytest
import trimesh
from geometry_lenses import make_lens, plan_of
from nightly import first_by_day

from lensforge.cad.mesh import BodyMesh, build_mesh, check_closed
from lensforge.cad.mesh_files import parse_3mf, parse_stl, stl_bytes, threemf_bytes
from lensforge.errors import InputError

BOX = trimesh.creation.box()
TORUS = trimesh.creation.torus(2.0, 0.5)


def as_body(mesh):
    return BodyMesh(mesh.vertices, mesh.faces, np.zeros(len(mesh.faces), int), ("ALL",), 0)


def test_a_box_is_closed_and_a_torus_has_a_handle():
    assert check_closed(BOX.vertices, BOX.faces).watertight
    assert check_closed(BOX.vertices, BOX.faces).volume_mm3 == pytest.approx(1.0, rel=1e-12)
    assert check_closed(TORUS.vertices, TORUS.faces).genus == 1


def test_a_missing_triangle_is_found():
    closure = check_closed(BOX.vertices, BOX.faces[1:])
    assert closure.status == "NotManifold"
    assert not closure.watertight


def test_triangles_that_are_there_twice_are_a_fault():
    twice = check_closed(BOX.vertices, np.concatenate([BOX.faces, BOX.faces]))
    assert not twice.watertight


def test_a_body_turned_inside_out_and_two_bodies_are_not_one_part():
    assert not check_closed(BOX.vertices, BOX.faces[:, ::-1]).watertight
    twice = np.concatenate([BOX.vertices, BOX.vertices + 5.0]), np.concatenate([BOX.faces, BOX.faces + 8])
    assert not check_closed(*twice).watertight


def test_stl_round_trip_keeps_the_body():
    content = stl_bytes(as_body(TORUS))
    assert len(content) == 84 + 50 * len(TORUS.faces)
    vertices, triangles = parse_stl(content)
    assert vertices.shape == TORUS.vertices.shape
    assert check_closed(vertices, triangles).volume_mm3 == pytest.approx(TORUS.volume, rel=1e-6)


@pytest.fixture(scope="module")
def mesh():
    lens = make_lens(6.0, 12.7, 0.02, seed=3)
    return build_mesh(plan_of(lens.inner, lens.outer, lens.spec.base), 24)


def test_the_mesh_comes_back_with_its_sharing_unit_and_names(mesh):
    content = threemf_bytes(mesh, "crossing")
    vertices, triangles = parse_3mf(content)
    np.testing.assert_array_equal(triangles, mesh.triangles)
    # Single precision errs by half a spacing; lib3mf then writes a decimal up to half a spacing off, read again.
    spacing_mm = np.spacing(np.float32(np.abs(mesh.vertices).max()))
    np.testing.assert_allclose(vertices, mesh.vertices, rtol=0, atol=1.5 * spacing_mm)
    closure = check_closed(vertices, triangles)
    assert closure.watertight
    assert closure.volume_mm3 == pytest.approx(mesh.volume(), rel=1e-6)
    model = zipfile.ZipFile(io.BytesIO(content)).read("3D/3dmodel.model").decode()
    assert 'unit="millimeter"' in model
    for name in mesh.names:
        assert f'name="{name}"' in model
    assert model.count("<t:ref ") + model.count("<t:refrange ") >= len(mesh.names)


DAMAGED = [b"solid nothing", b"", b"\x00" * 90]
FILES = [(parse_stl, "part.stl", content) for content in DAMAGED]
FILES += [(parse_3mf, "part.3mf", content) for content in DAMAGED]


@pytest.mark.parametrize(("parse", "name", "content"), first_by_day(4, FILES, "a 3MF is read by a child: two seconds"))
def test_a_damaged_file_is_one_line(parse, name, content):
    with pytest.raises(InputError, match=f"^{name}: ") as caught:
        check_closed(*parse(content, name))
    assert "\n" not in str(caught.value)
