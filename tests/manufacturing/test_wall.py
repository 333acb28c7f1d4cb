import numpy as np
import pytest
from known_shapes import random_surface, sampled, sphere
from scipy.spatial import cKDTree

from lensforge.manufacturing.face import AirSide
from lensforge.manufacturing.wall import normal_lines, radial_lines, thinnest

SMALL, LARGE = 0.8, 2.45


def radial_wall_mm(inner, outer):
    return radial_lines(inner.face.patch, outer, inner.chart).thickness_mm


def normal_wall_mm(inner, outer):
    return normal_lines(inner.face.patch, outer, inner.chart).thickness_mm


def test_concentric_hemispheres_have_one_thickness():
    inner, outer = sampled(sphere(SMALL), AirSide.INSIDE), sampled(sphere(LARGE), AirSide.OUTSIDE)
    for wall in (radial_wall_mm(inner, outer.face), normal_wall_mm(inner, outer.face)):
        assert np.abs(wall[np.isfinite(wall)] - (LARGE - SMALL)).max() < 1e-7
        assert np.isfinite(wall[inner.points[:, 2] > 1e-6]).all()


def test_decentred_spheres_have_the_closed_form_thickness_along_the_normal():
    c_in, c_out = np.array([0.1, 0.0, 0.2]), np.array([-0.3, 0.2, -0.1])
    inner = sampled(sphere(SMALL, tuple(c_in)), AirSide.INSIDE)
    outer = sampled(sphere(LARGE, tuple(c_out)), AirSide.OUTSIDE)
    wall = normal_wall_mm(inner, outer.face)
    n, shift = inner.outward, c_in - c_out
    along = n @ shift
    expected = -along + np.sqrt(along**2 - shift @ shift + LARGE**2) - SMALL
    leaves = inner.points[:, 2] + expected * n[:, 2] < 0.0
    assert np.array_equal(np.isnan(wall), leaves)
    assert leaves.any()
    assert np.abs(wall - expected)[~leaves].max() < 1e-7
    place = thinnest(inner, outer.face, normal_lines)
    # The thinnest place lies on the line of the centres, between the samples: the best of them is 4e-5 mm thicker.
    assert abs(place.thickness_mm - (LARGE - SMALL - np.linalg.norm(shift))) < 1e-8
    assert abs(np.linalg.norm(place.outer_point_mm - c_out) - LARGE) < 1e-7
    assert abs(np.linalg.norm(np.subtract(place.outer_point_mm, place.inner_point_mm)) - place.thickness_mm) < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_the_thinnest_wall_is_the_shortest_way_through(seed):
    inner = sampled(random_surface(SMALL, 0.06, seed), AirSide.INSIDE, 61)
    outer = sampled(random_surface(LARGE, 0.06, seed + 10), AirSide.OUTSIDE, 201)
    radial, normal = radial_wall_mm(inner, outer.face), normal_wall_mm(inner, outer.face)
    outer_tree = cKDTree(outer.points, leafsize=256)
    shortest = outer_tree.query(inner.points)[0].min()
    assert abs(np.nanmin(normal) - shortest) < 2e-3
    assert np.nanmin(normal) < radial.min() - 1e-4
    directions = inner.points / np.linalg.norm(inner.points, axis=1, keepdims=True)
    ends = inner.points + radial[:, None] * directions
    assert outer_tree.query(ends)[0].max() < 0.05


def test_crossing_faces_have_a_negative_wall():
    inner, outer = sampled(sphere(1.0), AirSide.INSIDE), sampled(sphere(1.0, (0.0, 0.0, 0.1)), AirSide.OUTSIDE)
    assert radial_wall_mm(inner, outer.face).min() < 0.0


@pytest.mark.parametrize("raised", [0.3, -0.3])
def test_the_thinnest_radial_wall_is_found_between_the_samples_and_on_the_rim(raised):
    """An inner sphere reaches farthest towards its centre; below z = 0 the rim cuts that place off."""
    centre = np.array([0.23, 0.11, raised])
    inner = sampled(sphere(SMALL, tuple(centre)), AirSide.INSIDE, 41)
    outer = sampled(sphere(LARGE), AirSide.OUTSIDE, 41)
    across = np.linalg.norm(centre[:2])
    # Above: along the centre's direction. Below: in the plane z = 0, the longest ray of the sphere's section.
    reach = np.linalg.norm(centre) + SMALL if raised > 0.0 else across + np.sqrt(SMALL**2 - raised**2)
    wall = thinnest(inner, outer.face, radial_lines)
    assert abs(wall.thickness_mm - (LARGE - reach)) < 1e-7
    assert abs(wall.inner_point_mm[2]) < 1e-7 or raised > 0.0
    assert radial_wall_mm(inner, outer.face).min() > wall.thickness_mm + 1e-6


def test_the_thinnest_random_wall_is_that_of_a_much_finer_grid():
    inner, outer = random_surface(SMALL, 0.06, 1), random_surface(LARGE, 0.06, 11)
    coarse, face = sampled(inner, AirSide.INSIDE, 61), sampled(outer, AirSide.OUTSIDE, 3).face
    fine = sampled(inner, AirSide.INSIDE, 601)
    for lines, wall_mm in ((radial_lines, radial_wall_mm), (normal_lines, normal_wall_mm)):
        dense = np.nanmin(wall_mm(fine, face))
        found = thinnest(coarse, face, lines).thickness_mm
        assert dense - 1e-5 < found < dense + 1e-7
        assert np.nanmin(wall_mm(coarse, face)) > dense + 1e-5
