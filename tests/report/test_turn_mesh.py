import numpy as np
import pytest
import pyvista as pv

from lensforge.report import turn_mesh


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
    data = turn_mesh.small_mesh(sphere, 9.0, 1.5)
    points, faces, normals, view = unpack(data)
    assert sphere.n_cells > 6 * turn_mesh.MOST_TRIANGLES
    assert len(faces) <= turn_mesh.MOST_TRIANGLES
    assert len(data) * 4 / 3 < 300e3, "in base64"
    assert np.linalg.norm(points, axis=1) == pytest.approx(7.0, rel=2e-3)
    assert normals == pytest.approx(points / 7.0, abs=0.03)
    assert view == pytest.approx((9.0, 1.5))
    corners = points[faces]
    volume = np.sum(np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * 343.0, rel=2e-3), "all triangles turn outwards"


def test_edges_stay_sharp():
    points, faces, normals, _ = unpack(turn_mesh.small_mesh(pv.Cube().triangulate(), 1.0, 0.0))
    assert len(points) == 24
    for face in faces:
        corners = points[face]
        outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        for normal in normals[face]:
            assert normal == pytest.approx(outward / np.linalg.norm(outward), abs=0.01)
