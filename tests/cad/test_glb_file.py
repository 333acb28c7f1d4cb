"""glTF files, as trimesh reads them: names, volume and places of a crooked lens, in metres with y up."""

import io
import json

import numpy as np
import pytest
import trimesh
from geometry_lenses import make_lens, plan_of

from lensforge.cad.glb_file import Lines, glb_bytes
from lensforge.cad.mesh import build_mesh
from lensforge.cad.mesh_files import parse_named_3mf, threemf_bytes
from lensforge.errors import InputError
from lensforge.optics.pose import Pose


@pytest.fixture(scope="module")
def mesh():
    lens = make_lens(6.0, 12.7, 0.02, seed=3)
    return build_mesh(plan_of(lens.inner, lens.outer, lens.spec.base), 24)


LINES = 1  # as glTF numbers them


def read(content):
    return trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)


def body_of(scene, names):
    """The faces of these nodes as one mesh in the frame of the file, their rims joined."""
    faces = []
    for name in names:
        matrix, geometry = scene.graph[name]
        faces.append(scene.geometry[geometry].copy().apply_transform(matrix))
    body = trimesh.util.concatenate(faces)
    body.merge_vertices(merge_norm=True, digits_vertex=9)
    return body


def test_names_and_volume_come_back_in_metres_with_y_up(mesh):
    content = glb_bytes(mesh, "crooked")
    scene = read(content)
    assert set(scene.graph.nodes_geometry) == set(mesh.names) and "crooked" in scene.graph.nodes
    body = body_of(scene, mesh.names)
    assert body.is_watertight
    assert body.volume == pytest.approx(1e-9 * mesh.volume(), rel=1e-6)
    x, y, z = mesh.vertices.T
    np.testing.assert_allclose(body.bounds, [[x.min() / 1e3, z.min() / 1e3, -y.max() / 1e3],
                                             [x.max() / 1e3, z.max() / 1e3, -y.min() / 1e3]], atol=1e-8)  # fmt: skip
    assert glb_bytes(mesh, "crooked") == content


def test_each_face_has_its_own_facets(mesh):
    scene = read(glb_bytes(mesh, "crooked"))
    for name in mesh.names:
        a, b, c = np.moveaxis(mesh.vertices[mesh.part(name)], 1, 0)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        assert scene.geometry[name].area == pytest.approx(area, rel=1e-5)


def test_bodies_stand_at_their_places_and_share_their_meshes(mesh):
    places = [Pose(), Pose.facing((0.3, -0.2, 0.9), (31.0, -12.0, 4.0), 25.0)]
    scene = read(glb_bytes(mesh, "crooked", places))
    assert len(scene.geometry) == len(mesh.names)
    for number, place in enumerate(places, 1):
        body = body_of(scene, [f"{name} {number}" for name in mesh.names])
        x, y, z = 1e-3 * place.points(mesh.vertices).T
        np.testing.assert_allclose(body.bounds[0], [x.min(), z.min(), -y.max()], atol=1e-8)
        assert body.volume == pytest.approx(1e-9 * mesh.volume(), rel=1e-6)


def test_lines_stand_beside_the_body_in_their_colour(mesh):
    """The second of two has more points; a line ends where it ends, and is not joined to the next."""
    bent = [
        np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 5.0], [-3.0, 2.0, 9.0]]),
        np.array([[0.0, 1.0, 0.0], [4.0, 1.0, 7.0]]),
    ]
    drawn = {"rays: leaves": Lines(bent, (217, 119, 6)), "rays: base": Lines(bent[1:], (10, 20, 30))}
    content = glb_bytes(mesh, "crooked", lines=drawn)
    scene = read(content)
    assert set(scene.graph.nodes_geometry) == {*mesh.names, *drawn}
    matrix, geometry = scene.graph["rays: leaves"]
    ends = trimesh.transform_points(scene.geometry[geometry].vertices, matrix).reshape(-1, 2, 3)  # of each segment
    pairs = np.concatenate([np.stack([places[:-1], places[1:]], axis=1) for places in bent])
    x, y, z = np.moveaxis(1e-3 * pairs, -1, 0)
    np.testing.assert_allclose(ends, np.stack([x, z, -y], axis=-1), atol=1e-9)
    end = 20 + int.from_bytes(content[12:16], "little")
    document = json.loads(content[20:end])  # the first chunk; then one of numbers
    (base,) = (kept["primitives"][0] for kept in document["meshes"] if kept["name"] == "rays: base")
    assert base["mode"] == LINES
    view = document["bufferViews"][document["accessors"][base["attributes"]["COLOR_0"]]["bufferView"]]
    assert content[end + 8 + view["byteOffset"] :][: view["byteLength"]] == bytes([10, 20, 30, 255]) * 2
    assert body_of(scene, mesh.names).volume == pytest.approx(1e-9 * mesh.volume(), rel=1e-6)


@pytest.mark.parametrize("from_elsewhere", [False, pytest.param(True, marks=pytest.mark.nightly("a child reads it"))])
def test_a_3mf_keeps_the_face_of_each_triangle(mesh, from_elsewhere, monkeypatch):
    content = threemf_bytes(mesh, "crooked")
    if from_elsewhere:
        monkeypatch.setattr("lensforge.cad.mesh_files.made_here", lambda _: False)
    again = parse_named_3mf(content)
    assert again.names == mesh.names
    np.testing.assert_array_equal(again.face, mesh.face)
    np.testing.assert_array_equal(again.triangles, mesh.triangles)


def test_a_3mf_with_a_nameless_facet_is_refused(mesh):
    nameless = type(mesh)(mesh.vertices, mesh.triangles, np.where(mesh.face == 0, 99, mesh.face), mesh.names, 0)
    with pytest.raises(InputError, match=r"lens\.3mf: \d+ triangles belong to no named face"):
        parse_named_3mf(threemf_bytes(nameless, "crooked"))
