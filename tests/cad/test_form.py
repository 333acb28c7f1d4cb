"""Splines of faces: their form against the exact surface, and how it is measured."""

import numpy as np
import pytest
from geometry_lenses import ALL_LEVELS, off_grid_chart, random_surface
from scipy.interpolate import NdBSpline

from lensforge.cad.edges import geom_surface
from lensforge.cad.face_tolerance import MAX_NODES, FaceTolerance
from lensforge.cad.form_error import chart_samples, face_error, fit_to_form, form_error, largest_errors
from lensforge.cad.patch import (
    _JET_ORDERS,
    DEGREE,
    Patch,
    default_nodes,
    fewest_nodes,
    fit_extended,
    fit_patch,
    node_axis,
)
from lensforge.errors import InputError
from lensforge.surfaces.reciprocal import ConicFace
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import HALF_WIDTH, to_sphere

SURFACE = random_surface(2.45, 0.01, seed=3)


def face_of(patch):
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    return BRepBuilderAPI_MakeFace(geom_surface(patch), 1e-7).Face()


def test_a_patch_has_the_bits_of_scipys_spline():
    rng = np.random.default_rng(0)
    knots = np.repeat(np.linspace(-1.2, 1.2, 24), [8, *[1] * 22, 8])
    patch = Patch(rng.normal(size=(30, 30, 3)), knots)
    chart = np.concatenate([rng.uniform(-1.3, 1.3, (500, 2)), knots[[[4, 9], [30, 7]]], [[np.nan, 0.0]]])
    for derivative, order in zip(vars(patch.jet(chart)).values(), _JET_ORDERS, strict=True):
        np.testing.assert_array_equal(derivative, NdBSpline((knots, knots), patch.control, DEGREE)(chart, nu=order))


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
    few, many = (fit_to_form(surface, least=40) for surface in (small, large))
    assert many.nodes > few.nodes
    chart = chart_samples(2048, seed=9)
    error = form_error(large, many.points(chart), many.normals(chart))
    assert error.form_max_nm < 1.0
    assert error.normal_max_mrad < 0.02
    assert fit_to_form(large, 60).nodes == 60


@pytest.mark.parametrize("seed", [0, 1])
def test_a_symmetric_face_keeps_its_tolerance_at_all_its_images(seed):
    """The samples of one image alone miss a tenth of the largest error of seed 0: 48 nodes were kept there."""
    surface = random_surface(2.45, 0.05, seed, (9, 25, 81), "square")
    chart = chart_samples(2**15, seed=3)
    too_few = fit_patch(surface, 48)
    beyond = form_error(surface, too_few.points(chart), too_few.normals(chart)).normal_max_mrad
    tolerance = FaceTolerance(normal_mrad=0.98 * beyond)
    fitted = fit_to_form(surface, least=48, tolerance=tolerance)
    assert form_error(surface, fitted.points(chart), fitted.normals(chart)).normal_max_mrad < tolerance.normal_mrad
    assert fitted.nodes == 49


def test_the_largest_errors_are_sought_between_the_samples():
    """A bump that is narrower than the samples' spacing, at a place in closed form, is measured at its peak."""
    peak = np.array([0.31, 0.42])
    width = 0.03

    def bumpy(chart):
        directions = to_sphere(chart)
        height = 5e-6 * np.exp(-np.sum((chart - peak) ** 2, axis=1) / width**2)
        points = (SURFACE.radius(directions) + height)[:, None] * directions
        return points, SURFACE.normal(directions)

    chart = chart_samples(1024)
    sampled = form_error(SURFACE, *bumpy(chart))
    errors = largest_errors(SURFACE, bumpy, chart)
    tilt = SURFACE.normal(to_sphere(peak[None]))[0] @ to_sphere(peak)
    assert errors.form_max_nm == pytest.approx(5.0 * tilt, rel=1e-4)
    assert sampled.form_max_nm < 0.95 * errors.form_max_nm
    assert errors.form_rms_nm == sampled.form_rms_nm


