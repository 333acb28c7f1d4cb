import numpy as np
import pytest
import trimesh
from lens_meshes import INNER, OUTER, Rippled, lens_mesh, right, sphere
from nightly import first_by_day
from scipy.spatial import ConvexHull

from lensforge.errors import InputError
from lensforge.proof.part_mesh import facet_average, part_mesh_of, read_part_mesh, smooth_faces


def scattered_on_facets(part, surface, sign, seed=1):
    """Curved points and normals over random points of the facets of one optical surface."""
    rng = np.random.default_rng(seed)
    near = np.abs(np.linalg.norm((part.mesh.triangles_center - surface.centre) * surface.inverse, axis=1) - 1.0)
    facets = np.nonzero((near < 0.02) & (part.mesh.triangles_center[:, 2] > 0.0))[0]
    chosen = rng.choice(facets, 4000)
    points, normals = part.curved(chosen, rng.dirichlet([1.0, 1.0, 1.0], 4000))
    height = np.linalg.norm((points - surface.centre) * surface.inverse, axis=1) - 1.0
    angle = np.linalg.norm(normals - sign * surface.normal(points), axis=1)
    return np.abs(height) * min(surface.semi_axes), angle


def test_the_mean_of_facets_about_a_vertex_is_exact_on_a_sphere():
    """Max's theorem, on the uneven facets between points drawn by chance."""
    outward = np.random.default_rng(3).normal(size=(60, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    hull = ConvexHull(outward)
    corners = outward[hull.simplices]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_turned = (sides * hull.equations[:, :3]).sum(axis=1) < 0.0
    facets = np.where(is_turned[:, None], hull.simplices[:, ::-1], hull.simplices).astype(np.int64)
    normals = facet_average(np.array([1.0, -2.0, 3.0]) + 4.0 * outward, facets)
    np.testing.assert_allclose(normals, outward, atol=1e-12)


@pytest.mark.parametrize(("surface", "sign"), [(OUTER, 1.0), (INNER, -1.0)])
def test_normals_are_third_order_up_to_the_rim(surface, sign):
    coarse, fine = (part_mesh_of(right(count, base=None)) for count in (16, 32))
    (high, tilted), (low, straight) = (scattered_on_facets(part, surface, sign) for part in (coarse, fine))
    assert straight.max() < 6e-4
    assert np.sqrt(np.mean(tilted**2) / np.mean(straight**2)) > 2.0**2.6
    assert np.sqrt(np.mean(high**2) / np.mean(low**2)) > 2.0**2.6
    assert low.max() < 2e-4


def rippled(size, seed):
    """Ripples of half a radian from crest to crest, as narrow as the narrowest functions of a design allow."""
    waves = np.random.default_rng(seed).normal(size=(8, 3))
    return Rippled(size, 12.0 * waves / np.linalg.norm(waves, axis=1, keepdims=True), 0.01)


def tilts(part, surface, sign):
    """Angle (rad) between fitted and exact normals at the vertices of one dome, and which of them are on its rim."""
    rows, index = np.unique(part.corners, return_index=True)
    points = part.mesh.vertices[part.mesh.faces.ravel()[index]]
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    outwards = (part.mesh.triangles_center[index // 3] * part.mesh.face_normals[index // 3]).sum(1) * sign
    on_dome = np.abs(np.linalg.norm(points, axis=1) - surface.radius(directions)) < 1e-9
    rows, directions = (some[on_dome & (outwards > 1.0)] for some in (rows, directions))
    apart = np.linalg.norm(part.fit.fitted[rows] - sign * surface.normal(directions), axis=1)
    return apart, directions[:, 2] < 1e-9


@pytest.mark.parametrize(("name", "sign"), first_by_day(1, [("outer", 1.0), ("inner", -1.0)], "three seconds each"))
def test_normals_of_a_rough_lens_owe_little_to_the_mesh_and_hold_at_the_rim(name, sign):
    surfaces = {"inner": rippled(3.0, 1), "outer": rippled(6.0, 2)}
    part = part_mesh_of(lens_mesh(surfaces["inner"].radius, surfaces["outer"].radius, 96))
    angles, on_rim = tilts(part, surfaces[name], sign)
    assert on_rim.sum() == 6 * 96
    assert np.sqrt(np.mean(angles**2)) < 1e-5  # a cubic leaves 1e-4
    assert angles.max() < 1e-4  # on the rim: a quintic that no ridge holds leaves 1e-3 there


def test_sharp_edges_are_not_smoothed():
    part = part_mesh_of(lens_mesh(sphere(6.0).radius, sphere(13.7).radius, 12, (16.0, 2.0)))
    assert len(np.unique(smooth_faces(part.mesh))) == 6  # two domes, ledge, cylinder, bottom, bore
    flat = np.nonzero(np.abs(part.mesh.face_normals[:, 2]) > 1.0 - 1e-9)[0]
    flat = flat[part.mesh.triangles_center[flat, 2] <= 0.0]
    normals = part.fit.fitted[part.corners[flat]]
    np.testing.assert_allclose(np.abs(normals[..., 2]), 1.0, atol=1e-9)


def test_box_keeps_its_six_faces_and_their_normals():
    part = part_mesh_of(trimesh.creation.box((1.0, 2.0, 3.0)).apply_translation([0.0, 0.0, 5.0]))
    assert len(np.unique(smooth_faces(part.mesh))) == 6
    expected = np.repeat(part.mesh.face_normals[:, None], 3, axis=1)
    np.testing.assert_allclose(part.fit.fitted[part.corners], expected, atol=1e-12)


def test_stl_is_read_as_one_closed_body():
    mesh = right(20)
    part = read_part_mesh(mesh.export(file_type="stl"))
    assert part.open_edges == 0
    assert len(part.mesh.vertices) == len(mesh.vertices)
    assert part.mesh.volume == pytest.approx(mesh.volume, rel=1e-6)


def test_open_and_folded_meshes_are_counted(tmp_path):
    mesh = right(6, base=None)
    holed = trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)
    assert part_mesh_of(holed).open_edges == 3
    turned = mesh.faces.copy()
    turned[5] = turned[5, ::-1]
    assert part_mesh_of(trimesh.Trimesh(mesh.vertices, turned, process=False)).open_edges > 0
    doubled = np.concatenate([mesh.faces, mesh.faces[:1]])
    assert part_mesh_of(trimesh.Trimesh(mesh.vertices, doubled, process=False)).open_edges == 3
    twice = np.concatenate([mesh.faces, mesh.faces])  # each edge as often forth as back
    assert part_mesh_of(trimesh.Trimesh(mesh.vertices, twice, process=False)).open_edges == len(mesh.edges)


@pytest.mark.parametrize("content", [b"", b"solid nothing\nendsolid nothing\n", b"\x00" * 90])
def test_bytes_without_a_mesh_are_one_line_of_input_error(content):
    with pytest.raises(InputError, match=r"STL: .*export") as caught:
        read_part_mesh(content)
    assert "\n" not in str(caught.value)
