import numpy as np
import pytest
from geometry_lenses import random_surface

from lensforge.cad.edges import geom_surface
from lensforge.cad.form_error import chart_samples, face_error, fit_to_form, form_error, largest_errors
from lensforge.cad.patch import Patch, fit_patch
from lensforge.errors import InputError
from lensforge.surfaces.srbf import SrbfSurface
from lensforge.surfaces.surface import to_sphere

SURFACE = random_surface(2.45, 0.01, seed=3)


def face_of(patch):
    import cadquery as cq
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    return cq.Face(BRepBuilderAPI_MakeFace(geom_surface(patch), 1e-7).Face())


def test_an_offset_is_reported_along_the_normal():
    directions = to_sphere(chart_samples(512))
    normals = SURFACE.normal(directions)
    points = SURFACE.radius(directions)[:, None] * directions + 7e-6 * normals
    error = form_error(SURFACE, points, SURFACE.normal(points / np.linalg.norm(points, axis=1, keepdims=True)))
    assert error.form_max_nm == pytest.approx(7.0, rel=1e-3)
    assert error.form_rms_nm == pytest.approx(7.0, rel=1e-3)
    assert error.normal_max_mrad < 1e-6


def test_a_turned_normal_is_reported_as_its_angle():
    directions = to_sphere(chart_samples(512))
    normals = SURFACE.normal(directions)
    across = np.cross(normals, [0.0, 0.3, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turned = np.cos(5e-5) * normals + np.sin(5e-5) * across
    error = form_error(SURFACE, SURFACE.radius(directions)[:, None] * directions, turned)
    assert error.normal_max_mrad == pytest.approx(0.05, rel=1e-6)
    assert error.form_max_nm < 1e-5


def test_one_wrong_weight_is_found_on_the_cad_face():
    weights = SURFACE.weights_mm.copy()
    weights[4] += 50e-6
    error = face_error(SrbfSurface(SURFACE.basis, weights, 2.45), face_of(fit_patch(SURFACE)))
    assert 30.0 < error.form_max_nm <= 51.0


def test_a_face_over_another_chart_is_refused():
    patch = fit_patch(SURFACE)
    turned = Patch(np.ascontiguousarray(patch.control.transpose(1, 0, 2)), patch.knots)
    with pytest.raises(InputError, match="chart"):
        face_error(SURFACE, face_of(turned))


def test_a_large_surface_gets_the_nodes_that_its_form_needs():
    small, large = (random_surface(offset, 0.05, seed=5, levels=(9, 25, 81)) for offset in (2.45, 120.0))
    few, many = fit_to_form(small), fit_to_form(large)
    assert many.nodes > few.nodes
    chart = chart_samples(2048, seed=9)
    error = form_error(large, many.points(chart), many.normals(chart))
    assert error.form_max_nm < 1.0
    assert error.normal_max_mrad < 0.02
    assert fit_to_form(large, 60).nodes == 60


def test_the_largest_errors_are_sought_between_the_samples():
    """A bump that is narrower than the samples' spacing, at a place in closed form, is measured at its peak."""
    peak, width = np.array([0.31, 0.42]), 0.03

    def bumpy(chart):
        directions = to_sphere(chart)
        height = 5e-6 * np.exp(-np.sum((chart - peak) ** 2, axis=1) / width**2)
        points = (SURFACE.radius(directions) + height)[:, None] * directions
        return points, SURFACE.normal(directions)

    chart = chart_samples(1024)
    sampled, found = form_error(SURFACE, *bumpy(chart)), largest_errors(SURFACE, bumpy, chart)
    tilt = SURFACE.normal(to_sphere(peak[None]))[0] @ to_sphere(peak)
    assert found.form_max_nm == pytest.approx(5.0 * tilt, rel=1e-4)
    assert sampled.form_max_nm < 0.95 * found.form_max_nm
    assert found.form_rms_nm == sampled.form_rms_nm


def test_the_largest_errors_of_a_spline_are_those_of_dense_samples():
    surface = random_surface(2.45, 0.05, seed=5, levels=(9, 25, 81))
    patch = fit_patch(surface, 48)
    found = largest_errors(surface, lambda chart: (patch.points(chart), patch.normals(chart)), chart_samples())
    many = chart_samples(2**17, seed=3)
    dense = form_error(surface, patch.points(many), patch.normals(many))
    assert 0.96 * dense.form_max_nm < found.form_max_nm < 1.02 * dense.form_max_nm
    assert 0.96 * dense.normal_max_mrad < found.normal_max_mrad < 1.02 * dense.normal_max_mrad