def test_the_largest_errors_of_a_spline_are_those_of_dense_samples():
    surface = random_surface(2.45, 0.05, seed=5, levels=(9, 25, 81))
    patch = fit_patch(surface, 48)
    errors = largest_errors(surface, lambda chart: (patch.points(chart), patch.normals(chart)), chart_samples())
    many = chart_samples(2**17, seed=3)
    dense = form_error(surface, patch.points(many), patch.normals(many))
    assert 0.96 * dense.form_max_nm < errors.form_max_nm < 1.02 * dense.form_max_nm
    assert 0.96 * dense.normal_max_mrad < errors.normal_max_mrad < 1.02 * dense.normal_max_mrad


def test_a_coarse_spline_has_its_own_points_in_their_directions():
    """They lie off the directions of their parameters by up to 18 nm; what is left is of second order."""
    patch = fit_patch(random_surface(2.45, 0.05, seed=5, levels=(9, 25, 81)), 24)
    chart = 0.95 * off_grid_chart(3000)
    points = patch.points(chart)
    radius = np.linalg.norm(points, axis=1)
    directions = points / radius[:, None]
    off_mm = radius * np.linalg.norm(directions - to_sphere(chart), axis=1)
    assert 1e-5 < off_mm.max() < 1e-4
    np.testing.assert_allclose(patch.radius(directions), radius, rtol=0, atol=1e-9)


def patch_error(surface, nodes=None, reach=1.0):
    patch = fit_patch(surface, nodes)
    chart = reach * off_grid_chart(3000)
    return form_error(surface, patch.points(chart), patch.normals(chart))


@pytest.mark.parametrize("offset", [0.8, 2.45, 6.0, 13.7])
@pytest.mark.parametrize("levels", [(9,), (9, 25, 81), ALL_LEVELS])
def test_default_nodes_reach_a_nanometre_and_20_microradians_off_the_grid(offset, levels):
    error = patch_error(random_surface(offset, 0.02, seed=3, levels=levels))
    assert error.form_max_nm <= 1.0
    assert error.normal_max_mrad <= 0.02


def test_form_converges_with_order_eight_and_normals_with_order_seven():
    surface = random_surface(2.45, 0.02, seed=1, levels=(9, 25))
    coarse, fine = (patch_error(surface, nodes, reach=0.9) for nodes in (81, 161))
    assert np.log2(coarse.form_max_nm / fine.form_max_nm) == pytest.approx(8.0, abs=0.3)
    assert np.log2(coarse.normal_max_mrad / fine.normal_max_mrad) == pytest.approx(7.0, abs=0.3)


def test_nodes_resolve_the_narrowest_function():
    basis = SrbfBasis(ALL_LEVELS, 1.75)
    axis = node_axis(default_nodes(float(basis.sigmas.min())))
    assert 2.0 * np.diff(np.arctan(axis)).max() <= basis.sigmas.min() / 3.0
    assert (axis[0], axis[-1]) == pytest.approx((-HALF_WIDTH, HALF_WIDTH), rel=1e-14)
    assert default_nodes(1e-3) == MAX_NODES


def test_a_surface_through_the_origin_is_refused_with_its_place():
    surface = random_surface(2.45, 0.0, seed=0)
    weights = surface.weights_mm.copy()
    weights[0] = -3.0
    with pytest.raises(InputError, match=r"radius = -\d.*degrees from the axis"):
        fit_patch(SrbfSurface(surface.basis, weights, 2.45))


@pytest.mark.parametrize("nodes", [0, 5, 17, MAX_NODES + 1])
def test_node_counts_out_of_range_are_refused(nodes):
    """Of 17 the eight nodes beyond each edge would reach the pole of the chart."""
    with pytest.raises(InputError, match=f"nodes = {nodes}: from 18 to {MAX_NODES}"):
        fit_patch(random_surface(2.45, 0.0, seed=0), nodes)


def test_the_fewest_nodes_make_a_spline_and_an_extension_needs_more():
    surface = random_surface(2.45, 0.0, seed=0)
    assert fit_patch(surface, 18).nodes == 18 and fit_extended(surface, 22, 10.0).nodes == 25
    with pytest.raises(InputError, match="nodes = 18: 20 with the extension, at least 22"):
        fit_extended(surface, 18, 10.0)


CUP = ConicFace(reach_mm=143.0, parameter_mm=1.69, eccentricity=1.0)  # a paraboloid about an LED, cut off 100 mm away
CUP_RING = (0.0914, 1.0)  # of the chart: from its mouth to the LED's plane


def ring_error(patch, extent, seed=7):
    low, high = extent
    radius, turn = np.random.default_rng(seed).uniform(size=(2, 20_000))
    radius = np.concatenate([low + (high - low) * radius, np.full(500, low), np.full(500, high)])
    turn = 2.0 * np.pi * np.concatenate([turn, np.arange(1000) / 500.0])
    chart = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return form_error(CUP, patch.points(chart), patch.normals(chart))


def test_a_long_cup_keeps_its_form_by_nodes_that_are_denser_towards_its_mouth():
    """With 320 nodes at even angles it is 300 nm and 0.3 mrad off."""
    assert 100.0 < CUP.radius(to_sphere(np.array([[CUP_RING[0], 0.0]])))[0] < 103.0
    error = ring_error(fit_patch(CUP, 240, CUP_RING), CUP_RING)
    assert error.form_max_nm < 50.0 and error.normal_max_mrad < 0.2


def test_the_extended_faces_of_a_long_cup_are_as_good_above_the_rim():
    error = ring_error(fit_extended(CUP, 240, 5.0, CUP_RING), CUP_RING)
    assert error.form_max_nm < 50.0 and error.normal_max_mrad < 0.2


@pytest.mark.parametrize("hole", [1e-4, 0.03, 0.0914, 0.4, 0.9])
def test_nodes_about_a_hole_rise_from_edge_to_edge_within_the_pole(hole):
    fewest = fewest_nodes((hole, 1.0))
    for count in (fewest, 161):
        axis = node_axis(count, 8, HALF_WIDTH, hole)
        assert (axis[8], axis[-9]) == pytest.approx((-HALF_WIDTH, HALF_WIDTH), rel=1e-14)
        np.testing.assert_allclose(axis, -axis[::-1], rtol=1e-12)
        assert (np.diff(axis) > 0.0).all()  # beyond the pole the tangent falls to minus infinity
    steps = np.diff(2.0 * np.arctan(node_axis(161, hole=hole)))
    wanted = 1.0 / np.cosh(np.arcsinh(np.arctan(HALF_WIDTH) / max(1.5 * np.arctan(hole), 0.1)))  # of a sinh
    assert steps[80] / steps[-1] == pytest.approx(wanted, rel=0.05)
    with pytest.raises(InputError, match=f"nodes = {fewest - 1}: from {fewest} to"):
        fit_patch(CUP, fewest - 1, (hole, 1.0))


def test_the_form_error_is_the_largest_and_the_rms_of_distances_and_of_angles():
    """Four points beside a sphere of 5 mm, off by unequal lengths, with normals turned by other unequal angles."""
    sphere = SrbfSurface(SrbfBasis((9,), 1.75), np.zeros(9), 5.0)
    chart = np.array([[0.1, 0.2], [-0.4, 0.3], [0.0, -0.6], [0.5, 0.5]])
    directions = to_sphere(chart)
    off_nm = np.array([10.0, -40.0, 20.0, 5.0])
    turned_mrad = np.array([0.5, 0.1, 2.0, 1.0])
    aside = np.cross(directions, [0.3, -0.8, 0.2])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    normals = directions * np.cos(1e-3 * turned_mrad)[:, None] + aside * np.sin(1e-3 * turned_mrad)[:, None]
    error = form_error(sphere, (5.0 + 1e-6 * off_nm)[:, None] * directions, normals)
    stated = error.form_max_nm, error.form_rms_nm, error.normal_max_mrad, error.normal_rms_mrad
    rms_nm = np.sqrt((100.0 + 1600.0 + 400.0 + 25.0) / 4.0)
    rms_mrad = np.sqrt((0.25 + 0.01 + 4.0 + 1.0) / 4.0)
    np.testing.assert_allclose(stated, (40.0, rms_nm, 2.0, rms_mrad), rtol=1e-6)
